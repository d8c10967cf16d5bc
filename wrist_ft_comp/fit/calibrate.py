"""
A calibration: recordings are checked and cut into segments, and every axis is learnt and judged.

This is the story; what each step decides is in the file that it is named after.
"""

from collections import ChainMap
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.drift_model import differences, DriftModel
from wrist_ft_comp.errors import CalibrationRefusedError, WristFtCompError
from wrist_ft_comp.fit import data_checks as checks
from wrist_ft_comp.fit.auto_method import identify_auto
from wrist_ft_comp.fit.axis_data import BIN_S, build_axis_data, MIN_SAMPLES
from wrist_ft_comp.fit.chamber_test import find_plateaus
from wrist_ft_comp.fit.folds import assign_folds, folds_within
from wrist_ft_comp.fit.outliers_and_steps import begin_where_tared, MOVING, segment
from wrist_ft_comp.fit.paper_methods import identify_paper_method
from wrist_ft_comp.fit.result import AxisFit, Calibration
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.fit.thermometer_prediction import exchanged_days, predict_each_other
from wrist_ft_comp.payload.separation import learn_at_work
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import IntArray, Progress, rounded
from wrist_ft_comp.stream.failed_thermometers import stands_s


def calibrate(
    recordings: Sequence[Recording],
    settings: CalibrationSettings | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """
    Learn the drift of every axis that was recorded: the model, ready to run, and its evidence.

    Recordings are on the same thermal grid, with the same thermometers, each with its own unknown
    offset. ``progress`` is called with the share that is done, 0 to 1. CalibrationRefusedError
    where the recordings do not allow a trustworthy fit, whose sentence says what to do, and
    TooShortError where an ARX does not find enough consecutive samples.
    """
    settings = settings or CalibrationSettings()
    progress = progress or (lambda _: None)
    reference = settings.reference
    ranges_c = checks.check_recordings(recordings, reference, settings.min_temperature_span_k)
    recordings, dropped = checks.drop_stuck_cells(recordings)
    axes = [axis for axis in AXES if any(axis in r.axes_present for r in recordings)]
    recordings, doubts = checks.drop_unknown_temperatures(recordings)
    for find in (
        checks.pauses, checks.idle_thermometers, checks.jumping_thermometers,
        checks.frozen_at_the_end,
    ):  # fmt: skip
        doubts += find(recordings)
    # Begin a segment at each step of a still load.
    recordings, stepped = segment(recordings, reference)
    folds = assign_folds(recordings)
    # Learn every axis; at work twice: with a model, drift is separated from payloads better.
    work = None
    if reference == 'payload':
        work = learn_at_work(recordings, lambda drift: _learn(drift, axes, folds, settings)[1])
    fits, model, said = _learn(work.drift if work else recordings, axes, folds, settings, progress)
    # Where the driver may have been tared, it was if that halves the share left.
    tared, begun = begin_where_tared(recordings, reference)
    if begun:
        with suppress(WristFtCompError):  # segments may be too short for an ARX
            again = _learn(tared, axes, folds, settings)
            both = [(fit, fits[axis]) for axis, fit in again[0].items() if axis in fits]
            if any(2 * tared_fit.share_left < fit.share_left for tared_fit, fit in both):
                tared, sure = begin_where_tared(recordings, reference, again[1])
                if sure:
                    again = again if sure == begun else _learn(tared, axes, folds, settings)
                    (fits, model, said), stepped = again, stepped + sure
    # Say what to doubt.
    sensors = {f'in recording {n}, {one.name}': one.sensor for n, one in enumerate(recordings, 1)}
    warnings = [warning for recording in recordings for warning in recording.warnings]
    if apart := differences(sensors):
        warnings.append(f'Recordings of several sensors: {apart}. Calibrate every one alone.')
    warnings += [*dropped, *stepped, *said, *doubts]
    warnings += exchanged_days(recordings, model)
    warnings += work.warnings if work else ()
    unexplained = [
        f'{axis} {rounded(fit.rms_after, 2)} {fit.unit}'
        for axis, fit in fits.items()
        if fit.rms_after > max(fit.rms_before / 2, MOVING[fit.unit])
    ]
    is_at_rest = reference in {'unloaded', 'constant'}
    if unexplained and is_at_rest and find_plateaus(recordings) is None:
        warnings.append(
            'Most of what these readings do is not explained by temperature, RMS: '
            f'{", ".join(unexplained)}. The load was declared {reference}: did the robot move, or '
            'did something touch it? Or does no thermometer see the heat? Record again standing '
            'still, or with the specific force (--reference payload).'
        )
    return Calibration(
        model=model, fits=fits, temperature_range_c=ranges_c, warnings=tuple(warnings),
        duration_s=sum(recording.duration_s for recording in recordings),
        sources=tuple(recording.name for recording in recordings),
        settings=settings, payloads=work.payloads if work else None, separation=work,
        sensor=ChainMap(*map(dict, sensors.values())))  # fmt: skip


def _learn(
    recordings: Sequence[Recording],
    axes: Sequence[str],
    folds: Sequence[IntArray],
    settings: CalibrationSettings,
    progress: Progress = lambda _: None,
) -> tuple[dict[str, AxisFit], DriftModel, list[str]]:
    """Learn some axes, and say what to doubt; CalibrationRefusedError where none can be."""
    fits, said = dict[str, AxisFit](), list[str]()
    # Days that are apart in temperature are no measure of each other, where each alone is better.
    within = folds_within(recordings)
    for number, axis in enumerate(axes, 1):
        data = build_axis_data(recordings, axis, settings.reference, folds)
        if data.recordings == 1 < len(recordings):
            said.append(
                f'{axis} is in one of {len(recordings)} recordings only, and is learnt from that.'
            )
            # It is judged on stretches of that recording.
            (i,) = {i for i, _ in data.folds_by_recording}
            of_one: list[IntArray] = [np.full(len(recording), -1) for recording in recordings]
            (of_one[i],) = assign_folds([recordings[i]])
            data = replace(data, folds=tuple(of_one))
        if data.samples < MIN_SAMPLES or len(data.folds_by_recording) < 2:
            said.append(
                f'{axis} has {data.samples} thermal cells with both wrench and reference; at '
                f'least {MIN_SAMPLES} in 2 blocks are needed. Record longer.'
            )
            continue
        chosen, identify = settings.identification, identify_paper_method
        if chosen.method == 'auto' and chosen.features == 'powers' and data.tared:
            identify = identify_auto
        fit = identify(data, chosen)
        if within is not None and data.recordings > 1:
            again = identify(replace(data, folds=tuple(within)), chosen)
            fit = again if 2 * again.share_left < fit.share_left else fit
        if fit.refusal:
            said.append(f'{fit.refusal}. It is left uncompensated.')
        fits[axis] = fit
        progress(number / len(axes))
    if not fits:
        raise CalibrationRefusedError(said[0])
    refusals = [fit.refusal for fit in fits.values() if fit.refusal]
    if refusals and all(fit.model is None for fit in fits.values()):
        raise CalibrationRefusedError(f'{refusals[0]}.')
    predicted = predict_each_other(recordings, within or folds) if data.tared else None
    stands = [[stands_s(c, r.period_s).max() for c in r.temperature_c.T] for r in recordings]
    model = DriftModel(
        period_ns=recordings[0].period_ns, thermometers=recordings[0].thermometers,
        axes={axis: fit.model for axis, fit in fits.items() if fit.model is not None},
        deviation={axis: fit.expected_rms for axis, fit in fits.items()},
        day_limits={
            axis: fit.day_limit for axis, fit in fits.items() if np.isfinite(fit.day_limit)
        },
        # A start takes means over this time: long for a thermometer's noise, short for a body.
        start_s=BIN_S, prediction=predicted, stands_s=np.max(stands, axis=0).tolist())  # fmt: skip
    return fits, model, said
