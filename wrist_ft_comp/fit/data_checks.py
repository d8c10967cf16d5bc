"""Whether recordings can be calibrated from: refusals with numbers and a remedy."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
import math

import numpy as np

from wrist_ft_comp.drift.drift_model import order_problem
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.folds import find_plateaus
from wrist_ft_comp.fit.thermometer_prediction import runs_of
from wrist_ft_comp.signals import (
    AXES,
    axis_unit,
    BoolArray,
    differ,
    elapsed_s,
    FloatArray,
    noise_level,
    Recording,
    Reference,
    require_recordings,
    time_in,
)
from wrist_ft_comp.stream.temperature_spikes import jumps

#: Fewer cells with a wrench than this cannot be divided into folds worth holding out.
MIN_SAMPLES = 30
#: Two recordings are the same day where readings differ by less than this many times their noise,
#: as they do where one of them has fewer digits; of another day a quarter of them does so ...
_EQUAL_NOISE = 0.5
#: ... in more than this share of the cells: rounded stamps move a few samples to the next cell.
_EQUAL_SHARE = 0.9
#: A channel is lively where this share of its neighbouring cells differ …
_LIVELY_SHARE = 0.9
#: … and then stuck where it keeps a value for this many cells.
_STUCK_CELLS = 30
#: Stuck cells up to this share are left out; with more, the recording is refused.
_STUCK_SHARE = 0.05
#: A thermometer is silent where it misses this many of its usual samples.
_SEVERAL_SAMPLES = 10
#: Two thermometers read the same where one leaves less than this share of the other unexplained.
_SAME_SHARE = 0.03


def check_alike(recordings: Sequence[Recording]) -> None:
    """Refuse to calibrate from none, or from recordings that differ in what must be the same."""
    require_recordings(recordings)
    if not recordings:
        raise CalibrationRefusedError('A calibration needs at least one recording; got none.')
    first = recordings[0]
    for other in recordings[1:]:
        if other.thermometers != first.thermometers:
            raise CalibrationRefusedError(
                f'{first.name} has {first.thermometers} thermometers and {other.name} has '
                f'{other.thermometers}; they must be the same. Leave one recording out.'
            )
        if other.period_ns != first.period_ns:
            raise CalibrationRefusedError(
                f'{first.name} is on thermal cells of {first.period_s} s and {other.name} on '
                f'{other.period_s} s; they must be the same. Read them with one period.'
            )
        if problem := order_problem(first.sensor, other.sensor):
            raise CalibrationRefusedError(f'{first.name} and {other.name} differ: {problem}')
    for other, recording in combinations(recordings, 2):
        if _are_the_same(other, recording):
            raise CalibrationRefusedError(
                f'{recording.name} holds the readings of {other.name}: it is the same day in '
                'another form. Name one of them only.'
            )


def _are_the_same(one: Recording, other: Recording) -> bool:
    """Whether wrenches are equal up to rounding, whatever their stamps; noise never repeats."""
    cells = min(len(one), len(other))
    if abs(len(one) - len(other)) > 1 or cells < MIN_SAMPLES:
        return False
    shares = []
    for ours, theirs in zip(one.wrench[:cells].T, other.wrench[:cells].T, strict=True):
        if noise := noise_level((ours, theirs)):
            equal = np.abs(ours - theirs) <= _EQUAL_NOISE * noise
            shares.append(equal.sum() / (np.isfinite(ours) | np.isfinite(theirs)).sum())
    return bool(shares) and min(shares) > _EQUAL_SHARE


def check_reference(recordings: Sequence[Recording], reference: Reference) -> None:
    """Refuse recordings without the reference that was declared recorded."""
    for recording in recordings:
        if reference == 'recorded' and not np.isfinite(recording.reference).any():
            raise CalibrationRefusedError(
                f'{recording.name} holds no reference wrench, but the reference was declared '
                'recorded. Record wrench_reference beside the raw wrench, or declare the '
                'reference unloaded or constant.'
            )


def check_temperatures(recordings: Sequence[Recording], min_span_k: float) -> FloatArray:
    """Refuse too small a span of temperature; return the range of each thermometer, °C, (J, 2)."""
    everything = np.concatenate([recording.temperature_c for recording in recordings])
    ranges = np.stack((everything.min(axis=0), everything.max(axis=0)), axis=1)
    span = float(np.max(ranges[:, 1] - ranges[:, 0]))
    if span < min_span_k:
        names = ', '.join(recording.name for recording in recordings)
        raise CalibrationRefusedError(
            f'Temperature in {names} spans {span:.1f} K; at least '
            f'{min_span_k:.1f} K are needed. Record a warm-up from cold.'
        )
    return ranges


def drop_stuck_cells(
    recordings: Sequence[Recording], axes: Sequence[str]
) -> tuple[list[Recording], list[str]]:
    """
    Make cells in which a raw wrench is stuck NaN, and say so.

    An axis that is stuck for long is left out of its recording; refused where no other has it.
    """
    sound = list(recordings)
    sentences: list[str] = []
    dead = [axis for axis in axes if _is_dead(recordings, AXES.index(axis))]
    if len(dead) == len(axes):
        names = ', '.join(recording.name for recording in recordings)
        raise CalibrationRefusedError(
            f'Every axis of {names} keeps one value throughout, which no sensor does that '
            'measures. Check that the sensor streams, and record again.'
        )
    for axis in axes:
        column = AXES.index(axis)
        if axis in dead:
            value = _present(recordings[0].wrench[:, column])[:1]
            sentences.append(
                f'{axis} reads {float(value[0]) if len(value) else 0.0:.6g} '
                f'{axis_unit(axis)} throughout: the channel is dead, or not '
                'connected. It is left uncompensated.'
            )
            continue
        # Stuck cells do not count where it is asked how often the reading changes.
        stuck_cells = [_find_stuck(recording.wrench[:, column]) for recording in recordings]
        free = [
            recording.wrench[~stuck, column]
            for recording, stuck in zip(recordings, stuck_cells, strict=True)
        ]
        lively = _is_lively(free)
        counts = [np.isfinite(recording.wrench[:, column]).sum() for recording in recordings]
        too_long = [
            stuck.sum() > _STUCK_SHARE * count
            for stuck, count in zip(stuck_cells, counts, strict=True)
        ]
        others = any(count and not long for count, long in zip(counts, too_long, strict=True))
        for i, (recording, stuck) in enumerate(zip(sound, stuck_cells, strict=True)):
            if lively and stuck.any():
                what = _describe_stuck(recording, axis, stuck)
                if too_long[i] and not others:
                    raise CalibrationRefusedError(
                        f'{what}; up to {100 * _STUCK_SHARE:.0f} % can be left out. Check the '
                        'range and the driver of the sensor, and record again.'
                    )
                left_out = 'it is not learnt from that recording' if too_long[i] else 'left out'
                sentences.append(f'{what}; {left_out}.')
                wrench = recording.wrench.copy()
                wrench[stuck | too_long[i], column] = np.nan
                sound[i] = replace(recording, wrench=wrench)
    return sound, sentences


def _present(values: FloatArray) -> FloatArray:
    return np.asarray(values[np.isfinite(values)])


def _is_dead(recordings: Sequence[Recording], column: int) -> bool:
    """Tell whether an axis never changes in any recording."""
    series = [_present(recording.wrench[:, column]) for recording in recordings]
    return not any(differ(values, values[0]).any() for values in series if len(values))


def _is_lively(series: Sequence[FloatArray]) -> bool:
    """Tell whether a channel changes from nearly every cell to the next, in some of its series."""
    present = [_present(values) for values in series]
    return any(
        differ(values[1:], values[:-1]).mean() >= _LIVELY_SHARE
        for values in present
        if len(values) > 1
    )


def _find_stuck(values: FloatArray) -> BoolArray:
    """Mark the cells of all long runs of one value, shape (N,)."""
    at = np.flatnonzero(np.isfinite(values))
    starts = np.flatnonzero(np.append(True, differ(values[at[1:]], values[at[:-1]])))
    lengths = np.diff(starts, append=len(at))
    stuck = np.zeros(len(values), dtype=bool)
    stuck[at[np.repeat(lengths >= _STUCK_CELLS, lengths)]] = True
    return stuck


def _describe_stuck(recording: Recording, axis: str, stuck: BoolArray) -> str:
    """Say where an axis is stuck, and for how long."""
    values = recording.wrench[:, AXES.index(axis)]
    kept, counts = np.unique(values[stuck], return_counts=True)
    value = float(kept[np.argmax(counts)])
    extreme = not differ(np.array([np.nanmin(values), np.nanmax(values)]), value).all()
    count = int(stuck.sum())
    share = count / int(np.isfinite(values).sum())
    return (
        f'{axis} of {recording.name} {"saturates" if extreme else "freezes"} at '
        f'{value:.6g} {axis_unit(axis)}: {count * recording.period_s:.0f} s '
        f'({100 * share:.1f} %) without any change, first at '
        f'{time_in(recording, int(np.argmax(stuck)))}'
    )


def drop_unknown_temperatures(
    recordings: Sequence[Recording], max_gap_s: float
) -> tuple[list[Recording], list[str]]:
    """
    Make wrenches NaN while a thermometer is silent or frozen for long, and say so.

    CalibrationRefusedError where that is most of a recording.
    """
    sound, sentences = list[Recording](), list[str]()
    for recording in recordings:
        period_s, wrench = recording.period_s, recording.wrench.copy()
        for j in range(recording.thermometers):
            runs, frozen = _unknown_runs(recording, j, max_gap_s)
            for first, last in runs:
                wrench[first:last] = np.nan
            if not runs:
                continue
            first, last = max(runs, key=lambda run: run[1] - run[0])
            what = (
                f'Thermometer {j + 1} of {recording.name} '
                f'{"keeps one value" if frozen[first:last].any() else "is silent"} for '
                f'{(last - first) * period_s:.0f} s, from {time_in(recording, first)} on'
            )
            if np.isfinite(wrench).sum() < np.isfinite(recording.wrench).sum() / 2:
                raise CalibrationRefusedError(
                    f'{what}: for most of the wrenches nobody knows its temperature. Record '
                    'again, or leave that thermometer out.'
                )
            sentences.append(f'{what}; wrenches of that time are not learnt from.')
        sound.append(replace(recording, wrench=wrench))
    return sound, sentences


def _unknown_runs(
    recording: Recording, thermometer: int, max_gap_s: float
) -> tuple[list[tuple[int, int]], BoolArray]:
    """Find where a thermometer is silent or frozen for long, and all cells where it is frozen."""
    measured = recording.measured[:, thermometer]
    values_c = np.where(measured, recording.temperature_c[:, thermometer], np.nan)
    frozen = _find_stuck(values_c)
    frozen &= _is_lively([values_c[~frozen]])
    # One that always reports seldom is not silent in between.
    usual = np.median(np.diff(np.flatnonzero(measured))) if measured.sum() > 1 else 0.0
    most = max(max_gap_s / recording.period_s, _SEVERAL_SAMPLES * usual)
    runs = [(first, last) for first, last in runs_of(~measured | frozen) if last - first > most]
    return runs, frozen


def silent_stretches(recordings: Sequence[Recording], max_gap_s: float) -> list[str]:
    """Name thermometers and wrenches that are silent for long."""
    return silent_thermometers(recordings, max_gap_s) + missing_wrenches(recordings, max_gap_s)


def silent_thermometers(recordings: Sequence[Recording], max_gap_s: float) -> list[str]:
    """Name thermometers that are silent for long while wrenches come."""
    sentences = []
    for recording in recordings:
        period_s = recording.period_s
        present = np.any(np.isfinite(recording.wrench), axis=1)
        for j, measured in enumerate(recording.measured.T):
            begin, end = _longest_silence(measured, present, max_gap_s / period_s)
            if end > begin:
                how = 'a straight line was drawn over it'
                if not measured[end:].any():
                    how = 'its last reading was held'
                sentences.append(
                    f'Thermometer {j + 1} of {recording.name} is silent for '
                    f'{(end - begin) * period_s:.0f} s, from {time_in(recording, begin)} on; '
                    f'{how}, and the drift of that time is a guess. Leave that time out: '
                    f'--exclude {math.floor(elapsed_s(recording, begin))}..'
                    f'{math.ceil(elapsed_s(recording, end))}.'
                )
    return sentences


def missing_wrenches(recordings: Sequence[Recording], max_gap_s: float) -> list[str]:
    """Name wrenches that are missing for long, but not between the plateaus of a chamber test."""
    sentences = []
    for recording in recordings:
        period_s = recording.period_s
        present = np.any(np.isfinite(recording.wrench), axis=1)
        begin, end = _longest_silence(present, np.ones_like(present), max_gap_s / period_s)
        if end > begin and find_plateaus(recordings) is None:
            sentences.append(
                f'The raw wrench of {recording.name} is missing for '
                f'{(end - begin) * period_s:.0f} s, from {time_in(recording, begin)} on; nothing '
                'is known of the drift of that time.'
            )
    return sentences


def small_spans(recordings: Sequence[Recording], min_span_k: float) -> list[str]:
    """Name recordings that alone would be refused, beside others that would not."""
    spans_k = [float(np.ptp(recording.temperature_c, axis=0).max()) for recording in recordings]
    return [
        f'Temperature in {recording.name} spans {span_k:.1f} K only. Each recording is judged by '
        'what is learnt from the others, and little is learnt from this one: leave it out.'
        for recording, span_k in zip(recordings, spans_k, strict=True)
        if span_k < min_span_k <= max(spans_k)
    ]


def _longest_silence(heard: BoolArray, counts: BoolArray, cells: float) -> tuple[int, int]:
    """Find the longest silence of more cells, from its first that counts to its last; or 0, 0."""
    silences = [(0, 0)]
    for first, last in runs_of(~heard):
        at = first + np.flatnonzero(counts[first:last])
        if len(at) and at[-1] + 1 - at[0] > cells:
            silences.append((int(at[0]), int(at[-1]) + 1))
    return max(silences, key=lambda ends: ends[1] - ends[0])


def jumping_thermometers(recordings: Sequence[Recording]) -> list[str]:
    """Name thermometers that step faster than metal can, as the running node does."""
    sentences = list[str]()
    for recording in recordings if find_plateaus(recordings) is None else ():
        for j, (values_c, measured) in enumerate(
            zip(recording.temperature_c.T, recording.measured.T, strict=True), start=1
        ):
            at = np.flatnonzero(measured)
            steps_k = np.diff(values_c[at])
            jumped = np.flatnonzero(jumps(steps_k, np.diff(at) * recording.period_s))
            if len(jumped):
                when = time_in(recording, at[jumped[0] + 1])
                sentences.append(
                    f'Thermometer {j} of {recording.name} jumps faster than metal can: by '
                    f'{steps_k[jumped[0]]:.1f} K at {when}, '
                    f'the first of {len(jumped)}. Is it loose?'
                )
    return sentences


def idle_thermometers(recordings: Sequence[Recording]) -> list[str]:
    """Name thermometers that stand still, or read the same as another one."""
    moves = np.any(
        [differ(r.temperature_c, r.temperature_c[0]).any(axis=0) for r in recordings], axis=0
    )
    sentences = [
        f'Thermometer {j + 1} reads {recordings[0].temperature_c[0, j]:.1f} °C throughout; it '
        'tells nothing. Check its topic.'
        for j in np.flatnonzero(~moves)
    ]
    centred = np.concatenate([r.temperature_c - r.temperature_c.mean(axis=0) for r in recordings])
    deviation, moving = centred.std(axis=0), np.flatnonzero(moves)
    for n, j in enumerate(moving):
        for k in moving[:n]:
            slope = float(centred[:, k] @ centred[:, j] / (centred[:, k] @ centred[:, k]))
            apart_k = float(np.std(centred[:, j] - slope * centred[:, k]))
            if apart_k < _SAME_SHARE * deviation[j]:
                sentences.append(
                    f'Thermometers {k + 1} and {j + 1} say the same: apart from a factor and a '
                    f'constant they differ by {apart_k:.2g} K, while they move by '
                    f'{deviation[j]:.2g} K (standard deviations). A second thermometer helps '
                    'where it sees another source of heat.'
                )
    return sentences
