"""What recordings have seen, together with a wrench, and what to record next."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.fit.folds import bin_means
from wrist_ft_comp.recording import Recording, Reference
from wrist_ft_comp.report.verdict import Level
from wrist_ft_comp.series import FloatArray, stretches

#: Temperatures of a robot's wrist, °C: from a hall on a cold morning to hours of hard work.
WORKING_RANGE_C = (15.0, 50.0)
#: Width of the bins in which time is counted, K.
BIN_K = 1.0
#: Rise and fall are counted between means over this time, s, so that noise does not count.
_TREND_S = 300.0
#: A recording should last for this many slowest time constants.
_TIME_CONSTANTS = 4.0
#: A recording should last for at least this time, s.
_SHORTEST_S = 3600.0
#: Warming is missing where it is less than this share of cooling, and the other way round.
_ONE_WAY_SHARE = 0.2
#: Temperatures closer than this are the same, K.
_SAME_K = 0.5


@dataclass(frozen=True, eq=False)
class Coverage:
    """What all recordings have seen together."""

    #: Edges of temperature bins, °C, shape (B + 1,).
    edges_c: FloatArray
    #: How long each thermometer was in each bin, s, shape (J, B).
    seconds: FloatArray
    #: Lowest and highest temperature of each thermometer, °C, shape (J, 2).
    range_c: FloatArray
    #: Number of the thermometer that spans most, counted from 0; advice is about this one.
    leading: int
    #: How far the leading thermometer went up, and down.
    risen_k: float
    fallen_k: float
    #: Smallest, largest and standard deviation, N or N m, by axis where a reference was recorded.
    loads: dict[str, tuple[float, float, float]]

    @property
    def loaded(self) -> bool:
        """Whether a recorded reference was ever another one than zero."""
        return any(low < 0 or high > 0 for low, high, _ in self.loads.values())


def cover(recordings: Sequence[Recording]) -> Coverage:
    """Count what recordings have seen together; at least one of them must hold a wrench."""
    # The cells at and between wrenches, but for gaps.
    cells = []
    for recording in recordings:
        present = np.any(np.isfinite(recording.wrench), axis=1)
        at, numbers = np.flatnonzero(present), stretches(present, recording.period_s)
        parts = [at[numbers[at] == number] for number in np.unique(numbers[at])]
        cells.append(
            np.concatenate([np.arange(0), *(np.arange(part[0], part[-1] + 1) for part in parts)])
        )
    pairs = list(zip(recordings, cells, strict=True))
    temperature_c = np.concatenate([recording.temperature_c[at] for recording, at in pairs])
    period_s = np.concatenate([np.full(len(at), recording.period_s) for recording, at in pairs])
    range_c = np.stack((temperature_c.min(axis=0), temperature_c.max(axis=0)), axis=1)
    lowest = np.floor(min(WORKING_RANGE_C[0], range_c.min()) / BIN_K)
    highest = np.ceil(max(WORKING_RANGE_C[1], range_c.max()) / BIN_K)
    edges = np.arange(lowest, highest + 1) * BIN_K
    seconds = [np.histogram(column, edges, weights=period_s)[0] for column in temperature_c.T]
    leading = int(np.argmax(np.ptp(range_c, axis=1)))
    # Rise and fall, between means of the leading thermometer.
    moves = np.concatenate([
        np.diff(bin_means(recording.temperature_c[at, leading], at,
                          max(round(_TREND_S / recording.period_s), 1)))
        for recording, at in pairs if len(at)
    ])  # fmt: skip
    reference = np.concatenate([recording.reference for recording in recordings])
    loads = {
        axis: (float(loaded.min()), float(loaded.max()), float(loaded.std()))
        for axis, column in zip(AXES, reference.T, strict=True)
        if len(loaded := column[np.isfinite(column)])
    }
    return Coverage(
        edges_c=edges, seconds=np.array(seconds), range_c=range_c, leading=leading,
        risen_k=float(np.abs(moves[moves > 0]).sum()),
        fallen_k=float(np.abs(moves[moves < 0]).sum()), loads=loads)  # fmt: skip


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


def what_to_record_next(
    coverage: Coverage,
    levels: Mapping[str, Level],
    reference: Reference,
    durations_s: Sequence[float],
    slowest_s: float,
) -> list[str]:
    """Say what another recording should hold, most important first."""
    advice = []
    low, high = coverage.range_c[coverage.leading]
    where = f' at thermometer {coverage.leading + 1}' if len(coverage.range_c) > 1 else ''
    holes = []
    for start, end in unseen_temperatures(coverage):
        if low < end <= high > start:
            holes.append(f'{start:.0f} to {end:.0f}')
        else:
            advice.append(
                f'You have not seen {start:.0f} to {end:.0f} °C{where}: there the correction is a '
                'guess, a straight line. If the robot gets there, record it there.'
            )
    if holes:
        advice.append(
            f'Between {low:.0f} and {high:.0f} °C you have not seen {", ".join(holes)} °C{where}: '
            'there the correction is a guess between its neighbours. Record some of these.'
        )
    # A second thermometer where one explains little.
    if len(coverage.range_c) == 1 and (poor := _poor_axes(levels)):
        advice.append(
            f'One thermometer does not explain {poor} well. Heat that comes from two sides needs '
            'two: put another one at the side of the motor, or of the room.'
        )
    # The missing direction.
    up, down = coverage.risen_k, coverage.fallen_k
    if min(up, down) < _ONE_WAY_SHARE * max(up, down):
        missing, action = ('cooled', 'cool down') if down < up else ('warmed', 'warm up')
        advice.append(
            f'The sensor {missing} by {min(up, down):.1f} K only, and went {max(up, down):.1f} K '
            f'the other way: let it {action} while recording. A lag shows where both ways differ.'
        )
    # Longer, and more often.
    longest_s, wanted_s = max(durations_s), max(_TIME_CONSTANTS * slowest_s, _SHORTEST_S)
    if longest_s < wanted_s:
        why = f', as the slowest lag is {slowest_s / 60:.0f} min' if slowest_s > 0 else ''
        advice.append(
            f'The longest recording lasts {longest_s / 3600:.1f} h; record '
            f'{wanted_s / 3600:.1f} h or more{why}.'
        )
    if len(durations_s) == 1:
        advice.append(
            'Record on a second day: a model is then judged on whole days that it has not seen.'
        )
    if missing_axes := [axis for axis in AXES if axis not in levels]:
        names = _enumerate(missing_axes)
        advice.append(f'No recording holds {names}; what is not recorded is passed through.')
    if reference not in {'recorded', 'payload'} or not coverage.loads:
        advice.append(
            'The drift of the gain is not known. If the sensor works under large loads, record '
            'changing loads with a reference beside them (reference "recorded").'
        )
    return [
        *advice,
        'Judge this model on a recording that it has not seen: wrist_ft_comp evaluate.',
    ]


def what_was_not_learnt(
    coverage: Coverage, learnt_c: Sequence[tuple[float, float]], levels: Mapping[str, Level]
) -> str:
    """Say where a recording left the ranges, °C, that a model learnt; or why it may be weak."""
    outside = [
        f'thermometer {number}'
        for number, (seen, learnt) in enumerate(
            zip(coverage.range_c, learnt_c, strict=True), start=1
        )
        if seen[0] < learnt[0] - _SAME_K or seen[1] > learnt[1] + _SAME_K
    ]
    if outside:
        return (
            f'Here {" and ".join(outside)} left the temperatures that the model was learnt at. '
            'Calibrate again with these recordings among the others.'
        )
    known = 'The model was learnt at all the temperatures of these recordings'
    if poor := _poor_axes(levels):
        return (
            f'{known}, and yet much is left of {poor}: heat comes from where no thermometer is, '
            'or the load moved. See with wrist_ft_comp show whether a recording holds another '
            'temperature, and calibrate with that too; or put a thermometer at the side of the '
            'motor, or of the room.'
        )
    unseen = [f'{start:.0f} to {end:.0f}' for start, end in unseen_temperatures(coverage)]
    if not unseen:
        return f'{known}; they ask for no other one.'
    return (
        f'{known}. They hold nothing at {_enumerate(unseen)} °C: if the robot gets there, '
        'evaluate a recording of that, too.'
    )


def _poor_axes(levels: Mapping[str, Level]) -> str:
    """Enumerate the axes of which a model leaves much; empty where there is none."""
    return _enumerate([axis for axis, level in levels.items() if level in {'weak', 'harmful'}])


def _enumerate(words: Sequence[str]) -> str:
    """Write a list for people, such as ``force_x, force_y and force_z``."""
    return ' and '.join([', '.join(words[:-1]), *words[-1:]] if len(words) > 1 else words)
