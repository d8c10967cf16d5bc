"""However long the stream runs and whatever its thermometers do, what is kept does not grow."""

from collections.abc import Callable, Iterator
import pickle

import pytest

from wrist_ft_comp.model.drift_model import DriftModel
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings

SECOND = 1_000_000_000
START_S = 1_700_000_000
HISTORY_S = 20.0
Readings = Iterator[tuple[int, float]]


def steady(second: int) -> Readings:
    """Two thermometers, three readings a second each."""
    for k in range(3):
        for thermometer in range(2):
            yield thermometer, second + k / 3


def one_is_silent(second: int) -> Readings:
    """The second one speaks for half a minute only."""
    yield from (each for each in steady(second) if each[0] == 0 or second < 30)


def one_never_speaks(second: int) -> Readings:
    """Only the first one is there."""
    yield 0, float(second)


def clock_runs_back(second: int) -> Readings:
    """Time jumps back by an hour every hundred seconds."""
    yield from ((j, at - 3600 * (second // 100)) for j, at in steady(second))


def with_gaps(second: int) -> Readings:
    """A minute without a reading in every five."""
    yield from steady(second) if second % 300 < 240 else ()


@pytest.mark.parametrize('axes', [{}, {'force_z': (0.4, 1e-3, 30.0)}])
@pytest.mark.parametrize(
    'readings', [steady, one_is_silent, one_never_speaks, clock_runs_back, with_gaps]
)
def test_what_is_kept_does_not_grow(
    make_model: Callable[..., DriftModel],
    readings: Callable[[int], Readings],
    axes: dict[str, tuple[float, float, float]],
) -> None:
    settings = StreamSettings(history_s=HISTORY_S)
    compensator = Compensator(2, settings, make_model(axes, thermometers=2) if axes else None)
    sizes = []
    for second in range(900):
        for thermometer, at in readings(second):
            stamp_ns = round((START_S + at) * SECOND)
            compensator.add_temperature(thermometer, stamp_ns, 20.0 + second % 7)
        compensator.correct((START_S + second) * SECOND, [1.0] * 6)
        if second % 150 == 149:
            sizes.append(len(pickle.dumps(compensator)))
    # What is kept for a model to come is full after HISTORY_S; numbers differ by some digits.
    assert max(sizes) - sizes[0] < 200, sizes
