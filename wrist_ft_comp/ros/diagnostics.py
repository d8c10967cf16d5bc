"""What the node says of itself: ``diagnostics`` judges a snapshot; thermometer 0 is called 1."""

from collections.abc import Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import numpy as np

from wrist_ft_comp.model.signals import AXES, axis_unit, FloatArray
from wrist_ft_comp.ros.inputs.status import judge_temperatures, judge_wrenches
from wrist_ft_comp.ros.live_model import summary
from wrist_ft_comp.ros.node_log import ERROR, OK, Status, WARN
from wrist_ft_comp.ros.snapshot import Snapshot
from wrist_ft_comp.stream.compensator import Compensator


def diagnostics(snapshot: Snapshot) -> list[Status]:
    """Judge a snapshot: input, temperature, model, calibration, output."""
    judges = judge_wrenches, judge_temperatures, _model, _calibration, _output
    return [judge(snapshot) for judge in judges]


def _model(now: Snapshot) -> Status:
    """Tell which model is live."""
    stored, problem, saved = now.live.stored, now.live.problem, now.state_keeper.writer
    numbers = {
        'state_saves': str(saved.written),
        'state_save_took_ms': f'{1e3 * saved.took_s:.1f}',
    }
    if stored is None:
        why = problem or 'no model; record a warm-up and call ~/calibrate'
        why = f'{why}; {saved.problem}' if saved.problem else why
        return Status('model', ERROR if problem else WARN, why, numbers)
    numbers |= {
        'file': str(stored.path),
        'sha256': stored.sha256,
        'created': str(stored.document['provenance'].get('created', '')),
        'axes': ', '.join(stored.model.axes) or 'none',
        'period_s': f'{stored.model.period_ns / 1e9:g}',
    }
    for j, entry in enumerate(stored.document['thermometers'], start=1):
        numbers[f'thermometer_{j}_calibrated_c'] = '{:.1f} to {:.1f}'.format(*entry['range_c'])
    trouble = problem or saved.problem
    return Status('model', WARN if trouble else OK, trouble or summary(stored), numbers)


def _calibration(now: Snapshot) -> Status:
    """Report recording, running calibration, and last outcome."""
    calibration, recording = now.calibration, now.recording.current
    numbers = {
        'last': calibration.last_outcome or 'none yet',
        'last_refusal': now.last_refusal or 'none yet',
    }
    if recording is not None:
        numbers |= {'recording': str(now.recording.path), 'recorded_cells': str(recording.rows)}
    if calibration.running_s is not None:
        return Status('calibration', OK, f'running for {calibration.running_s:.0f} s', numbers)
    if now.recording.failure:
        return Status('calibration', WARN, now.recording.failure, numbers)
    if calibration.refused:
        return Status('calibration', WARN, 'the last one was refused; see "last"', numbers)
    return Status('calibration', OK, 'recording' if recording else 'idle', numbers)


def _output(now: Snapshot) -> Status:
    """Report what is subtracted, and whether it hits a limit."""
    stream = now.stream
    numbers = {
        'rate_hz': f'{now.rate_hz("published"):.1f}',
        'published': str(now.health.counts.published),
        'tare': 'active' if stream.tare.any() else 'none',
        'origin': stream.tracker.origin,
        **_axis_numbers(stream),
    }
    large, fast = map(', '.join, (stream.limits.too_large, stream.limits.too_fast))
    level, why = WARN, 'not compensated: no model or no temperature yet'
    if large:
        level, why = ERROR, f'drift of {large} is at its limit'
    elif fast:
        why = f'drift of {fast} moves at its limit (max_drift_rate) and lags behind the model'
    elif stream.compensating and (policy := now.incompatible.get('wrench')):
        why = f'a subscriber of wrench asks for more {policy} than is offered and gets nothing'
    elif stream.compensating:
        level, why = OK, 'compensated'
    return Status('output', level, why, numbers)


def _axis_numbers(stream: Compensator) -> dict[str, str]:
    """Give drift, its deviation and the tare of every axis."""
    numbers: dict[str, str] = {}
    model, temperature_c = stream.model, stream.tracker.temperature_c
    deviations: FloatArray = np.full(len(AXES), np.nan)
    if model is not None and temperature_c is not None:
        deviations = model.uncertainty(temperature_c)
    for axis, zero, sensitivity, tare, deviation in zip(
        AXES, *stream.compensation, stream.tare, deviations, strict=True
    ):
        unit = axis_unit(axis)
        numbers[f'{axis}_drift'] = f'{zero:.4g} {unit}'
        if np.isfinite(deviation):
            numbers[f'{axis}_drift_deviation'] = f'{deviation:.4g} {unit}'
        numbers[f'{axis}_sensitivity'] = f'{100 * sensitivity:.3g} %'
        numbers[f'{axis}_tare'] = f'{tare:.4g} {unit}'
    return numbers


def diagnostic_array(
    stamp: Any, node_name: str, hardware_id: str, statuses: Sequence[Status]
) -> DiagnosticArray:
    """Build what goes to /diagnostics; each status is named "node: status" (REP-107)."""
    array = DiagnosticArray()
    array.header.stamp = stamp
    array.status = [
        DiagnosticStatus(
            level=status.level, name=f'{node_name}: {status.name}', message=status.message,
            hardware_id=hardware_id,
            values=[KeyValue(key=key, value=value) for key, value in status.values.items()])
        for status in statuses
    ]  # fmt: skip
    return array
