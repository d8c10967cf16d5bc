"""The view of a calibration: held-out errors, what was chosen, what to record next."""

from collections.abc import Mapping, Sequence

import numpy as np

from wrist_ft_comp.drift.drift_model import StoredModel
from wrist_ft_comp.fit.result import AxisFit, Calibration, HeldOut, rms_by_fold
from wrist_ft_comp.payload.gains import COUNTS
from wrist_ft_comp.recordings.chamber import ChamberFigures
from wrist_ft_comp.report.advice import what_to_record_next
from wrist_ft_comp.report.coverage import cover
from wrist_ft_comp.report.evaluation import AxisEvaluation
from wrist_ft_comp.report.verdict import Evidence, Level
from wrist_ft_comp.report.view import (
    axis_view,
    ErrorSeries,
    recording_starts_h,
    ReportView,
    WorkView,
)
from wrist_ft_comp.signals import IntArray, noise_level, Recording, Reference

#: A recording is hard when the others leave this many times as much of it as usual.
_HARD = 1.5
#: Shares of what counted at work are of so long, h.
_BIN_H = 1 / 12


def calibration_view(
    calibration: Calibration,
    recordings: Sequence[Recording],
    stored: StoredModel,
    reference: Reference,
    tables: Mapping[str, Mapping[str, ChamberFigures]] | None = None,
) -> ReportView:
    """Fill a report's view; figures of chamber tables go by name, then by title."""
    fits = calibration.fits
    work = calibration.separation
    # At work, what a payload weighs is the load that was known.
    coverage = cover(recordings if work is None else work.drift)
    durations_s = [recording.duration_s for recording in recordings]
    axes = []
    for axis, fit in fits.items():
        series = _series(_held_out(fit), recordings, coverage.leading)
        before, after = (float(np.abs(each).max()) for each in (series.before, series.after))
        errors = AxisEvaluation(fit.rms_before, fit.rms_after, before, _widening(fit) * after)
        axes.append(axis_view(stored, axis, _evidence(fit, max(durations_s)), errors, series))
    # An axis that was refused drifts, and is explained no better than a weak one.
    levels: dict[str, Level] = {
        each.axis: 'weak' if fits[each.axis].refusal else each.verdict.level for each in axes
    }
    slowest_s = max(map(_slowest_s, fits.values()), default=0.0)
    chamber = not all(_held_out(fit).tared for fit in fits.values())
    known = coverage, levels, reference, durations_s, slowest_s
    advice = what_to_record_next(*known, chamber=chamber)
    # Refusals are verdicts here.
    refusals = tuple(fit.refusal for fit in fits.values() if fit.refusal)
    return ReportView(
        kind='calibration', stored=stored, recordings=recordings, coverage=coverage,
        explanation=_explanation(calibration, recordings, reference), axes=tuple(axes),
        advice=(*_hardest_day(fits, recordings), *advice),
        warnings=tuple(each for each in calibration.warnings if not each.startswith(refusals)),
        tables=tables or {}, work=_work_view(calibration))  # fmt: skip


def _held_out(fit: AxisFit) -> HeldOut:
    """Return the errors that every identified axis carries."""
    assert fit.held_out is not None  # noqa: S101 -- identify_axis always keeps them
    return fit.held_out


def _widening(fit: AxisFit) -> float:
    """Say how many times as much is stated to be left as was of the folds that were held out."""
    held_out = _held_out(fit)
    measured = float(rms_by_fold(held_out).after.mean())
    whole = not held_out.tared or held_out.recording.any()
    return 1.0 if whole or measured == 0 else fit.rms_after / measured


def _hardest_day(fits: Mapping[str, AxisFit], recordings: Sequence[Recording]) -> list[str]:
    """Name the recording that the others predict worst: what is like it was seen too little."""
    if len(recordings) < 3:
        return []
    after = {axis: rms_by_fold(_held_out(fit)).after for axis, fit in fits.items() if fit.model}
    whole = [each / max(each.mean(), 1e-300) for each in after.values() if len(each) > 2]
    share = np.mean([each for each in whole if len(each) == len(recordings)] or [[0.0]], axis=0)
    if share.max() < _HARD * np.median(share):
        return []
    hardest = int(np.argmax(share))
    axis = max(after, key=lambda each: after[each][hardest] / max(fits[each].rms_before, 1e-300))
    unit = fits[axis].unit
    sentence = (
        f'{recordings[hardest].name} is predicted worst by the others: {after[axis][hardest]:.3g} '
        f'{unit} of {axis} are left, in the mean of all {after[axis].mean():.3g} {unit}. Another '
        'day like it would help most.'
    )
    return [sentence]


