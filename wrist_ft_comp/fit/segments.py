"""
Still loads: what stands out alone is left out, and each step of the zero begins a new segment.

A recording has an unknown offset. A tare of the driver, a bump that moved the sensor, a connector
that was reseated only begin another one, so nothing of the recording is lost by them.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.ranges import rounded
from wrist_ft_comp.signals import (
    AXES,
    axis_unit,
    BoolArray,
    FloatArray,
    noise_level,
    Recording,
    Reference,
    time_in,
)
from wrist_ft_comp.steps import find_steps, Step

#: What is shorter than half of this is no level of a reading, but a contact or a spike, s. Of a
#: longer touch both ends are steps.
_LEVEL_S = 120.0
#: A reading stands out where it is this many standard deviations of its noise from its level ...
_OUTLYING_SIGMA = 12.0
#: ... and this share of the axis' range: sudden heat bends less within two minutes.
_OUTLYING_SHARE = 0.2
#: Where readings stand out for more than this share of the time, the load is not still.
_MOST_OUTLYING_SHARE = 0.05
#: Readings that scatter by more around their level, N and N m, are not those of a still sensor:
#: the noise of the worst that was seen is 0.2 N in means over a second.
_MOVING_N, _MOVING_NM = 1.0, 0.1
#: A step is at least this share of an axis' range. In 100 drawn days with fast heat four steps
#: were seen that were none, all below 0.025.
_STEP_SHARE = 0.05
#: Longest time without readings that a step may lie in, s.
_GAP_S = 30.0
#: Axes are named that step by this many standard deviations of their noise.
_NAMED_SIGMA = 5.0
#: Drift can be learnt from a segment of at least this length, s ...
_SHORTEST_SEGMENT_S = 600.0
#: ... and from a recording of which such segments are at least this share.
_LEAST_USABLE_SHARE = 0.5
#: So many steps are named one by one.
_NAMED_STEPS = 5


def is_still(recording: Recording, reference: Reference) -> bool:
    """Whether the load of a recording was declared still; a payload's weight is separated."""
    weighed = reference == 'payload' and recording.specific_force is not None
    return reference != 'recorded' and not weighed


def segment(
    recordings: Sequence[Recording], reference: Reference
) -> tuple[list[Recording], list[str]]:
    """
    Leave out of still loads what stands out, and take steps out of them.

    Every step is kept in ``Recording.steps``, for a constant of its own, and named. The sentences
    say what was found. CalibrationRefusedError where a load moves, or steps too often.
    """
    segmented, sentences = list[Recording](), list[str]()
    for recording in recordings:
        if not is_still(recording, reference):
            segmented.append(recording)
            continue
        still, outliers = _without_outliers(recording, reference)
        stepless, steps = _without_steps(still)
        segmented.append(stepless)
        sentences += outliers + steps
    return segmented, sentences


def _without_outliers(recording: Recording, reference: Reference) -> tuple[Recording, list[str]]:
    """Make readings NaN that stand out from their level, and say so."""
    wrench, sentences = recording.wrench.copy(), list[str]()
    declared = reference.replace('payload', 'constant, as there is no specific force')
    for axis in recording.axes_present:
        raw = recording.wrench[:, AXES.index(axis)]
        outlying, distance = _find_outliers(raw, recording.period_s)
        scatter = float(np.sqrt(np.nanmean(np.where(outlying, np.nan, distance) ** 2)))
        if scatter > (_MOVING_N if axis.startswith('force') else _MOVING_NM):
            sentences.append(
                f'{axis} of {recording.name} swings by {rounded(scatter, 2)} {axis_unit(axis)} '
                f'(RMS) around its level of {_LEVEL_S:.0f} s, although the load was declared '
                f'{declared}. Did the robot move, or does something vibrate? Record again '
                'standing still, or with the specific force (--reference payload).'
            )
        if not outlying.any():
            continue
        size = float(distance[outlying].max())
        share = outlying.sum() / np.isfinite(raw).sum()
        cells = np.flatnonzero(outlying)
        size_words = f'{rounded(size)} {axis_unit(axis)}'
        if share > _MOST_OUTLYING_SHARE and len(cells) > 1:
            raise CalibrationRefusedError(
                f'{axis} of {recording.name} moves by up to {size_words} for {100 * share:.0f} % '
                f'of the time, although the load was declared {declared}, first at '
                f'{time_in(recording, cells[0])}: the robot moved, or something touched the '
                'sensor. Record again without, or record what makes it known: the specific force '
                '(--reference payload) or the load itself (--reference recorded).'
            )
        wrench[outlying, AXES.index(axis)] = np.nan
        sentences.append(
            f'{axis} of {recording.name} stands out by up to {size_words} for '
            f'{len(cells) * recording.period_s:.0f} s in all, first at '
            f'{time_in(recording, cells[0])}; left out.'
        )
    return replace(recording, wrench=wrench), sentences


