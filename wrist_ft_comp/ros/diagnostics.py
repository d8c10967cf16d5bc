"""What the node says about itself once a second."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
import re
import time
from typing import Any, TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from wrist_ft_comp.ros.input_health import Period
from wrist_ft_comp.stream.input_checks import other_unit, PLAUSIBLE_C

if TYPE_CHECKING:
    from wrist_ft_comp.ros.compensator_node import CompensatorNode
import numpy as np

from wrist_ft_comp.model.signals import AXES, axis_unit, FloatArray

OK = DiagnosticStatus.OK


WARN = DiagnosticStatus.WARN


ERROR = DiagnosticStatus.ERROR


STALE = DiagnosticStatus.STALE


@dataclass(frozen=True)
class Concern:
    """
    The state of one concern.

    Attributes
    ----------
    name : str
        Such as ``temperature``.
    level : bytes
        OK, WARN, ERROR or STALE.
    sentence : str
        What is, and what to do.
    values : dict of str to str
        Numbers behind it.

    """

    name: str
    level: bytes
    sentence: str
    values: dict[str, str] = field(default_factory=dict)


def diagnostic_array(
    stamp: object, node_name: str, hardware_id: str, concerns: list[Concern]
) -> DiagnosticArray:
    """
    Build the message.

    Parameters
    ----------
    stamp : builtin_interfaces.msg.Time
        Now.
    node_name : str
        Each status is named "node: concern".
    hardware_id : str
        The sensor's frame.
    concerns : list of Concern
        In the order of the statuses.

    Returns
    -------
    DiagnosticArray
        For /diagnostics.

    """
    array = DiagnosticArray()
    array.header.stamp = stamp
    array.status = [
        DiagnosticStatus(
            level=concern.level,
            name=f'{node_name}: {concern.name}',
            message=concern.sentence,
            hardware_id=hardware_id,
            values=[KeyValue(key=key, value=value) for key, value in concern.values.items()],
        )
        for concern in concerns
    ]
    return array


#: Reports for which a driver may take its time to start.
_PATIENCE = 5


#: Reports without trouble after which it is over; what comes and goes is told once.
_PEACE = 10


#: What these say is not logged elsewhere.
_LOGGED = ('input', 'temperature', 'output')


#: Numbers that change from report to report, but not those of thermometers, which are names.
_NUMBERS = re.compile(r'(?<!thermometer )(?<!, )\b[\d.]+')


class ConcernLog:
    """
    Logs what changes about the concerns.

    Parameters
    ----------
    console : rclpy logger
        Where to.

    """

    def __init__(self, console: Any) -> None:
        self._console = console
        self._reports = 0
        #: Per concern: what was told since all was well, and for how many reports it has been.
        self._told: defaultdict[str, set[str]] = defaultdict(set)
        self._well: defaultdict[str, int] = defaultdict(int)

    def tell(self, concerns: Sequence[Concern]) -> None:
        """
        Log the troubles that are new, and the end of those that were.

        Parameters
        ----------
        concerns : sequence of Concern
            The present report.

        """
        self._reports += 1
        for concern in concerns:
            if concern.name in _LOGGED:
                self._tell_one(concern)

    def _tell_one(self, concern: Concern) -> None:
        """Log one concern, if that is news."""
        told, line = self._told[concern.name], f'{concern.name}: {concern.sentence}'
        if concern.level == OK:
            self._well[concern.name] += 1
            if told and self._well[concern.name] >= _PEACE:
                told.clear()
                self._console.info(line)
            return
        self._well[concern.name] = 0
        starting = concern.level == STALE and self._reports <= _PATIENCE
        sentence = _NUMBERS.sub('#', line)
        if starting or sentence in told:
            return
        told.add(sentence)
        # One call site each: rclpy insists that a call site keeps its severity.
        if concern.level == ERROR:
            self._console.error(line)
        else:
            self._console.warning(line)


#: Stamps of wrenches and temperatures that differ by more come from different clocks.
_SAME_CLOCK_S = 3600.0


def input_concern(node: 'CompensatorNode', period: Period) -> Concern:
    """
    Judge the raw wrenches.

    Parameters
    ----------
    node : CompensatorNode
        The node.
    period : Period
        What happened since the last report.

    Returns
    -------
    Concern
        Stale, unusable, suspicious, or well.

    """
    counts, watch = node.counts, node.watch
    topic = node.raw_subscription.topic_name
    publishers = node.count_publishers(topic)
    numbers = {
        'rate_hz': f'{period.in_hz:.1f}',
        'age_s': _age(watch.last_seen),
        'frame': node.frame_id,
        'received': str(counts.wrenches),
        'dropped_malformed': str(counts.malformed),
        'dropped_not_finite': str(counts.not_finite),
        'dropped_references': str(counts.bad_references),
        'publishers': str(publishers),
        'stamps_ran_back': str(watch.sensor.ran_back),
        'stamps_leapt': str(watch.sensor.leapt),
        'frame_changes': str(watch.frame_changes),
    }
    if period.unusable:
        what = 'some wrenches are' if period.in_hz else 'all wrenches are'
        return Concern('input', WARN, f'{what} unusable and dropped; check the driver', numbers)
    if not period.in_hz:
        why = 'no raw wrenches arrive; is the driver running?'
        if 'wrench_raw' in watch.incompatible:
            why = (
                f'no raw wrenches arrive: their publisher offers less '
                f'{watch.incompatible["wrench_raw"]} than is asked for'
            )
        elif publishers:
            why = f'no raw wrenches arrive, though {topic} has a publisher; is the sensor running?'
        return Concern('input', STALE, why, numbers)
    suspicion = next(_suspicions(node, publishers), '')
    if suspicion:
        return Concern('input', WARN, suspicion, numbers)
    return Concern('input', OK, f'{period.in_hz:.0f} wrenches per second', numbers)


def _suspicions(node: 'CompensatorNode', publishers: int) -> Iterator[str]:
    """Say what is suspicious about wrenches that do arrive, the worst first."""
    watch = node.watch
    sensor = watch.sensor
    if publishers > 1:
        yield f'{publishers} publishers share the topic; their readings are mixed'
    if sensor.frozen:
        yield 'the reading has not changed by a bit for seconds; is the sensor frozen?'
    if sensor.saturated:
        yield f'{", ".join(sensor.saturated)} stays at its extreme; is the sensor saturated?'
    if sensor.unstamped:
        yield 'wrenches come without stamps; the time of their arrival is taken'
    if sensor.stamps_stand_still:
        yield 'stamps stand still; the correction is that of one moment'
    recent = watch.recent
    if 'frame' in recent:
        yield 'the frame changed from {!r} to {!r}; is it another sensor?'.format(
            *watch.last_frames
        )
    if 'ran_back' in recent:
        yield 'stamps ran back; was a clock set, or a simulation begun anew?'
    if 'leapt' in recent:
        yield 'stamps leapt ahead; was a clock set?'


def temperature_concern(node: 'CompensatorNode', period: Period) -> Concern:
    """
    Judge the thermometers.

    Parameters
    ----------
    node : CompensatorNode
        The node.
    period : Period
        What happened since the last report.

    Returns
    -------
    Concern
        Silent, unusable, on another clock, outside the calibrated range, or well.

    """
    compensator, counts = node.compensator, node.counts
    now = time.monotonic()
    ages = [None if last is None else now - last for last in counts.last_temperature]
    numbers = {
        'state': node.keeping.outcome,
        'rate_hz': f'{period.warm_hz:.1f}',
        'rejected': str(compensator.tracker.grid.rejected),
        'stray_stamps': str(compensator.tracker.timestamp_filter.strays),
        'stamps_leapt': str(compensator.tracker.timestamp_filter.leaps),
        'stamps_restarted': str(compensator.tracker.grid.restarts),
        'unusable': str(counts.bad_temperatures),
        'jumps': str(sum(node.watch.thermometers.jumps)),
    }
    for j, last in enumerate(counts.last_temperature, start=1):
        numbers[f'thermometer_{j}_age_s'] = _age(last)
    if compensator.tracker.temperature_c is not None:
        for j, value in enumerate(compensator.tracker.temperature_c, start=1):
            numbers[f'thermometer_{j}_c'] = f'{value:.2f}'
    trouble = (
        _unusable(node, period)
        or _silence(node, ages)
        or _publishers(node)
        or _wrong_stamps(node, period)
        or _outside(node)
        or _jumps(node)
    )
    if trouble:
        return Concern('temperature', WARN, trouble, numbers)
    return Concern('temperature', OK, 'all thermometers report', numbers)


def _age(last: float | None) -> str:
    """Write how long ago something was, s."""
    return 'never' if last is None else f'{time.monotonic() - last:.1f}'


def _unusable(node: 'CompensatorNode', period: Period) -> str:
    """Say which readings were dropped."""
    last = node.watch.last_unusable
    if not period.unusable_temperatures or last is None:
        return ''
    low, high = PLAUSIBLE_C
    return (
        f'thermometer {last[0]} reads {last[1]:.4g} °C, which is dropped: no sensor is outside '
        f'{low:g} to {high:g} °C. Check it and its unit; drift is held meanwhile'
    )


def _silence(node: 'CompensatorNode', ages: list[float | None]) -> str:
    """Say which thermometers are silent."""
    limit = node.compensator.settings.temperature_timeout_s
    never = [j for j, age in enumerate(ages) if age is None]
    if never:
        them = ', '.join(str(j + 1) for j in never)
        held = 'is held' if node.compensator.compensating else 'waits for it'
        topics = node.get_parameter('temperature_topics').value
        policies = [node.watch.incompatible.get(topics[j], '') for j in never]
        if any(policies):
            return (
                f'thermometer {them} is not heard: a publisher offers less {max(policies)} than '
                f'is asked for; drift {held}'
            )
        return f'thermometer {them} has not reported; drift {held}'
    silent = [str(j) for j, age in enumerate(ages, start=1) if age is not None and age > limit]
    if silent:
        return f'thermometer {", ".join(silent)} silent for more than {limit:g} s; drift is held'
    return ''


def _publishers(node: 'CompensatorNode') -> str:
    """Say which thermometers share their topic with others."""
    shared = []
    for j, subscription in enumerate(node.temperature_subscriptions, start=1):
        publishers = node.count_publishers(subscription.topic_name)
        if publishers > 1:
            shared.append(f'thermometer {j} has {publishers} publishers; their readings are mixed')
    return '; '.join(shared)


def _wrong_stamps(node: 'CompensatorNode', period: Period) -> str:
    """Say what is wrong with the stamps."""
    counts, watch = node.counts, node.watch
    if counts.apart_s > _SAME_CLOCK_S:
        return (
            f'stamps of wrench and temperature are {counts.apart_s:.0f} s apart; both drivers '
            'must use one clock'
        )
    if period.rejected > 0 and 2 * period.rejected >= period.temperatures:
        return 'temperatures are dropped: their stamps do not increase'
    if any(watch.unstamped):
        them = ', '.join(str(j + 1) for j, without in enumerate(watch.unstamped) if without)
        return f'thermometer {them} does not stamp its readings; the time of arrival is taken'
    if 'temperature leapt' in watch.recent:
        return 'stamps of temperatures leapt; was a clock set, or a simulation begun anew?'
    if 'stray temperature' in watch.recent:
        return 'a temperature was dropped, because its stamp was far from those around it'
    return ''


def _jumps(node: 'CompensatorNode') -> str:
    """Say which thermometers jumped lately."""
    watch = node.watch
    if 'jump' not in watch.recent:
        return ''
    worst = max(range(len(watch.thermometers.jumps)), key=watch.thermometers.jumps.__getitem__)
    return (
        f'thermometer {worst + 1} jumped by {watch.thermometers.last_jump_k[worst]:.1f} K, faster '
        'than metal can; is it loose? The correction follows at max_drift_rate'
    )


def _outside(node: 'CompensatorNode') -> str:
    """Say which thermometers are outside the calibrated range, and guess why."""
    compensator, stored = node.compensator, node.model.stored
    if compensator.model is None or compensator.tracker.temperature_c is None or stored is None:
        return ''
    outside = compensator.model.outside(compensator.tracker.temperature_c)
    if not outside:
        return ''
    names = ', '.join(str(j + 1) for j in outside)
    guess = other_unit(
        float(compensator.tracker.temperature_c[outside[0]]),
        *stored.document['thermometers'][outside[0]]['range_c'],
    )
    hint = f'. In {guess} it would be inside: check the unit' if guess else ''
    return (
        f'thermometer {names} outside the calibrated range; drift is less certain there, and held '
        f'further out{hint}'
    )


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
        compensator.tracker.grid.rejected + compensator.tracker.timestamp_filter.strays
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
        AXES, *compensator.compensation, compensator.tare, deviations, strict=True
    ):
        unit = axis_unit(axis)
        numbers[f'{axis}_drift'] = f'{zero:.4g} {unit}'
        if np.isfinite(deviation):
            numbers[f'{axis}_drift_deviation'] = f'{deviation:.4g} {unit}'
        numbers[f'{axis}_sensitivity'] = f'{100 * sensitivity:.3g} %'
        numbers[f'{axis}_tare'] = f'{tare:.4g} {unit}'
    return numbers
