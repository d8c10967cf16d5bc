"""Whether recordings can be calibrated from: refusals with numbers and a remedy."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
import math

import numpy as np

from wrist_ft_comp.drift.drift_model import order_problem
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.axis_data import find_plateaus
from wrist_ft_comp.fit.thermometers import runs
from wrist_ft_comp.signals import (
    AXES,
    BoolArray,
    differ,
    FloatArray,
    IntArray,
    noise_level,
    Recording,
    Reference,
    require_recordings,
    stretches,
)
from wrist_ft_comp.stream.temperature_spikes import jumps

#: Fewer cells with a wrench than this cannot be divided into folds worth holding out.
MIN_SAMPLES = 30
#: Two recordings are the same day where readings differ by less than this many times their noise,
#: as they do where one of them has fewer digits; of another day a quarter of them does so ...
_EQUAL_NOISE = 0.5
#: ... in more than this share of the cells: rounded stamps move a few samples to the next cell.
_EQUAL_SHARE = 0.9
#: A jump between neighbouring cells counts as load where it exceeds this many times the noise …
_JUMP_TO_NOISE = 12.0
#: … and this share of the axis' whole range.
_JUMP_TO_RANGE = 0.2
#: … and this many steps of its resolution.
_JUMP_TO_RESOLUTION = 3.5
#: An axis with no more steps than this may only have been loaded and unloaded: its steps do not
#: show its resolution.
_FEW_STEPS = 4
#: A cell is a spike where its axis comes back by all but this share of the jump …
_RETURN_SHARE = 0.3
#: … and cells are no longer than this: a longer cell averages more than a spike, s.
_LONGEST_SPIKE_S = 10.0
#: Most spikes of an axis; with more, and with more than a share of the cells, a load moves.
_MOST_SPIKES = 3
_MOST_SPIKES_SHARE = 1e-3
#: Jumps within this share of a recording are a bump, which can be left out.
_BUMP_SHARE = 0.1
#: Whether the level changed is judged by the medians of this many cells before and after jumps ...
_LEVEL_CELLS = 10
#: ... which then differ by more than this share of the largest jump.
_OTHER_LEVEL_SHARE = 0.5
#: A channel is lively where this share of its neighbouring cells differ …
_LIVELY_SHARE = 0.9
#: … and then stuck where it keeps a value for this many cells.
_STUCK_CELLS = 30
#: Stuck cells up to this share are left out; with more, the recording is refused.
_STUCK_SHARE = 0.05
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
        if other.unit != first.unit:
            raise CalibrationRefusedError(
                f'{first.name} and {other.name} are in different units; they must be the same. '
                'Calibrate chamber tables and other recordings apart.'
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


def check_loads(
    recordings: Sequence[Recording], axes: Sequence[str], reference: Reference
) -> tuple[list[Recording], list[str]]:
    """Make spikes of a still load NaN, and say so; refuse a load that moves, and no reference."""
    sound, sentences = list(recordings), list[str]()
    for number, recording in enumerate(recordings):
        if reference == 'recorded' and not np.isfinite(recording.reference).any():
            raise CalibrationRefusedError(
                f'{recording.name} holds no reference wrench, but the reference was declared '
                'recorded. Record wrench_reference beside the raw wrench, or declare the '
                'reference unloaded or constant.'
            )
        weighed = reference == 'payload' and recording.specific_force is not None
        for axis in axes if reference != 'recorded' and not weighed else ():
            raw = recording.wrench[:, AXES.index(axis)]
            jumps = _find_jumps(raw, recording.period_s)
            spikes = _find_spikes(raw, recording.period_s) if len(jumps) else []
            clean = np.where(np.isin(np.arange(len(raw)), spikes), np.nan, raw)
            if len(jumps) and len(_find_jumps(clean, recording.period_s)):
                _refuse_jumps(recording, axis, reference, jumps)
            if spikes:
                wrench = sound[number].wrench.copy()
                wrench[:, AXES.index(axis)] = clean
                sound[number] = replace(recording, wrench=wrench)
                sentences.append(
                    f'{axis} of {recording.name} stands out alone in {len(spikes)} of {len(raw)} '
                    f'cells, first at stamp {_stamp(recording, spikes[0])} with '
                    f'{raw[spikes[0]]:.3g} {recording.unit_of(axis)}; left out.'
                )
    return sound, sentences


def _find_jumps(raw: FloatArray, period_s: float) -> IntArray:
    """Find the cells at which an axis is farther from the cell before than drift can be."""
    at = np.flatnonzero(np.isfinite(raw))
    # A gap is no jump: drift moves on while nothing is recorded.
    joined = np.diff(stretches(np.isfinite(raw), period_s)[at]) == 0
    steps = np.abs(np.diff(raw[at])) * joined
    if len(steps) <= MIN_SAMPLES:
        return at[:0]
    limit = max(
        _JUMP_TO_NOISE * noise_level([raw]),
        _JUMP_TO_RANGE * float(np.ptp(raw[at])),
        _JUMP_TO_RESOLUTION * _resolution(raw[at]),
    )
    return np.asarray(at[1:][(steps > limit) & (limit > 0)])


def _find_spikes(raw: FloatArray, period_s: float) -> list[int]:
    """Find the cells that an axis jumps to and back from; none where they are too many."""
    raw, spikes = raw.copy(), list[int]()
    at = np.flatnonzero(np.isfinite(raw))
    most = max(_MOST_SPIKES, _MOST_SPIKES_SHARE * len(at)) if period_s <= _LONGEST_SPIKE_S else 0
    while len(jumps := _find_jumps(raw, period_s)):
        at = np.flatnonzero(np.isfinite(raw))
        place = np.searchsorted(at, jumps)
        before, spike = raw[at[place - 1]], raw[jumps]
        after = raw[at[np.minimum(place + 1, len(at) - 1)]]
        found = jumps[
            np.isin(place + 1, place) & (abs(after - before) < _RETURN_SHARE * abs(spike - before))
        ]
        if not len(found):  # the first cell and the last have one neighbour only
            found = at[[0, -1]][np.isin(at[[1, -1]], jumps)]
        if not 0 < len(found) <= most - len(spikes):
            return []
        spikes += found.tolist()
        raw[found] = np.nan
    return sorted(spikes)


def _refuse_jumps(recording: Recording, axis: str, reference: Reference, cells: IntArray) -> None:
    """Say where a load moved, and what to do."""
    raw = recording.wrench[:, AXES.index(axis)]
    at = np.flatnonzero(np.isfinite(raw))
    steps = np.abs(raw[cells] - raw[at[np.searchsorted(at, cells) - 1]])
    declared = reference.replace('payload', 'constant, as there is no specific force')
    stamps = ' to '.join(
        _stamp(recording, cell) for cell in dict.fromkeys(cells[[0, -1]].tolist())
    )
    begin_s, end_s = (float(cell) * recording.period_s for cell in cells[[0, -1]])
    margin_s = 10 * recording.period_s
    before, after = raw[at[at < cells[0]][-_LEVEL_CELLS:]], raw[at[at >= cells[-1]][:_LEVEL_CELLS]]
    level_changed = abs(np.median(after) - np.median(before)) > _OTHER_LEVEL_SHARE * steps.max()
    is_bump = end_s - begin_s < _BUMP_SHARE * len(recording) * recording.period_s
    remedy = ''
    if level_changed:
        remedy = (
            f' Or take one side of it: --until {max(begin_s - margin_s, 0):.0f}, or --from '
            f'{end_s + margin_s:.0f}.'
        )
    elif is_bump:
        remedy = (
            f' Or leave that part out: --exclude {max(begin_s - margin_s, 0):.0f}..'
            f'{end_s + margin_s:.0f}.'
        )
    raise CalibrationRefusedError(
        f'{axis} of {recording.name} jumps by {steps.max():.3g} {recording.unit_of(axis)} after '
        f'{cells[np.argmax(steps)] * recording.period_s:.0f} s, although the load was declared '
        f'{declared} ({len(cells)} jumps, at stamp {stamps}). Record again without contact or '
        f'payload change, or record the load as reference.{remedy}'
        + ' Or declare it payload, because specific force was recorded.'
        * (recording.specific_force is not None)
    )


def _stamp(recording: Recording, cell: int) -> str:
    """Write the stamp at which a cell begins."""
    return f'{(recording.first_cell + cell) * recording.period_s:.10g} s'


def _resolution(values: FloatArray) -> float:
    """Smallest step between neighbours, where there are more than a few; else of rounding."""
    steps = np.abs(np.diff(values))
    rounding = 1e-12 * float(np.max(np.abs(values), initial=0.0))
    steps = steps[steps > rounding]
    return float(steps.min()) if len(steps) > _FEW_STEPS else rounding


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
                f'{recordings[0].unit_of(axis)} throughout: the channel is dead, or not '
                'connected. It is left uncompensated.'
            )
            continue
        # Stuck cells do not count where it is asked how often the reading changes.
        stuck_cells = [_find_stuck(recording.wrench[:, column]) for recording in recordings]
        free = [
            _present(recording.wrench[~stuck, column])
            for recording, stuck in zip(recordings, stuck_cells, strict=True)
        ]
        lively = any(
            differ(values[1:], values[:-1]).mean() >= _LIVELY_SHARE
            for values in free
            if len(values) > 1
        )
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
    first_s = int(np.argmax(stuck)) * recording.period_s
    return (
        f'{axis} of {recording.name} {"saturates" if extreme else "freezes"} at '
        f'{value:.6g} {recording.unit_of(axis)}: {count * recording.period_s:.0f} s '
        f'({100 * share:.1f} %) without any change, first after {first_s:.0f} s'
    )


def silent_stretches(recordings: Sequence[Recording], max_gap_s: float) -> list[str]:
    """
    Name thermometers that are silent for long while wrenches come, and wrenches that are missing.

    Between the plateaus of a chamber test wrenches may be missing.
    """
    sentences = []
    for recording in recordings:
        period_s, name = recording.period_s, recording.name
        present = np.any(np.isfinite(recording.wrench), axis=1)
        for j, measured in enumerate(recording.measured.T):
            begin, end = _longest_silence(measured, present, max_gap_s / period_s)
            if end > begin:
                how = 'a straight line was drawn over it'
                if not measured[end:].any():
                    how = 'its last reading was held'
                sentences.append(
                    f'Thermometer {j + 1} of {name} is silent for {(end - begin) * period_s:.0f} '
                    f's, from {begin * period_s:.0f} s on; {how}, and the drift of that time is a '
                    'guess. Leave that time out of calibrate and evaluate: --exclude '
                    f'{math.floor(begin * period_s)}..{math.ceil(end * period_s)}.'
                )
        begin, end = _longest_silence(present, np.ones_like(present), max_gap_s / period_s)
        if end > begin and find_plateaus(recordings) is None:
            sentences.append(
                f'The raw wrench of {name} is missing for {(end - begin) * period_s:.0f} s, from '
                f'{begin * period_s:.0f} s on; nothing is known of the drift of that time.'
            )
    return sentences


def _longest_silence(heard: BoolArray, counts: BoolArray, cells: float) -> tuple[int, int]:
    """Find the longest silence of more cells, from its first that counts to its last; or 0, 0."""
    silences = [(0, 0)]
    for first, last in runs(~heard):
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
                sentences.append(
                    f'Thermometer {j} of {recording.name} jumps faster than metal can: by '
                    f'{steps_k[jumped[0]]:.1f} K at stamp {_stamp(recording, at[jumped[0] + 1])}, '
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