def _find_outliers(raw: FloatArray, period_s: float) -> tuple[BoolArray, FloatArray]:
    """Mark cells, (N,), that stand out from the level of minutes; and tell how far all do."""
    at = np.flatnonzero(np.isfinite(raw))
    width = max(2 * round(_LEVEL_S / 2 / period_s) + 1, 3)
    distance = np.full(len(raw), np.nan)
    if len(at) < width:
        return np.zeros(len(raw), dtype=bool), np.zeros(len(raw))
    level = median_filter(raw[at], width, mode='nearest')
    distance[at] = np.abs(raw[at] - level)
    limit = max(_OUTLYING_SIGMA * noise_level([raw]), _OUTLYING_SHARE * float(np.ptp(level)))
    rounding = 1e-12 * float(np.abs(raw[at]).max())
    return distance > max(limit, rounding), distance


def _without_steps(recording: Recording) -> tuple[Recording, list[str]]:
    """Take steps of the zero out of a recording, and name them."""
    columns = [AXES.index(axis) for axis in recording.axes_present]
    raw = recording.wrench[:, columns]
    noise = np.array([max(noise_level([values]), _resolution(values)) for values in raw.T])
    columns = [column for column, of_axis in zip(columns, noise, strict=True) if of_axis > 0]
    raw, noise = raw[:, noise > 0], noise[noise > 0]
    if not columns:
        return recording, []
    counts = np.asarray(np.isfinite(raw).all(axis=1))
    ranges = np.array([float(np.ptp(values[np.isfinite(values)])) for values in raw.T])
    found = find_steps(
        raw[np.newaxis], np.zeros(len(raw), dtype=np.int64), counts, noise, recording.period_s
    )
    at = np.flatnonzero(counts)
    after = np.searchsorted(at, [step.cell for step in found])
    # Drift moves on while nothing is recorded, so what changes over a gap is no step.
    gaps_s = (at[after] - at[after - 1]) * recording.period_s
    steps = sorted(
        (
            step
            for step, gap_s in zip(found, gaps_s.tolist(), strict=True)
            if step.certain
            and gap_s <= max(_GAP_S, recording.period_s)
            and (abs(step.jump) > _STEP_SHARE * ranges).any()
        ),
        key=lambda step: step.cell,
    )
    if not steps:
        return recording, []
    _refuse_many(recording, steps)
    wrench = recording.wrench.copy()
    for step in steps:
        wrench[step.cell :, columns] -= step.jump
    sentences = [
        f'{recording.name} steps at {time_in(recording, step.cell)}: '
        + ', '.join(
            f'{AXES[column]} by {rounded(jump)} {axis_unit(AXES[column])}'
            for column, jump, of_axis in zip(columns, step.jump.tolist(), noise, strict=True)
            if abs(jump) > _NAMED_SIGMA * of_axis
        )
        + '. A new segment begins there, as after a tare.'
        for step in steps[:_NAMED_STEPS]
    ]
    if len(steps) > _NAMED_STEPS:
        sentences.append(f'{recording.name} steps {len(steps) - _NAMED_STEPS} times more.')
    cells = sorted({*recording.steps, *(step.cell for step in steps)})
    return replace(recording, wrench=wrench, steps=tuple(cells)), sentences


def _refuse_many(recording: Recording, steps: Sequence[Step]) -> None:
    """Refuse a recording between whose steps nothing can be learnt."""
    ends = [0, *(step.cell for step in steps), len(recording)]
    lengths_s = np.diff(ends) * recording.period_s
    usable_s = lengths_s[lengths_s >= _SHORTEST_SEGMENT_S].sum()
    if usable_s < _LEAST_USABLE_SHARE * recording.duration_s and len(steps) > 1:
        raise CalibrationRefusedError(
            f'{recording.name} steps {len(steps)} times, from {time_in(recording, ends[1])} to '
            f'{time_in(recording, ends[-2])}, and only {usable_s:.0f} s of '
            f'{recording.duration_s:.0f} s are in segments of {_SHORTEST_SEGMENT_S:.0f} s or '
            'more: too little to learn from. Record again without contacts and tares, or record '
            'the specific force (--reference payload).'
        )


def _resolution(values: FloatArray) -> float:
    """Deviate by rounding to the smallest step between neighbours (standard); 0 of a constant."""
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    steps = steps[steps > 1e-12 * float(np.nanmax(np.abs(values)))]
    return float(steps.min()) / np.sqrt(12) if len(steps) else 0.0
