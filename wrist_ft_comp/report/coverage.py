"""Which temperatures and loads recordings have covered, seen together with a wrench."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.fit.cross_validation import bin_means
from wrist_ft_comp.signals import AXES, FloatArray, IntArray, Recording, stretches

#: What a robot's wrist may meet: from a hall on a cold morning to hours of hard work, °C.
WORKING_RANGE_C = (15.0, 50.0)
#: Width of the bins in which time is counted, K.
BIN_K = 1.0
#: Rise and fall are counted between means over this time, so that noise is no cooling, s.
_TREND_S = 300.0


@dataclass(frozen=True, eq=False)
class Coverage:
    """What recordings have seen, all together."""

    #: Edges of temperature bins, shape (B + 1,), and the time of each thermometer there, (J, B).
    edges_c: FloatArray
    seconds: FloatArray
    #: Lowest and highest temperature of each thermometer, shape (J, 2).
    range_c: FloatArray
    #: The thermometer that spans most, counted from 0: what it has not seen is not known.
    leading: int
    #: How far it went up and down.
    risen_k: float
    fallen_k: float
    #: Smallest, largest and standard deviation, N or N m, by axis where a reference was recorded.
    loads: dict[str, tuple[float, float, float]]


def cover(recordings: Sequence[Recording]) -> Coverage:
    """Count what recordings have seen together; one of them at least holds a wrench."""
    cells = [_cells_with_wrench(recording) for recording in recordings]
    pairs = list(zip(recordings, cells, strict=True))
    temperature_c = np.concatenate([each.temperature_c[at] for each, at in pairs])
    period_s = np.concatenate([np.full(len(at), each.period_s) for each, at in pairs])
    range_c = np.stack((temperature_c.min(axis=0), temperature_c.max(axis=0)), axis=1)
    lowest = np.floor(min(WORKING_RANGE_C[0], range_c.min()) / BIN_K)
    highest = np.ceil(max(WORKING_RANGE_C[1], range_c.max()) / BIN_K)
    edges = np.arange(lowest, highest + 1) * BIN_K
    seconds = [np.histogram(column, edges, weights=period_s)[0] for column in temperature_c.T]
    leading = int(np.argmax(np.ptp(range_c, axis=1)))
    moves = np.concatenate([_moves(each, at, leading) for each, at in pairs])
    up_k, down_k = (float(np.abs(moves[way]).sum()) for way in (moves > 0, moves < 0))
    seen = np.array(seconds), range_c, leading
    return Coverage(edges, *seen, up_k, down_k, _loads(recordings))


def unseen_temperatures(coverage: Coverage) -> list[tuple[float, float]]:
    """List the parts of the working range that the leading thermometer has not seen, °C."""
    low, high = coverage.range_c[coverage.leading].tolist()
    empty = np.concatenate(([False], coverage.seconds[coverage.leading] == 0, [False]))
    edges = coverage.edges_c[np.flatnonzero(np.diff(empty))].tolist()
    holes = [
        (start, end)
        for start, end in zip(edges[::2], edges[1::2], strict=True)
        if low <= start and end <= high
    ]
    coldest, hottest = WORKING_RANGE_C
    return [
        (start, end)
        for start, end in [(coldest, low), *holes, (high, hottest)]
        if end - start >= BIN_K
    ]


def _cells_with_wrench(recording: Recording) -> IntArray:
    """Find the cells at and between wrenches, but for gaps."""
    present = np.any(np.isfinite(recording.wrench), axis=1)
    at, numbers = np.flatnonzero(present), stretches(present, recording.period_s)
    inside = [at[numbers[at] == number] for number in np.unique(numbers[at])]
    ranges = [np.arange(each[0], each[-1] + 1) for each in inside]
    return np.concatenate([np.arange(0), *ranges])


def _moves(recording: Recording, at: IntArray, thermometer: int) -> FloatArray:
    """Change between neighbouring means of a thermometer over cells, K."""
    if not len(at):
        return np.zeros(0)
    cells = max(round(_TREND_S / recording.period_s), 1)
    return np.diff(bin_means(recording.temperature_c[at, thermometer], at, cells))


def _loads(recordings: Sequence[Recording]) -> dict[str, tuple[float, float, float]]:
    """Range of the reference wrench, by axis."""
    reference = np.concatenate([recording.reference for recording in recordings])
    loads = {}
    for axis, column in zip(AXES, reference.T, strict=True):
        known = column[np.isfinite(column)]
        if len(known):
            loads[axis] = float(known.min()), float(known.max()), float(known.std())
    return loads
