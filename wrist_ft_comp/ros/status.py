"""What the node says about itself once a second."""

import time
from typing import TYPE_CHECKING, NamedTuple

from wrist_ft_comp.core.recording import AXES, NANOSECONDS, axis_unit
from wrist_ft_comp.ros.diagnostics import ERROR, OK, STALE, WARN, Concern

if TYPE_CHECKING:
    from wrist_ft_comp.ros.compensator_node import CompensatorNode

#: Stamps of wrenches and temperatures that differ by more come from different clocks.
_SAME_CLOCK_S = 3600.0


class Period(NamedTuple):
    """
    What happened since the last report.

    Attributes
    ----------
    in_hz, out_hz : float
        Usable wrenches that came, and wrenches that went, per second.
    unusable : int
        Wrenches that were dropped.
    temperatures : int
        Finite temperatures of all thermometers.
    rejected : int
        Temperatures whose stamp did not increase.

    """

    in_hz: float
    out_hz: float
    unusable: int
    temperatures: int
    rejected: int


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
        self.bad_temperatures = 0
        self.bad_references = 0
        self.temperatures = 0
        self.last_temperature: list[float | None] = [None] * thermometers
        self._wrench_stamp_ns = self._temperature_stamp_ns = 0
        self._before = (time.monotonic(), 0, 0, 0, 0, 0)

    def wrench(self, stamp_ns: int) -> None:
        """Count one usable wrench."""
        self.wrenches += 1
        self._wrench_stamp_ns = stamp_ns

    def temperature(self, thermometer: int, stamp_ns: int) -> None:
        """Count one finite temperature and remember when it came."""
        self.temperatures += 1
        self._temperature_stamp_ns = stamp_ns
        self.last_temperature[thermometer] = time.monotonic()

    @property
    def apart_s(self) -> float:
        """How far the stamps of the newest wrench and temperature are apart, s; 0 before both."""
        if not (self.wrenches and self.temperatures):
            return 0.0
        return abs(self._wrench_stamp_ns - self._temperature_stamp_ns) / NANOSECONDS

    def period(self, rejected: int) -> Period:
        """Count since the last call; rejected is the thermal grid's count so far."""
        unusable = self.malformed + self.not_finite
        now = (
            time.monotonic(), self.wrenches, self.published, unusable, self.temperatures, rejected,
        )  # fmt: skip
        elapsed, came, went, *rest = (a - b for a, b in zip(now, self._before, strict=True))
        self._before = now
        elapsed = max(elapsed, 1e-9)
        return Period(came / elapsed, went / elapsed, *map(int, rest))


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
    period = node.counts.period(node.compensator.grid.rejected)
    return [
        _input(node, period),
        _temperature(node, period),
        _model(node),
        _calibration(node),
        _output(node, period),
    ]


def _input(node: 'CompensatorNode', period: Period) -> Concern:
    """Judge the raw wrenches."""
    counts = node.counts
    numbers = {
        'rate_hz': f'{period.in_hz:.1f}',
        'received': str(counts.wrenches),
        'dropped_malformed': str(counts.malformed),
        'dropped_not_finite': str(counts.not_finite),
        'dropped_references': str(counts.bad_references),
    }
    if period.unusable:
        what = 'some wrenches are' if period.in_hz else 'all wrenches are'
        return Concern('input', WARN, f'{what} unusable and dropped; check the driver', numbers)
    if not period.in_hz:
        return Concern('input', STALE, 'no raw wrenches arrive; is the driver running?', numbers)
    return Concern('input', OK, f'{period.in_hz:.0f} wrenches per second', numbers)


