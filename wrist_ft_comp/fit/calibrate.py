"""A calibration from recordings to a model and its evidence, and its summary in a few lines."""

from collections import ChainMap
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrist_ft_comp.drift.drift_model import differences, DriftModel
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit import data_checks
from wrist_ft_comp.fit.arx_pls_oe import identify_lags
from wrist_ft_comp.fit.auto import identify_auto
from wrist_ft_comp.fit.axis_data import AxisData, build_axis_data
from wrist_ft_comp.fit.day_limit import day_limit, largest_drift
from wrist_ft_comp.fit.folds import assign_folds
from wrist_ft_comp.fit.paper_methods import identify_hats, identify_paper_method
from wrist_ft_comp.fit.result import AxisFit, Calibration, SURE_SHARE
from wrist_ft_comp.fit.segments import segment
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.fit.thermometer_prediction import predict_each_other
from wrist_ft_comp.payload.doubts import follows_gravity
from wrist_ft_comp.payload.learn_at_work import learn_at_work
from wrist_ft_comp.signals import AXES, IntArray, Progress, Recording

#: A start takes the mean temperatures of this time: long enough for the noise of a thermometer,
#: short for a thermal body, s.
_START_S = 10.0


def calibrate(
    recordings: Sequence[Recording],
    settings: CalibrationSettings | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """
    Learn the drift of every axis that was recorded.

    Parameters
    ----------
    recordings : sequence of Recording
        On the same thermal grid, with the same thermometers, each with its own unknown offset.
    settings : CalibrationSettings, optional
        What a person chose.
    progress : callable, optional
        Called with the share that is done, 0 to 1.

    Returns
    -------
    Calibration
        The model and its evidence.

    Raises
    ------
    CalibrationRefusedError
        When the recordings do not allow a trustworthy fit; the sentence says what to do.
    TooShortError
        When an ARX does not find enough consecutive samples.

    """
    settings = settings or CalibrationSettings()
    data_checks.check_alike(recordings)
    ranges = data_checks.check_temperatures(recordings, settings.min_temperature_span_k)
    axes = [
        axis for axis in AXES if any(axis in recording.axes_present for recording in recordings)
    ]
    if not axes:
        names = ', '.join(recording.name for recording in recordings)
        raise CalibrationRefusedError(
            f'{names} holds no wrench on the thermal cells that have a temperature. '
            'Record wrench and temperature at the same time.'
        )
    silent = data_checks.missing_wrenches(recordings, settings.max_gap_s)
    recordings, unknown = data_checks.drop_unknown_temperatures(recordings, settings.max_gap_s)
    data_checks.check_reference(recordings, settings.reference)
    recordings, dropped = data_checks.drop_stuck_cells(recordings, axes)
    recordings, stepped = segment(recordings, settings.reference)
    folds = assign_folds(recordings)
    progress = progress or (lambda _: None)
    if settings.reference == 'payload':
        work = learn_at_work(recordings)
        _, model, _ = _learn(work.drift, axes, folds, settings, lambda _: None)
        # With a model, drift is separated from payloads better: so once more.
        work = learn_at_work(recordings, (work, model))
        fits, model, skipped = _learn(work.drift, axes, folds, settings, progress)
    else:
        work = None
        fits, model, skipped = _learn(recordings, axes, folds, settings, progress)
    sensors = {
        f'in recording {number}, {recording.name}': recording.sensor
        for number, recording in enumerate(recordings, 1)
    }
    apart = differences(sensors)
    warnings = [
        *(warning for recording in recordings for warning in recording.warnings),
        *([f'Recordings of several sensors: {apart}. Calibrate every one alone.'] * bool(apart)),
        *dropped,
        *stepped,
        *skipped,
        *unknown,
        *silent,
        *(
            f'{jump} Its readings there count for the range and the model; record again, or leave '
            'that part out.'
            for jump in data_checks.jumping_thermometers(recordings)
        ),
        *data_checks.idle_thermometers(recordings),
        *data_checks.small_spans(recordings, settings.min_temperature_span_k),
        *(follows_gravity(recordings, settings.reference) if not settings.moves else ()),
        *(work.warnings if work else ()),
        *_doubts(recordings, fits),
    ]
    return Calibration(
        model=model, fits=fits, temperature_range_c=ranges,
        duration_s=sum(recording.duration_s for recording in recordings),
        warnings=tuple(warnings), sources=tuple(recording.name for recording in recordings),
        settings=settings, payloads=work.payloads if work else None,
        separation=work.separation if work else None,
        sensor=ChainMap(*map(dict, sensors.values())))  # fmt: skip


def _learn(
    recordings: Sequence[Recording],
    axes: Sequence[str],
    folds: Sequence[IntArray],
    settings: CalibrationSettings,
    progress: Progress,
) -> tuple[dict[str, AxisFit], DriftModel, list[str]]:
    """Learn some axes, and say which are left out; CalibrationRefusedError where all are."""
    fits, skipped = dict[str, AxisFit](), list[str]()
    for number, axis in enumerate(axes, 1):
        data = build_axis_data(recordings, axis, settings.reference, folds)
        if data.samples < data_checks.MIN_SAMPLES or len(data.fold_numbers) < 2:
            skipped.append(
                f'{axis} has {data.samples} thermal cells with both wrench and reference; at '
                f'least {data_checks.MIN_SAMPLES} in 2 blocks are needed. Record longer.'
            )
            continue
        if data.recordings == 1 < len(recordings):
            skipped.append(
                f'{axis} is in one of {len(recordings)} recordings only, and is learnt from that.'
            )
        fit = identify_axis(data, settings.identification)
        if data.tared:
            limit = day_limit(data, fit.stated_rms)
            fit = replace(fit, largest_drift=largest_drift(data), day_limit=limit)
        fits[axis] = fit
        progress(number / len(axes))
    if not fits:
        raise CalibrationRefusedError(skipped[0])
    refusals = [fit.refusal for fit in fits.values() if fit.refusal]
    if refusals and all(fit.model is None for fit in fits.values()):
        raise CalibrationRefusedError(f'{refusals[0]}.')
    predicted = predict_each_other(recordings, folds) if data.tared else None
    model = DriftModel(
        period_ns=recordings[0].period_ns, thermometers=recordings[0].thermometers,
        axes={axis: fit.model for axis, fit in fits.items() if fit.model is not None},
        deviation={axis: fit.stated_rms for axis, fit in fits.items()},
        day_limits={
            axis: fit.day_limit for axis, fit in fits.items() if np.isfinite(fit.day_limit)
        },
        start_s=_START_S, prediction=predicted)  # fmt: skip
    return fits, model, skipped


def identify_axis(data: AxisData, settings: IdentificationSettings) -> AxisFit:
    """Identify one axis by the method that was chosen."""
    if settings.method == 'auto' and settings.features == 'powers' and data.tared:
        return identify_auto(data, settings)
    if settings.method == 'auto':
        return identify_hats(data, settings)
    if settings.method == 'arx_pls_oe':
        return identify_lags(data, settings)
    return identify_paper_method(data, settings, settings.method)


def _doubts(recordings: Sequence[Recording], fits: dict[str, AxisFit]) -> list[str]:
    """Say what a person should doubt in the fits, in sentences."""
    doubts = []
    longest_s = max(recording.duration_s for recording in recordings)
    searched = [
        (tau, axis)
        for axis, fit in fits.items()
        for tau, error in zip(fit.time_constants_s, fit.time_constant_errors_s, strict=True)
        if np.isfinite(error)
    ]
    slowest_s, axis = max(searched, default=(0.0, ''))
    if slowest_s > SURE_SHARE * longest_s:
        doubts.append(
            f'The slowest time constant, {slowest_s:.0f} s of {axis}, is more than half of the '
            f'longest recording ({longest_s:.0f} s); record at least '
            f'{4 * slowest_s / 3600:.1f} h to be sure of it.'
        )
    doubts += [f'{fit.refusal}. It is left uncompensated.' for fit in fits.values() if fit.refusal]
    return doubts + [
        f'{axis}: {fit.chosen} leaves more drift than no compensation; choose the method auto.'
        for axis, fit in fits.items()
        if fit.harmful
    ]


def summarise(calibration: Calibration) -> str:
    """Say what was learnt: a line per axis and payload, one on the recordings, the warnings."""
    lines = [_axis_line(axis, fit) for axis, fit in calibration.fits.items()]
    ranges = ', '.join(f'{low:.1f} to {high:.1f}' for low, high in calibration.temperature_range_c)
    lines += calibration.payloads.lines() if calibration.payloads else []
    lines += calibration.acceptance
    lines.append(f'learnt from {calibration.duration_s / 3600:.2f} h at {ranges} °C')
    lines += [f'warning: {warning}' for warning in calibration.warnings]
    return '\n'.join(lines)


def _axis_line(axis: str, fit: AxisFit) -> str:
    if fit.model is None:
        return f'{axis}: no compensation; drift held out {fit.rms_before:.3g} {fit.unit} RMS'
    drifts = 'zero and sensitivity' if fit.model.outputs == 2 else 'zero'
    # A method that a person named is kept although it may do harm; it must not do so silently.
    harm = ': WORSE THAN NONE' if fit.harmful else ''
    return (
        f'{axis}: {fit.rms_before:.3g} -> {fit.rms_after:.3g} {fit.unit} RMS held out '
        f'({drifts}; {fit.chosen}){harm}'
    )
