"""Whether a load that was declared still did move: steps that no drift makes, and what to do."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.data_checks import MIN_SAMPLES, stamp_of
from wrist_ft_comp.signals import (
    AXES,
    axis_unit,
    FloatArray,
    IntArray,
    noise_level,
    Recording,
    Reference,
    stretches,
)

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
#: A jump of a smaller share of the range counts where the level changes with it, and where it is
#: this many times the largest step of the cells beside it.
_STANDS_OUT = 4.0
#: A side of jumps is worth learning from where it is this share of the recording.
_SIDE_SHARE = 0.25


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
        for axis in axes if _is_still(recording, reference) else ():
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
                    f'cells, first at stamp {stamp_of(recording, spikes[0])} with '
                    f'{raw[spikes[0]]:.3g} {axis_unit(axis)}; left out.'
                )
    return sound, sentences


def changed_levels(
    recordings: Sequence[Recording], axes: Sequence[str], reference: Reference
) -> list[str]:
    """Name still loads whose level changes at once by less than a jump, as by a tare."""
    sentences = []
    for recording in recordings:
        for axis in axes if _is_still(recording, reference) else ():
            raw = recording.wrench[:, AXES.index(axis)]
            if len(cells := _find_level_changes(raw)):
                size, after_s, advice = _describe_jumps(recording, raw, cells)
                sentences.append(
                    f'{axis} of {recording.name} jumps by {size:.3g} {axis_unit(axis)} '
                    f'after {after_s:.0f} s and keeps the new level ({len(cells)} jumps). If that '
                    'was a tare of the driver or a contact, and no sudden heat, what is learnt is '
                    f'wrong by about as much.{advice}'
                )
    return sentences


def _is_still(recording: Recording, reference: Reference) -> bool:
    """Whether the load of a recording was declared still; a payload's weight is separated."""
    weighed = reference == 'payload' and recording.specific_force is not None
    return reference != 'recorded' and not weighed


def _find_jumps(raw: FloatArray, period_s: float) -> IntArray:
    """Find the cells at which an axis is farther from the cell before than drift can be."""
    at = np.flatnonzero(np.isfinite(raw))
    # A gap is no jump: drift moves on while nothing is recorded.
    joined = np.diff(stretches(np.isfinite(raw), period_s)[at]) == 0
    steps = np.abs(np.diff(raw[at])) * joined
    if len(steps) <= MIN_SAMPLES:
        return at[:0]
    limit = max(_least_jump(raw[at]), _JUMP_TO_RANGE * float(np.ptp(raw[at])))
    return np.asarray(at[1:][(steps > limit) & (limit > 0)])


def _find_level_changes(raw: FloatArray) -> IntArray:
    """Find the cells at which the level of an axis changes at once, however little."""
    at = np.flatnonzero(np.isfinite(raw))
    if len(at) <= MIN_SAMPLES:
        return at[:0]
    distance = np.diff(at)
    steps = np.diff(raw[at]) * (distance <= 2 * np.median(distance))
    limit = _least_jump(raw[at])
    # Over two cells, because a jump may lie within one.
    double = np.abs(steps[1:] + steps[:-1])
    found = set[int]()
    for n in np.flatnonzero((double > limit) & (limit > 0)).tolist():
        beside = steps[max(n - _LEVEL_CELLS, 0) : n], steps[n + 2 : n + 2 + _LEVEL_CELLS]
        if min(map(len, beside)) < _LEVEL_CELLS:
            continue
        before, after = (
            raw[at[n - _LEVEL_CELLS + 1 : n + 1]],
            raw[at[n + 2 : n + 2 + _LEVEL_CELLS]],
        )
        # Drift, even sudden heat, goes on at the same rate beside a step.
        drift = (_LEVEL_CELLS + 1) * np.median(np.concatenate(beside))
        change = abs(np.median(after) - np.median(before) - drift)
        stands_out = double[n] > _STANDS_OUT * np.abs(np.concatenate(beside)).max()
        if stands_out and change > max(limit, _OTHER_LEVEL_SHARE * double[n]):
            found.add(n + 1 + int(abs(steps[n + 1]) > abs(steps[n])))
    return np.asarray(at[sorted(found)])


def _least_jump(raw: FloatArray) -> float:
    """Smallest step that neither the noise nor the resolution of an axis makes."""
    return max(_JUMP_TO_NOISE * noise_level([raw]), _JUMP_TO_RESOLUTION * _resolution(raw))


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
    size, after_s, advice = _describe_jumps(
        recording, recording.wrench[:, AXES.index(axis)], cells
    )
    declared = reference.replace('payload', 'constant, as there is no specific force')
    stamps = ' to '.join(
        stamp_of(recording, cell) for cell in dict.fromkeys(cells[[0, -1]].tolist())
    )
    raise CalibrationRefusedError(
        f'{axis} of {recording.name} jumps by {size:.3g} {axis_unit(axis)} after '
        f'{after_s:.0f} s, although the load was declared {declared} ({len(cells)} jumps, at '
        f'stamp {stamps}). Record again without contact or payload change, or record the load as '
        f'reference.{advice}'
        + ' Or declare it payload, because specific force was recorded.'
        * (recording.specific_force is not None)
    )


def _describe_jumps(
    recording: Recording, raw: FloatArray, cells: IntArray
) -> tuple[float, float, str]:
    """Give the size of the largest jump, its time, s, and what may be left out, or ''."""
    at = np.flatnonzero(np.isfinite(raw))
    steps = np.abs(raw[cells] - raw[at[np.searchsorted(at, cells) - 1]])
    before, after = raw[at[at < cells[0]][-_LEVEL_CELLS:]], raw[at[at >= cells[-1]][:_LEVEL_CELLS]]
    other_level = abs(np.median(after) - np.median(before)) > _OTHER_LEVEL_SHARE * steps.max()
    begin_s, end_s = (float(cell) * recording.period_s for cell in cells[[0, -1]])
    margin_s, duration_s = 10 * recording.period_s, len(recording) * recording.period_s
    until_s, from_s = max(begin_s - margin_s, 0), end_s + margin_s
    advice = ''
    if other_level:
        sides = [f'--until {until_s:.0f}'] * (until_s > _SIDE_SHARE * duration_s)
        sides += [f'--from {from_s:.0f}'] * (duration_s - from_s > _SIDE_SHARE * duration_s)
        advice = f' Or take one side of it: {", or ".join(sides)}.' if sides else ''
    elif end_s - begin_s < _BUMP_SHARE * duration_s:
        advice = f' Or leave that part out: --exclude {until_s:.0f}..{from_s:.0f}.'
    return float(steps.max()), float(cells[np.argmax(steps)]) * recording.period_s, advice


def _resolution(values: FloatArray) -> float:
    """Smallest step between neighbours, where there are more than a few; else of rounding."""
    steps = np.abs(np.diff(values))
    rounding = 1e-12 * float(np.max(np.abs(values), initial=0.0))
    steps = steps[steps > rounding]
    return float(steps.min()) if len(steps) > _FEW_STEPS else rounding
