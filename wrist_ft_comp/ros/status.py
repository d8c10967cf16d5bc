"""What the node says about itself once a second."""

import time
from typing import TYPE_CHECKING

from wrist_ft_comp.core.recording import AXES, axis_unit
from wrist_ft_comp.ros.diagnostics import ERROR, OK, STALE, WARN, Concern

if TYPE_CHECKING:
    from wrist_ft_comp.ros.compensator_node import CompensatorNode


class Counts:
    """
    What came in and what went out.

    Parameters
    ----------
    thermometers : int
        Number of thermometers J.

    """

    def __init__(self, thermometers: int) -> None:
        self.wrenches = 0
        self.published = 0
        self.malformed = 0
        self.not_finite = 0
        self.temperatures = [0] * thermometers
        self.last_temperature: list[float | None] = [None] * thermometers
        self._before = (time.monotonic(), 0, 0)

    def temperature(self, thermometer: int) -> None:
        """Count one temperature and remember when it came."""
        self.temperatures[thermometer] += 1
        self.last_temperature[thermometer] = time.monotonic()

    def rates_hz(self) -> tuple[float, float]:
        """Wrenches in and out per second since the last call."""
        now = time.monotonic()
        then, came, went = self._before
        self._before = (now, self.wrenches, self.published)
        elapsed = max(now - then, 1e-9)
        return (self.wrenches - came) / elapsed, (self.published - went) / elapsed


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
    rate_in, rate_out = node.counts.rates_hz()
    return [
        _input(node, rate_in),
        _temperature(node),
        _model(node),
        _calibration(node),
        _output(node, rate_out),
    ]


def _input(node: 'CompensatorNode', rate_hz: float) -> Concern:
    """Raw wrenches."""
    counts = node.counts
    numbers = {
        'rate_hz': f'{rate_hz:.1f}',
        'received': str(counts.wrenches),
        'dropped_malformed': str(counts.malformed),
        'dropped_not_finite': str(counts.not_finite),
    }
    if not rate_hz:
        return Concern('input', STALE, 'no raw wrenches arrive; is the driver running?', numbers)
    if counts.malformed or counts.not_finite:
        return Concern('input', WARN, 'some wrenches were unusable and were dropped', numbers)
    return Concern('input', OK, f'{rate_hz:.0f} wrenches per second', numbers)


def _temperature(node: 'CompensatorNode') -> Concern:
    """Thermometers: silent, outside the calibrated range, or well."""
    compensator, counts = node.compensator, node.counts
    now = time.monotonic()
    ages = [None if last is None else now - last for last in counts.last_temperature]
    numbers = {'rejected': str(compensator.grid.rejected)}
    for j, age in enumerate(ages, start=1):
        numbers[f'thermometer_{j}_age_s'] = 'never' if age is None else f'{age:.1f}'
    if compensator.temperature_c is not None:
        for j, value in enumerate(compensator.temperature_c, start=1):
            numbers[f'thermometer_{j}_c'] = f'{value:.2f}'
    limit = compensator.settings.temperature_timeout_s
    silent = [str(j) for j, age in enumerate(ages, start=1) if age is None or age > limit]
    if silent:
        return Concern(
            'temperature',
            WARN,
            f'thermometer {", ".join(silent)} silent for more than {limit:g} s; drift is held',
            numbers,
        )
    if compensator.model is not None and compensator.temperature_c is not None:
        outside = compensator.model.outside(compensator.temperature_c)
        if outside:
            names = ', '.join(str(j + 1) for j in outside)
            return Concern(
                'temperature',
                WARN,
                f'thermometer {names} outside the calibrated range; drift is clamped there',
                numbers,
            )
    return Concern('temperature', OK, 'all thermometers report', numbers)


def _model(node: 'CompensatorNode') -> Concern:
    """Which model is live."""
    stored = node.calibration.stored
    if stored is None:
        return Concern('model', WARN, 'no model; record a warm-up and call ~/calibrate')
    numbers = {
        'file': str(stored.path),
        'sha256': stored.sha256,
        'created': str(stored.document['provenance'].get('created', '')),
        'axes': ', '.join(stored.model.axes) or 'none',
    }
    return Concern('model', OK, f'compensating {len(stored.model.axes)} axes', numbers)


def _calibration(node: 'CompensatorNode') -> Concern:
    """Recording, running calibration, last outcome."""
    control, recording = node.calibration, node.recording
    numbers = {'last': control.last_outcome or 'none yet'}
    if recording is not None:
        numbers['recording'] = str(recording.path)
        numbers['recorded_cells'] = str(recording.rows)
    if control.running_s is not None:
        return Concern('calibration', OK, f'running for {control.running_s:.0f} s', numbers)
    if control.refused:
        return Concern('calibration', WARN, 'the last one was refused; see "last"', numbers)
    return Concern('calibration', OK, 'recording' if recording else 'idle', numbers)


def _output(node: 'CompensatorNode', rate_hz: float) -> Concern:
    """What is subtracted, and whether it hits a limit."""
    compensator = node.compensator
    numbers = {'rate_hz': f'{rate_hz:.1f}', 'published': str(node.counts.published)}
    for axis, zero, sensitivity, tare in zip(
        AXES, *compensator.drift, compensator.tare, strict=True
    ):
        numbers[f'{axis}_drift'] = f'{zero:.4g} {axis_unit(axis)}'
        numbers[f'{axis}_sensitivity'] = f'{100 * sensitivity:.3g} %'
        numbers[f'{axis}_tare'] = f'{tare:.4g} {axis_unit(axis)}'
    if compensator.limited:
        return Concern(
            'output', ERROR, f'drift of {", ".join(compensator.limited)} is at its limit', numbers
        )
    if not compensator.compensating:
        return Concern('output', WARN, 'not compensated: no model or no temperature yet', numbers)
    return Concern('output', OK, 'compensated', numbers)