def _temperature(node: 'CompensatorNode', period: Period) -> Concern:
    """Judge the thermometers: silent, on another clock, outside the calibrated range, or well."""
    compensator, counts = node.compensator, node.counts
    now = time.monotonic()
    ages = [None if last is None else now - last for last in counts.last_temperature]
    numbers = {
        'rejected': str(compensator.grid.rejected),
        'unusable': str(counts.bad_temperatures),
    }
    for j, age in enumerate(ages, start=1):
        numbers[f'thermometer_{j}_age_s'] = 'never' if age is None else f'{age:.1f}'
    if compensator.temperature_c is not None:
        for j, value in enumerate(compensator.temperature_c, start=1):
            numbers[f'thermometer_{j}_c'] = f'{value:.2f}'
    trouble = _silence(node, ages) or _wrong_stamps(counts, period) or _outside(node)
    if trouble:
        return Concern('temperature', WARN, trouble, numbers)
    return Concern('temperature', OK, 'all thermometers report', numbers)


def _silence(node: 'CompensatorNode', ages: list[float | None]) -> str:
    """Say which thermometers are silent."""
    limit = node.compensator.settings.temperature_timeout_s
    never = [str(j) for j, age in enumerate(ages, start=1) if age is None]
    if never:
        return f'thermometer {", ".join(never)} has not reported; drift waits for it'
    silent = [str(j) for j, age in enumerate(ages, start=1) if age is not None and age > limit]
    if silent:
        return f'thermometer {", ".join(silent)} silent for more than {limit:g} s; drift is held'
    return ''


def _wrong_stamps(counts: Counts, period: Period) -> str:
    """Say what is wrong with the stamps."""
    if counts.apart_s > _SAME_CLOCK_S:
        return (
            f'stamps of wrench and temperature are {counts.apart_s:.0f} s apart; both drivers '
            'must use one clock'
        )
    if period.rejected > 0 and 2 * period.rejected >= period.temperatures:
        return 'temperatures are dropped: their stamps do not increase'
    return ''


def _outside(node: 'CompensatorNode') -> str:
    """Say which thermometers are outside the calibrated range."""
    compensator = node.compensator
    if compensator.model is None or compensator.temperature_c is None:
        return ''
    outside = compensator.model.outside(compensator.temperature_c)
    names = ', '.join(str(j + 1) for j in outside)
    return names and f'thermometer {names} outside the calibrated range; drift is clamped there'


def _model(node: 'CompensatorNode') -> Concern:
    """Tell which model is live."""
    stored, problem = node.model.stored, node.model.problem
    if stored is None:
        why = problem or 'no model; record a warm-up and call ~/calibrate'
        return Concern('model', ERROR if problem else WARN, why)
    numbers = {
        'file': str(stored.path),
        'sha256': stored.sha256,
        'created': str(stored.document['provenance'].get('created', '')),
        'axes': ', '.join(stored.model.axes) or 'none',
    }
    if problem:
        return Concern('model', WARN, problem, numbers)
    return Concern('model', OK, f'compensating {len(stored.model.axes)} axes', numbers)


def _calibration(node: 'CompensatorNode') -> Concern:
    """Report recording, running calibration, and last outcome."""
    control, recording = node.calibration, node.recording
    numbers = {'last': control.last_outcome or 'none yet'}
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
    compensator = node.compensator
    numbers = {'rate_hz': f'{period.out_hz:.1f}', 'published': str(node.counts.published)}
    for axis, zero, sensitivity, tare in zip(
        AXES, *compensator.drift, compensator.tare, strict=True
    ):
        numbers[f'{axis}_drift'] = f'{zero:.4g} {axis_unit(axis)}'
        numbers[f'{axis}_sensitivity'] = f'{100 * sensitivity:.3g} %'
        numbers[f'{axis}_tare'] = f'{tare:.4g} {axis_unit(axis)}'
    if compensator.limits.too_large:
        return Concern(
            'output',
            ERROR,
            f'drift of {", ".join(compensator.limits.too_large)} is at its limit',
            numbers,
        )
    if not compensator.compensating:
        return Concern('output', WARN, 'not compensated: no model or no temperature yet', numbers)
    return Concern('output', OK, 'compensated', numbers)
