"""
Still loads: what stands out alone is left out, and each step of the zero begins a new segment.

A recording has an unknown offset. A tare of the driver, a bump that moved the sensor, a connector
that was reseated only begin another one, so nothing of the recording is lost by them.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise

import numpy as np
import scipy  # which loads its parts when they are used

from wrist_ft_comp.channels import AXES, axis_unit
from wrist_ft_comp.drift.drift_model import DriftModel, run_from_rest
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.chamber_test import find_plateaus
from wrist_ft_comp.fit.data_checks import Cleaned, MOST_LEFT_OUT, runs_of
from wrist_ft_comp.fit.folds import mean_over
from wrist_ft_comp.recording import Recording, Reference, time_in
from wrist_ft_comp.series import FloatArray, IntArray, noise_level, rounded, ROUNDING
from wrist_ft_comp.steps_in_recordings import BESIDE_S, find_steps, SMALLEST_SIGMA, Step

#: In a log of a row in up to a minute, a level is at least this many samples: three of them may be
#: a contact.
_LEVEL_SAMPLES = 7
#: A reading stands out by this share of the axis' range (and as a step does, by its noise): sudden
#: heat bends less within two minutes.
_OUTLYING_SHARE = 0.2
#: Readings that scatter by more are not those of a still sensor, N, and N m at a lever of 0.1 m.
#: The noise of the worst that was seen is 0.2 N in means over a second.
MOVING = {'N': 1.0, 'N m': 0.1}
#: A step is at least this share of an axis' range. In 100 drawn days with fast heat four steps
#: were seen that were none, all below 0.025.
_STEP_SHARE = 0.05
#: A driver is started again in less than this, s; a recorder goes on after ten minutes.
_RESTART_S = 660.0
#: What a pause left is the difference of means over this time, s.
_MINUTE_S = 60.0
#: Steps are looked for this often at most, as one that was found hides others beside it, such as
#: the other end of a touch. Of 100 kinds of touches, one look judges 27 otherwise than five.
_ROUNDS = 5
#: Drift can be learnt from a segment of at least this length, s. A recording is refused where such
#: segments are less than half of it.
SHORTEST_SEGMENT_S = 600.0


def segment(recordings: Sequence[Recording], reference: Reference) -> Cleaned:
    """
    Leave out of still loads what stands out, and take steps out of them.

    Every step is kept in ``Recording.steps``, for a constant of its own, and named. The sentences
    say what was found. CalibrationRefusedError where a load moves, or steps too often.
    """
    # The load is known, or what is between the plateaus of a chamber is the drift.
    if reference in {'recorded', 'payload'} or find_plateaus(recordings) is not None:
        return list(recordings), []
    segmented, sentences = list[Recording](), list[str]()
    for recording in recordings:
        still, outliers = _without_outliers(recording, reference)
        sentences += outliers
        # An axis that fell silent, or is read seldom, would hide what the others do.
        read = np.isfinite(still.wrench).sum(axis=0)
        while (most := read.max()) > 0:
            group = read >= (1 - MOST_LEFT_OUT) * most
            read[group] = 0
            try:
                still, steps = _without_steps(still, np.flatnonzero(group).tolist())
            except CalibrationRefusedError:
                if most == np.isfinite(still.wrench).sum(axis=0).max():
                    raise
                continue  # a loose wire of one axis is no fault of the others
            sentences += steps
        segmented.append(still)
    return segmented, sentences


def begin_where_tared(
    recordings: Sequence[Recording], reference: Reference, model: DriftModel | None = None
) -> Cleaned:
    """
    Begin a segment wherever a driver may have been tared, though heat may do the same; say where.

    That is after each long pause, each pause in the first or last two minutes, and where what was
    read beside a recorded reference steps. With a model that was learnt so, only where it leaves
    more of a pause than twice of any other time as long: the rest is slow drift.
    """
    begun, sentences = list[Recording](), list[str]()
    drifts = reference != 'payload' and find_plateaus(recordings) is None
    for recording in recordings if drifts else ():
        at = np.flatnonzero(np.isfinite(recording.wrench).any(axis=1))
        if not len(at):  # every axis of it was left out
            begun.append(recording)
            continue
        pauses_s, usual_s = recording.period_s * np.diff(at), recording.period_s * _cells_apart(at)
        lasted_s = recording.period_s * (at - at[0])
        # Beside a short stretch at the start or the end nothing tells a step from drift.
        is_short = np.minimum(lasted_s[:-1], lasted_s[-1] - lasted_s[1:]) < BESIDE_S
        least_s = np.where(is_short, BESIDE_S / 4, _RESTART_S)
        cells = at[1:][pauses_s > np.maximum(least_s, 3 * usual_s)].tolist()
        if model is not None:
            cells = _unlike_drift(recording, model, at, cells)
        steps, read = {*recording.steps, *cells}, recording.wrench
        if reference == 'recorded':
            read = recording.wrench - recording.reference
            with suppress(CalibrationRefusedError):
                (beside,), said = segment([replace(recording, wrench=read)], 'constant')
                steps.update(beside.steps)
                sentences += [sentence for sentence in said if 'A new segment' in sentence]
        wrench = recording.wrench.copy()
        for cell in steps.difference(recording.steps):
            before = at[np.searchsorted(at, cell) - 1]
            if (cell - before) * recording.period_s < _RESTART_S:  # a bin may lie on both sides
                wrench[cell:] -= np.nan_to_num(read[cell] - read[before])
        begun.append(replace(recording, wrench=wrench, steps=tuple(sorted(steps))))
        sentences += [
            f'{recording.name} goes on at {time_in(recording, cell)} after a pause, maybe '
            'with another zero. A new segment begins there, as after a tare.'
            for cell in cells
        ]
    return begun, sentences


def _unlike_drift(
    recording: Recording, model: DriftModel, at: IntArray, cells: Sequence[int]
) -> list[int]:
    """Choose the pauses, by the cells behind them, over which more changed than by slow drift."""
    _, drift = run_from_rest(model, recording.temperature_c)
    left = recording.wrench - np.nan_to_num(recording.reference) - drift.zero
    apart_s = recording.period_s * _cells_apart(at)
    minute = max(1, round(_MINUTE_S / apart_s))
    parts = np.split(left[at], np.searchsorted(at, cells))
    means = [mean_over(part, minute) for part in parts]
    chosen = list[int]()
    for k, cell in enumerate(cells):
        paused_s = (cell - at[np.searchsorted(at, cell) - 1]) * recording.period_s
        lag = max(1, round(paused_s / apart_s / minute))
        usual = [np.abs(part[lag:] - part[:-lag]) for part in means if len(part) > lag]
        usual += [np.ptp(part, axis=0)[np.newaxis] for part in means if len(part) <= lag]
        most = np.nanmax(np.concatenate(usual), axis=0, initial=0.0)
        before, after = parts[k][-minute:], parts[k + 1][:minute]
        change = mean_over(after, minute)[0] - mean_over(before, minute)[0]
        if (np.abs(change) > 2 * most).any():
            chosen.append(cell)
    return chosen


def false_starts(recordings: Sequence[Recording]) -> dict[int, str]:
    """
    Find recordings that are too short, where others are not; gives why, by their places.

    Held out beside days, a false start of seconds would judge what the others say.
    """
    lasted_s = list[float]()
    for recording in recordings:
        read = np.flatnonzero(np.isfinite(recording.wrench).any(axis=1))
        lasted_s.append(float(np.ptp(read) + 1) * recording.period_s if len(read) else 0.0)
    return {
        place: f'{recordings[place].name} was left out: its wrenches last {wrenches_s:.0f} s, and '
        f'drift can be learnt from {SHORTEST_SEGMENT_S:.0f} s or more. Record longer.'
        for place, wrenches_s in enumerate(lasted_s)
        if wrenches_s < SHORTEST_SEGMENT_S <= max(lasted_s)
    }


def _without_outliers(recording: Recording, reference: Reference) -> tuple[Recording, list[str]]:
    """
    Make readings NaN that stand out from the level of two minutes, and say so.

    What is shorter than half of that is no level, but a contact or a spike. Of a longer touch both
    ends are steps.
    """
    wrench, sentences, swings = recording.wrench.copy(), list[str](), list[str]()
    for axis in recording.axes_present:
        column = AXES.index(axis)
        at = np.flatnonzero(np.isfinite(recording.wrench[:, column]))
        apart_s = _cells_apart(at) * recording.period_s
        least = _LEVEL_SAMPLES if apart_s <= BESIDE_S / 2 else 3
        width = max(2 * round(BESIDE_S / 2 / apart_s) + 1, least)
        if len(at) < width:
            continue
        raw = recording.wrench[at, column]
        level = scipy.ndimage.median_filter(raw, width, mode='nearest')
        distance = np.abs(raw - level)
        above_noise = max(SMALLEST_SIGMA * _noise(raw), ROUNDING * np.abs(raw).max())
        outlying = distance > max(above_noise, _OUTLYING_SHARE * np.ptp(level))
        # A touch begins and ends at once, however small it is beside the drift; heat does not.
        touched = outlying.copy()
        for begin, end in runs_of(np.asarray(distance > above_noise)):
            begins = raw[min(begin + 1, end - 1)] - raw[max(begin - 1, 0)]
            ends = raw[max(end - 2, begin)] - raw[min(end, len(raw) - 1)]
            usual = SMALLEST_SIGMA * noise_level([raw[max(begin - width, 0) : end + width]])
            least = max(np.median(distance[begin:end]), usual) / 2
            touched[begin:end] |= min(abs(begins), abs(ends)) > least
        if touched.mean() <= MOST_LEFT_OUT:
            outlying = touched
        moving = MOVING[axis_unit(axis)]
        scatter = float(np.sqrt(np.mean(distance[~outlying] ** 2)))
        moves = np.diff(level)  # what jumps is a tare, and no drift
        drift = np.ptp(np.cumsum(np.where(np.abs(moves) < above_noise, moves, 0.0)))
        if scatter > max(moving, _STEP_SHARE * drift):
            swings.append(f'{axis} by {rounded(scatter, 2)} {axis_unit(axis)}')
        cells = at[outlying]
        if not len(cells):
            continue
        share, size = len(cells) / len(at), f'{rounded(float(distance.max()))} {axis_unit(axis)}'
        first = time_in(recording, cells[0])
        if share > MOST_LEFT_OUT and len(cells) > 1:
            raise CalibrationRefusedError(
                f'{axis} of {recording.name} moves by up to {size} for {100 * share:.0f} % '
                f'of the time, although the load was declared {reference}, first at {first}: the '
                'robot turned the sensor, whose own flange has a weight, or something touched it. '
                'Leave that out (--exclude), record again without, or record what makes it known: '
                'specific force (--reference payload), or the load (--reference recorded).'
            )
        wrench[cells, column] = np.nan
        sentences.append(
            f'{axis} of {recording.name} stands out by up to {size} for '
            f'{len(cells) * apart_s:.0f} s in all, first at {first}; left out.'
        )
    if swings:
        sentences.insert(
            0,
            f'{recording.name} swings around its levels of {BESIDE_S:.0f} s, RMS: '
            f'{", ".join(swings)}, although the load was declared {reference}. Did the robot '
            'move, or does something vibrate? Record again standing still, or with the specific '
            'force (--reference payload).',
        )
    return replace(recording, wrench=wrench), sentences


def _noise(values: FloatArray) -> float:
    """Estimate the noise of readings, at least that of their rounding; a constant has none."""
    values = values[np.isfinite(values)]
    moves = np.abs(np.diff(values))
    moves = moves[moves > ROUNDING * np.abs(values).max(initial=0.0)]
    return max(noise_level([values]), float(moves.min()) / np.sqrt(12)) if len(moves) else 0.0


def _cells_apart(at: IntArray) -> float:
    """Count how many cells readings usually are apart: temperatures may come more often."""
    return float(np.median(np.diff(at))) if len(at) > 1 else 1.0


def _steps_in_gaps(
    raw: FloatArray, at: IntArray, begins: Sequence[int], least: FloatArray, recording: Recording
) -> list[Step]:
    """
    Find steps across gaps, as of a driver that was started again and has another zero.

    In the gap, drift moves at up to twice the speed that it has in the two minutes beside. What is
    found is taken out of ``raw``, or the next gap would find it again.
    """
    steps, apart_s = list[Step](), _cells_apart(at) * recording.period_s
    beside = max(round(BESIDE_S / apart_s), _LEVEL_SAMPLES)
    for begin in begins:
        place = int(np.searchsorted(at, begin))
        before, after = at[max(place - beside, 0) : place], at[place : place + beside]
        gap = after[0] - before[-1]
        if len(before) < beside or len(after) < beside or gap * recording.period_s > _RESTART_S:
            continue
        slope, level = np.polyfit(before - before[-1], raw[before], 1)
        slope_after, level_after = np.polyfit(after - after[0], raw[after], 1)
        drift = 2 * gap * np.fmax(np.abs(slope), np.abs(slope_after))
        if (np.abs(level_after - level) > drift + least).any():
            steps.append(Step(begin, level_after - level))
            raw[begin:] -= level_after - level
    return steps


def _without_steps(recording: Recording, columns: list[int]) -> tuple[Recording, list[str]]:
    noise_of = np.array([_noise(values) for values in recording.wrench.T])
    columns = [column for column in columns if noise_of[column] > 0]
    noise = noise_of[columns]
    raw = recording.wrench[:, columns]
    counts = np.asarray(np.isfinite(raw).all(axis=1))
    if not columns or not counts.any():
        return recording, []
    at = np.flatnonzero(counts)
    widest = max(BESIDE_S / 4 / recording.period_s, _cells_apart(at))
    begins = [0, *at[1:][np.diff(at) > widest].tolist(), len(raw)]
    jumps, one_load = dict[int, FloatArray](), np.zeros(len(raw), dtype=np.int64)
    for _ in range(_ROUNDS):
        steps, smallest = list[Step](), _STEP_SHARE * (np.nanmax(raw, 0) - np.nanmin(raw, 0))
        for begin, end in pairwise(begins):
            part = raw[np.newaxis, begin:end], one_load[begin:end], counts[begin:end]
            steps += [
                replace(step, cell=begin + step.cell)
                for step in find_steps(*part, noise, recording.period_s)
                if step.certain and (abs(step.jump) > smallest).any()
            ]
        for step in steps:
            raw[step.cell :] -= step.jump
        least = smallest + SMALLEST_SIGMA * noise
        steps += _steps_in_gaps(raw, at, begins[1:-1], least, recording)
        for step in steps:
            jumps[step.cell] = jumps.get(step.cell, 0.0) + step.jump
        if not steps:
            break
    cells = sorted(cell for cell, jump in jumps.items() if (abs(jump) > smallest).any())
    if not cells:
        return recording, []
    # Of a touch one end counts.
    apart_s = np.diff(cells, prepend=0) * recording.period_s
    ends = [0, *np.array(cells)[apart_s > BESIDE_S].tolist(), len(recording)]
    lengths_s = np.diff(ends) * recording.period_s
    usable_s = lengths_s[lengths_s >= SHORTEST_SEGMENT_S].sum()
    if usable_s < recording.duration_s / 2 and len(ends) > 3:
        raise CalibrationRefusedError(
            f'{recording.name} steps {len(ends) - 2} times, from {time_in(recording, ends[1])} to '
            f'{time_in(recording, ends[-2])}, and only {usable_s:.0f} s of '
            f'{recording.duration_s:.0f} s are in segments of {SHORTEST_SEGMENT_S:.0f} s or '
            'more: too little to learn from. Record again without contacts and tares, or record '
            'the specific force (--reference payload).'
        )
    wrench, sentences = recording.wrench.copy(), list[str]()
    wrench[:, columns] = raw
    for cell in cells:
        sizes = ', '.join(
            f'{AXES[column]} by {rounded(jump)} {axis_unit(AXES[column])}'
            for column, jump, limit in zip(columns, jumps[cell].tolist(), smallest, strict=True)
            if abs(jump) > limit
        )
        sentences.append(
            f'{recording.name} steps at {time_in(recording, cell)}: {sizes}. A new segment '
            'begins there, as after a tare.'
        )
    return replace(recording, wrench=wrench, steps=(*recording.steps, *cells)), sentences