def _parts(held_out: HeldOut) -> IntArray:
    """Give every fold of every recording a number, shape (n,)."""
    return np.asarray(held_out.recording * (held_out.fold.max() + 1) + held_out.fold)


def _slowest_s(fit: AxisFit) -> float:
    """Find the slowest time constant that was searched, s; those of a bank are given."""
    pairs = zip(fit.time_constants_s, fit.time_constant_errors_s, strict=True)
    return max((tau for tau, error in pairs if np.isfinite(error)), default=0.0)


def _evidence(fit: AxisFit, longest_s: float) -> Evidence:
    """Collect what is known about one axis."""
    held_out = _held_out(fit)
    parts = _parts(held_out)
    tried = [candidate.rms for candidate in fit.candidates if candidate.name != 'none']
    return Evidence(
        unit=fit.unit, before=fit.rms_before, after=fit.rms_after,
        noise=noise_level([held_out.after[parts == part] for part in np.unique(parts)]),
        widening=_widening(fit), compensated=fit.model is not None,
        best_candidate=min(tried, default=None), blocks=rms_by_fold(held_out),
        recordings=len(np.unique(held_out.recording)) if held_out.tared else 0,
        slowest_s=_slowest_s(fit), longest_s=longest_s, refusal=fit.refusal)  # fmt: skip


def _series(held_out: HeldOut, recordings: Sequence[Recording], leading: int) -> ErrorSeries:
    """Lay held-out errors out over time and temperature."""
    starts = recording_starts_h(recordings)
    period_h = recordings[0].period_s / 3600
    temperature_c = [
        recordings[number].temperature_c[round(cell), leading]
        for number, cell in zip(held_out.recording, held_out.cell, strict=True)
    ]
    hours = starts[held_out.recording] + (held_out.cell + 0.5) * period_h
    errors = held_out.before, held_out.after
    return ErrorSeries(hours, np.array(temperature_c), *errors, _parts(held_out))


def _explanation(
    calibration: Calibration, recordings: Sequence[Recording], reference: Reference
) -> str:
    """Say what was held out, and from where errors are counted."""
    fits = calibration.fits.values()
    first = _held_out(next(iter(fits)))
    count, widened = len(np.unique(first.fold)), ''
    if len(recordings) > 1:
        blocks = f'Each of the {count} recordings was held out in turn'
        zero = 'its first minute'
    elif first.tared:
        minutes = recordings[0].duration_s / count / 60
        blocks = (
            f'The recording was cut into {count} blocks of {minutes:.0f} min, and each was held '
            'out in turn'
        )
        zero = 'its first minute'
        factors = [_widening(fit) for fit in fits]
        widened = (
            f' What is left is stated {min(factors):.1f} to {max(factors):.1f} times as large as '
            'it was (see the pictures), because drift goes further in a day than in a block.'
        )
    else:
        blocks = f'Each of the {count} plateaus was held out in turn'
        zero = 'the mean of the other plateaus'
    tared = ': as after a tare' if first.tared else ''
    return (
        f'{blocks}: a model that was fitted to the others ran on its temperatures alone. Errors '
        f'are means over {first.bin_s:g} s, counted from {zero}, with compensation and '
        f'without{tared}.{widened} Reference: {reference}.'
    )


def _work_view(calibration: Calibration) -> WorkView | None:
    """Collect payloads, directions and what counted; None where nothing was learnt at work."""
    separation = calibration.separation
    if separation is None:
        return None
    recordings, counts = separation.recordings, separation.fit.weights > COUNTS
    counted = separation.cells.join(counts)
    pushed = separation.cells.join(separation.cells.usable & ~counts)
    rows = []
    for i, start_h in enumerate(recording_starts_h(recordings)):
        bins = (recordings[i].elapsed_s / 3600 // _BIN_H).astype(np.int64)
        cells = np.maximum(np.bincount(bins), 1)
        shares = [np.bincount(bins, each[i]) / cells for each in (counted, pushed)]
        middles = start_h + (np.arange(len(cells)) + 0.5) * _BIN_H
        rows.append(np.stack((middles, np.full(len(cells), float(i)), *shares)))
    hours, part, used, contact = np.concatenate(rows, axis=1)
    forces = np.concatenate(separation.accelerometer.forces)[np.concatenate(counted)]
    directions = forces / np.linalg.norm(forces, axis=1, keepdims=True)
    return WorkView(
        calibration.payloads, directions, hours, part.astype(np.int64), used, contact,
        sum(map(len, separation.steps)),
    )  # fmt: skip
