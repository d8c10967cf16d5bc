"""What the node says about itself once a second."""

from typing import TYPE_CHECKING

import numpy as np

from wrist_ft_comp.core.recording import AXES, axis_unit, FloatArray
from wrist_ft_comp.ros.counts import Period
from wrist_ft_comp.ros.diagnostics import Concern, ERROR, OK, WARN
from wrist_ft_comp.ros.status_inputs import input_concern, temperature_concern

if TYPE_CHECKING:
    from wrist_ft_comp.ros.compensator_node import CompensatorNode


def concerns(node: 'CompensatorNode') -> list[Concern]:
    """
    Judge every concern.

    Parameters
    ----------
    node : CompensatorNode
        The node.

    Returns
    -------
    list of Concern
        Input, temperature, model, calibration, output.

    """
    compensator = node.compensator
    period = node.counts.period(
        compensator.tracker.grid.rejected + compensator.tracker.guard.strays
    )
    return [
        input_concern(node, period),
        temperature_concern(node, period),
        _model(node),
        _calibration(node),
        _output(node, period),
    ]


def _model(node: 'CompensatorNode') -> Concern:
    """Tell which model is live."""
    stored, problem, keeping = node.model.stored, node.model.problem, node.keeping
    saves, took_s = keeping.saves
    numbers = {'state_saves': str(saves), 'state_save_took_ms': f'{1e3 * took_s:.1f}'}
    if stored is None:
        why = problem or 'no model; record a warm-up and call ~/calibrate'
        return Concern('model', ERROR if problem else WARN, why, numbers)
    numbers |= {
        'file': str(stored.path),
        'sha256': stored.sha256,
        'created': str(stored.document['provenance'].get('created', '')),
        'axes': ', '.join(stored.model.axes) or 'none',
        'period_s': f'{stored.model.period_ns / 1e9:g}',
    }
    for j, entry in enumerate(stored.document['thermometers'], start=1):
        numbers[f'thermometer_{j}_calibrated_c'] = '{:.1f} to {:.1f}'.format(*entry['range_c'])
    trouble = problem or keeping.problem
    if trouble:
        return Concern('model', WARN, trouble, numbers)
    return Concern('model', OK, node.model.summary, numbers)


def _calibration(node: 'CompensatorNode') -> Concern:
    """Report recording, running calibration, and last outcome."""
    control, recording = node.calibration, node.recording
    numbers = {
        'last': control.last_outcome or 'none yet',
        'last_refusal': node.last_refusal or 'none yet',
    }
    if recording.current is not None:
        numbers['recording'] = str(recording.current.path)
        numbers['recorded_cells'] = str(recording.current.rows)
    if control.running_s is not None:
        return Concern('calibration', OK, f'running for {control.running_s:.0f} s', numbers)
    if recording.failure:
        return Concern('calibration', WARN, recording.failure, numbers)
    if control.refused:
        return Concern('calibration', WARN, 'the last one was refused; see "last"', numbers)
    return Concern('calibration', OK, 'recording' if recording.current else 'idle', numbers)


def _output(node: 'CompensatorNode', period: Period) -> Concern:
    """Report what is subtracted, and whether it hits a limit."""
    compensator, limits = node.compensator, node.compensator.limits
    tared = bool(compensator.tare.any())
    numbers = {
        'rate_hz': f'{period.out_hz:.1f}',
        'published': str(node.counts.published),
        'tare': 'active' if tared else 'none',
        'origin': compensator.tracker.origin,
        **_axis_numbers(node),
    }
    peers = node.watch.incompatible.get('wrench')
    if limits.too_large:
        names = ', '.join(limits.too_large)
        return Concern('output', ERROR, f'drift of {names} is at its limit', numbers)
    if limits.too_fast:
        names = ', '.join(limits.too_fast)
        why = f'drift of {names} moves at its limit (max_drift_rate) and lags behind the model'
        return Concern('output', WARN, why, numbers)
    if not compensator.compensating:
        return Concern('output', WARN, 'not compensated: no model or no temperature yet', numbers)
    if peers:
        why = f'a subscriber of wrench asks for more {peers} than is offered and gets nothing'
        return Concern('output', WARN, why, numbers)
    return Concern('output', OK, 'compensated', numbers)


def _axis_numbers(node: 'CompensatorNode') -> dict[str, str]:
    """Give drift, its uncertainty and the tare of every axis."""
    compensator = node.compensator
    deviations: FloatArray = np.full(len(AXES), np.nan)
    if compensator.model is not None and compensator.tracker.temperature_c is not None:
        deviations = compensator.model.uncertainty(compensator.tracker.temperature_c)
    numbers: dict[str, str] = {}
    for axis, zero, sensitivity, tare, deviation in zip(
        AXES, *compensator.drift, compensator.tare, deviations, strict=True
    ):
        unit = axis_unit(axis)
        numbers[f'{axis}_drift'] = f'{zero:.4g} {unit}'
        if np.isfinite(deviation):
            numbers[f'{axis}_drift_deviation'] = f'{deviation:.4g} {unit}'
        numbers[f'{axis}_sensitivity'] = f'{100 * sensitivity:.3g} %'
        numbers[f'{axis}_tare'] = f'{tare:.4g} {unit}'
    return numbers
