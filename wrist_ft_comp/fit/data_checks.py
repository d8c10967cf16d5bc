"""Whether recordings can be calibrated from: refusals with numbers and a remedy."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
import math

import numpy as np

from wrist_ft_comp.channels import AXES, axis_unit
from wrist_ft_comp.drift.drift_model import LEAST_RANGE_K, order_problem
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.axis_data import MIN_SAMPLES
from wrist_ft_comp.fit.chamber_test import find_plateaus
from wrist_ft_comp.fit.folds import mean_over
from wrist_ft_comp.recording import elapsed_s, Recording, Reference, time_in
from wrist_ft_comp.series import BoolArray, differ, FloatArray, noise_level
from wrist_ft_comp.stream.failed_thermometers import stands_s
from wrist_ft_comp.stream.temperature_jumps import FASTEST_K_S, JUMP_K_S, jumps

#: Recordings of one hour, perhaps of other samples of it, differ in means over this time, s, by
#: less than their noise; in temperatures by that or by this, K. Those of two days differ by more.
_COMPARED_S, _EQUAL_K = 60.0, 0.02
#: Share that counts as nearly all: of the cells of two recordings of one day that are equal, since
#: rounded stamps move a few samples to the next cell; and of the neighbouring cells that differ in
#: a channel that measures.
_NEARLY_ALL = 0.9
#: A channel that measures is stuck where it keeps a value for this many samples; a thermometer is
#: silent where it misses as many of its usual ones. Where a tenth of the neighbours are equal by
#: chance, ten in a row are never.
_SEVERAL = 10
#: A thermometer is silent for long from this time on, s: the drift of that time is a guess.
LONG_SILENCE_S = 600.0
#: A node leaves out what jumped by 40 K for less than this, s, and believes it then.
_DROPPED_S = 200.0
#: A thermometer that stands still for this many times as long as ever else is frozen.
_STANDS = 3
#: Of a channel up to this share may be left out; with more, something is wrong with it.
MOST_LEFT_OUT = 0.05
#: Recordings without what cannot be learnt from, and sentences that say what that was.
Cleaned = tuple[list[Recording], list[str]]


def check_recordings(
    recordings: Sequence[Recording], reference: Reference, min_span_k: float
) -> FloatArray:
    """Refuse recordings of which nothing can be learnt; give ranges of temperature, °C, (J, 2)."""
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
    for one, other in combinations(recordings, 2):
        # By their stamps, or, where these are others, from the first or to the last ones on.
        shifts = {0, len(one) - len(other), other.first_cell - one.first_cell}
        if any(_are_equal(one, other, shift) for shift in shifts):
            raise CalibrationRefusedError(
                f'{other.name} holds readings of {one.name}: it is the same day, or a part of '
                'it, in another form. Name one of them only.'
            )
    names = ', '.join(recording.name for recording in recordings)
    everything = np.concatenate([recording.temperature_c for recording in recordings])
    span_k = float(np.ptp(everything, axis=0).max())
    within_k = max(float(np.ptp(r.temperature_c, axis=0).max()) for r in recordings)
    needs_within = reference in {'unloaded', 'constant'}  # gains can be learnt from files apart
    if span_k < min_span_k or (needs_within and within_k < min_span_k / 3):
        raise CalibrationRefusedError(
            f'Temperature in {names} spans {span_k:.1f} K, and {within_k:.1f} K at most within a '
            f'recording, whose zero is its own; at least {min_span_k:.1f} K and a third of it are '
            'needed. Record a warm-up from cold.'
        )
    if not any(recording.axes_present for recording in recordings):
        raise CalibrationRefusedError(
            f'{names} holds no wrench on the thermal cells that have a temperature. '
            'Record wrench and temperature at the same time.'
        )
    for recording in recordings:
        if reference == 'recorded' and not np.isfinite(recording.reference).any():
            raise CalibrationRefusedError(
                f'{recording.name} holds no reference wrench, but the reference was declared '
                'recorded. Record wrench_reference beside the raw wrench, or declare the '
                'reference unloaded or constant.'
            )
    # Temperatures at which no wrench came are not learnt.
    read = [np.isfinite(recording.wrench).any(axis=1) for recording in recordings]
    learnt_c = everything[np.concatenate(read)]
    return np.stack((learnt_c.min(axis=0), learnt_c.max(axis=0)), axis=1)


def _are_equal(one: Recording, other: Recording, shift: int) -> bool:
    """Whether two read the same, up to noise, which never repeats, if one begins cells later."""
    begin, end = max(shift, 0), min(len(one), len(other) + shift)
    # What stands still looks the same on all days, as before a start that was broken off.
    moved_k = np.ptp(one.temperature_c[begin:end], axis=0) if end - begin >= MIN_SAMPLES else 0.0
    if np.max(moved_k) < LEAST_RANGE_K:
        return False
    shares, cells = [], max(round(_COMPARED_S / one.period_s), 1)
    parts = (one, begin), (other, begin - shift)
    read = [
        np.hstack((r.temperature_c, r.wrench - np.nan_to_num(r.reference)))[at : at + end - begin]
        for r, at in parts
    ]
    for column, (ours, theirs) in enumerate(zip(*(values.T for values in read), strict=True)):
        # A motion that a load makes passes for noise, and repeats itself; temperatures never do.
        least = _EQUAL_K if column < one.thermometers else 0.0
        # An export may be rounded, which moves means by half of a step.
        moves = [np.abs(np.diff(values[np.isfinite(values)])) for values in (ours, theirs)]
        steps = [float(np.median(moved[moved > 0])) for moved in moves if moved.any()]
        if near := max(noise_level((ours, theirs)), least, *(step / 2 for step in steps)):
            both = np.isfinite(ours - theirs).sum()
            apart = mean_over(ours - theirs, cells)
            apart = apart[np.isfinite(apart)]
            if column >= one.thermometers and len(apart):  # one of them may be tared
                apart -= np.median(apart)
            # An export may be thinner.
            fewer = min(np.isfinite(values).sum() for values in (ours, theirs))
            shares.append(
                (np.abs(apart) <= near).mean() * both / fewer if both >= MIN_SAMPLES else 0.0
            )
    return len(shares) > one.thermometers and bool(min(shares) > _NEARLY_ALL)


def drop_stuck_cells(recordings: Sequence[Recording]) -> Cleaned:
    """
    Make cells in which a raw wrench is stuck NaN, and say so.

    An axis that is stuck throughout is left out: nothing is known of its drift. One that is stuck
    for long is left out of its recording. CalibrationRefusedError where no axis is left.
    """
    wrenches = [recording.wrench.copy() for recording in recordings]
    sentences, stuck = list[str](), list[str]()
    for column, axis in enumerate(AXES):
        series = [recording.wrench[:, column] for recording in recordings]
        finite = [values[np.isfinite(values)] for values in series]
        read = [values for values in finite if len(values)]
        if not any(differ(values, values[0]).any() for values in read):
            if read:
                sentences.append(
                    f'{axis} reads {read[0][0]:.6g} {axis_unit(axis)} throughout: the channel is '
                    'dead, or not connected. It is left uncompensated.'
                )
                for wrench in wrenches:
                    wrench[:, column] = np.nan
            continue
        for i, (recording, cells) in enumerate(zip(recordings, _find_stuck(series), strict=True)):
            if not cells.any():
                continue
            share = float(cells.sum()) / len(finite[i])
            kept, counts = np.unique(series[i][cells], return_counts=True)
            value = float(kept[np.argmax(counts)])
            extremes = np.array([finite[i].min(), finite[i].max()])
            verb = 'freezes' if differ(extremes, value).all() else 'saturates'
            what = (
                f'{axis} of {recording.name} {verb} at {value:.6g} {axis_unit(axis)}: '
                f'{cells.sum() * recording.period_s:.0f} s ({100 * share:.1f} %) without any '
                f'change, first at {time_in(recording, int(np.argmax(cells)))}'
            )
            if share > MOST_LEFT_OUT:
                stuck.append(what)
                sentences.append(f'{what}; {axis} is left out of that recording.')
                wrenches[i][:, column] = np.nan
            else:
                sentences.append(f'{what}; left out.')
                wrenches[i][cells, column] = np.nan
    if not any(np.isfinite(wrench).any() for wrench in wrenches):
        if stuck:
            raise CalibrationRefusedError(
                f'{stuck[0]}; up to {100 * MOST_LEFT_OUT:.0f} % can be left out. Check the range '
                'and the driver of the sensor, and record again.'
            )
        names = ', '.join(recording.name for recording in recordings)
        raise CalibrationRefusedError(
            f'Every axis of {names} keeps one value throughout, so the sensor does not measure. '
            'Check that it streams, and record again.'
        )
    pairs = zip(recordings, wrenches, strict=True)
    return [replace(recording, wrench=wrench) for recording, wrench in pairs], sentences


def _find_stuck(series: Sequence[FloatArray]) -> list[BoolArray]:
    """Mark where a channel that changes nearly always, in some series, keeps a value, (N_i,)."""
    marked, lively = list[BoolArray](), False
    for values in series:
        at = np.flatnonzero(np.isfinite(values))
        starts = np.flatnonzero(np.append(True, differ(values[at[1:]], values[at[:-1]])))
        lengths = np.diff(starts, append=len(at))
        stuck = np.zeros(len(values), dtype=bool)
        stuck[at[np.repeat(lengths >= _SEVERAL, lengths)]] = True
        marked.append(stuck)
        # Stuck cells do not count where it is asked how often the reading changes.
        free = values[at[~stuck[at]]]
        if len(free) > 1 and differ(free[1:], free[:-1]).mean() >= _NEARLY_ALL:
            lively = True
    return marked if lively else [np.zeros_like(stuck) for stuck in marked]


def drop_unknown_temperatures(recordings: Sequence[Recording]) -> Cleaned:
    """
    Make wrenches NaN while a thermometer is silent or frozen for long, and say so.

    CalibrationRefusedError where that is most of a recording.
    """
    sound, sentences = list[Recording](), list[str]()
    reported_c = [np.where(one.measured, one.temperature_c, np.nan).T for one in recordings]
    for recording, own_c in zip(recordings, reported_c, strict=True):
        wrench = recording.wrench.copy()
        # A coarse thermometer may keep a value by itself for as long as none moves.
        others_moved = np.ptp(recording.temperature_c, axis=0).max() > LEAST_RANGE_K
        asked_c = reported_c if others_moved else [own_c]
        for j, measured in enumerate(recording.measured.T):
            frozen, *_ = _find_stuck([own_c[j], *(of_one[j] for of_one in asked_c)])
            begin, end, moved_k = _long_stand(recording, j)
            if moved_k and measured[end:].any():
                frozen[begin:end] = True
            runs, what = _unknown(recording, j, ~measured | frozen)
            for first, last in runs:
                wrench[first:last] = np.nan
            if np.isfinite(wrench).sum() < np.isfinite(recording.wrench).sum() / 2:
                raise CalibrationRefusedError(
                    f'{what}: its temperature is unknown for most of the wrenches. Leave that '
                    'recording out, or that thermometer: name the others by --temperature-topic, '
                    'or give its column another name.'
                )
            if runs:
                sentences.append(f'{what}; wrenches of that time are not learnt from.')
        sound.append(replace(recording, wrench=wrench))
    return sound, sentences


def _long_stand(recording: Recording, j: int) -> tuple[int, int, float]:
    """
    Find the cells in which a thermometer kept a value far longer than ever else, if it did.

    Gives how far it moved after it, too, K, or, where it keeps the value to the end, how far the
    others moved it in that time, by what they did before. A healthy one leaves its value by one
    step of its resolution: what is less than that and LEAST_RANGE_K counts as none.
    """
    at = np.flatnonzero(recording.measured[:, j])
    read_c = recording.temperature_c[at, j]
    stands = stands_s(read_c, 1.0).astype(int)
    # One that never moves is named by idle_thermometers.
    if len(stands) < 2 or stands.max() <= _STANDS * np.sort(stands)[-2]:
        return 0, 0, 0.0
    end = stands.cumsum()[stands.argmax()]
    begin = end - stands.max()
    if end < len(at):
        moved_k = abs(read_c[end] - read_c[end - 1])
    else:
        others = np.insert(np.delete(recording.temperature_c[at], j, axis=1), 0, 1.0, axis=1)
        slopes = np.linalg.lstsq(others[:begin], read_c[:begin], rcond=None)[0]
        moved_k = np.ptp(others[begin:] @ slopes)
    steps_k = np.abs(np.diff(read_c))
    is_long = (at[end - 1] - at[begin]) * recording.period_s > LONG_SILENCE_S
    is_odd = is_long and moved_k > LEAST_RANGE_K + 2 * steps_k[steps_k > 0].min()
    return int(at[begin]), int(at[end - 1]) + 1, float(moved_k * is_odd)


def frozen_at_the_end(recordings: Sequence[Recording]) -> Iterator[str]:
    """Doubt thermometers that keep a value to the end, while the others say that they moved."""
    for recording in recordings:
        for j in range(recording.thermometers):
            begin, end, moved_k = _long_stand(recording, j)
            if moved_k and not recording.measured[end:, j].any():
                yield (
                    f'Thermometer {j + 1} of {recording.name} keeps one value from '
                    f'{time_in(recording, begin)} to the end, while it moved by {moved_k:.1f} K '
                    'by what the others read: is it frozen? Then leave that time out (--until).'
                )


def _unknown(recording: Recording, j: int, absent: BoolArray) -> tuple[list[tuple[int, int]], str]:
    """Find where a thermometer is missing for long while wrenches come; say the longest."""
    # One that always reports seldom is not silent in between.
    reports = np.flatnonzero(recording.measured[:, j])
    usual = np.median(np.diff(reports)) if len(reports) > 1 else 0.0
    longest = max(LONG_SILENCE_S / recording.period_s, _SEVERAL * usual)
    present: BoolArray = np.asarray(np.isfinite(recording.wrench).any(axis=1))
    runs = []
    steps_k = np.abs(np.diff(recording.temperature_c[reports, j]))
    resolution_k = steps_k[steps_k > 0].min(initial=np.inf)
    for first, last in runs_of(absent):
        at = first + np.flatnonzero(present[first:last])
        # One that reports on change stood still, if the next report is a step of its resolution.
        after = np.searchsorted(reports, last)
        is_silent = not recording.measured[first:last, j].any() and 0 < after < len(reports)
        if is_silent and steps_k[after - 1] <= 2 * resolution_k:
            continue
        if len(at) and at[-1] + 1 - at[0] > longest:
            runs.append((int(at[0]), int(at[-1]) + 1))
    if not runs:
        return [], ''
    runs.sort(key=lambda run: run[0] - run[1])  # the longest first
    first, last = runs[0]
    verb = 'keeps one value' if recording.measured[first:last, j].any() else 'is silent'
    return runs, (
        f'Thermometer {j + 1} of {recording.name} {verb} for '
        f'{(last - first) * recording.period_s:.0f} s, from {time_in(recording, first)} on'
    )


def runs_of(marked: BoolArray) -> list[list[int]]:
    """List begin and end of every run of marked values, (n,)."""
    return np.flatnonzero(np.diff(np.pad(marked, 1).astype(int))).reshape(-1, 2).tolist()


def silent_stretches(recording: Recording) -> Iterator[str]:
    """Name thermometers that are silent for long, and a pause of everything."""
    yield from pauses([recording])
    for j, measured in enumerate(recording.measured.T):
        runs, what = _unknown(recording, j, ~measured)
        if runs:
            begin_s, end_s = (elapsed_s(recording, cell) for cell in runs[0])
            held = not measured[runs[0][1] :].any()
            how = 'its last reading was held' if held else 'a straight line was drawn over it'
            yield (
                f'{what}; {how}, and the drift of that time is a guess. Leave that time out: '
                f'--exclude {math.floor(begin_s)}..{math.ceil(end_s)}.'
            )


def pauses(recordings: Sequence[Recording]) -> Iterator[str]:
    """Name the longest pause of each recording in which nothing came for long."""
    for recording in recordings:
        came = recording.measured.any(axis=1) | np.isfinite(recording.wrench).any(axis=1)
        silent = ((last - first, first) for first, last in runs_of(np.asarray(~came)))
        cells, first = max(silent, default=(0, 0))
        if cells * recording.period_s > LONG_SILENCE_S:
            yield (
                f'Nothing of {recording.name} came for {cells * recording.period_s:.0f} s, from '
                f'{time_in(recording, first)} on. Temperatures are taken to have moved on a '
                'straight line, and the drift after it is uncertain. If a clock was set there, '
                'such as to summer time, correct the times; else record without a pause.'
            )


def jumping_thermometers(recordings: Sequence[Recording]) -> Iterator[str]:
    """Name thermometers that step faster than metal can, as the running node does."""
    for recording in recordings if find_plateaus(recordings) is None else ():
        for j in range(recording.thermometers):
            at = np.flatnonzero(recording.measured[:, j])
            steps_k = np.diff(recording.temperature_c[at, j])
            # After zeros of one that slept, a node drops readings until metal could do it.
            took_s = np.diff(at) * recording.period_s
            fastest_k_s = np.where(took_s < _DROPPED_S, 2 * FASTEST_K_S, JUMP_K_S)
            jumped = np.flatnonzero(jumps(steps_k, took_s, fastest_k_s))
            if len(jumped):
                when = time_in(recording, at[jumped[0] + 1])
                yield (
                    f'Thermometer {j + 1} of {recording.name} jumps faster than metal can: by '
                    f'{steps_k[jumped[0]]:.1f} K at {when}, first of {len(jumped)}. Is it loose?'
                )


def idle_thermometers(recordings: Sequence[Recording]) -> Iterator[str]:
    """Name thermometers that stand still throughout a recording."""
    for j in range(recordings[0].thermometers):
        still = [r for r in recordings if not differ(c := r.temperature_c[:, j], c[0]).any()]
        if still:
            yield (
                f'Thermometer {j + 1} reads {still[0].temperature_c[0, j]:.1f} °C all the time in '
                f'{", ".join(recording.name for recording in still)}. Check its topic.'
            )
