"""What the node says of itself: ``diagnostics`` judges a snapshot; thermometer 0 is called 1."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import numpy as np

from wrist_ft_comp.model.signals import AXES, axis_unit, FloatArray
from wrist_ft_comp.ros.input_health import Counts, InputHealth
from wrist_ft_comp.ros.live_model import LiveModel, summary
from wrist_ft_comp.ros.node_log import ERROR, OK, STALE, Status, WARN
from wrist_ft_comp.ros.services.calibrate import CalibrateService
from wrist_ft_comp.ros.services.record import RecordService
from wrist_ft_comp.ros.state_keeper import StateKeeper
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.stream.input_checks import other_unit, PLAUSIBLE_C

#: Stamps of wrenches and temperatures that differ by more come from different clocks.
_SAME_CLOCK_S = 3600.0


class Snapshot(NamedTuple):
    """What the node knows about itself at a moment; times are those of a steady clock, s."""

    now_s: float
    health: InputHealth
    #: Per topic, by relative name, the policy on which some other side does not agree.
    incompatible: dict[str, str]
    stream: Compensator
    live: LiveModel
    state_keeper: StateKeeper
    calibration: CalibrateService
    recording: RecordService
    #: Which request was refused last, and why.
    last_refusal: str
    #: What had been counted at the report before, and how long ago that was.
    before: Counts
    elapsed_s: float
    #: Full name, and relative ones; how many publishers each has.
    wrench_topic: str
    temperature_topics: tuple[str, ...]
    #: What the topic carries instead of wrenches; empty when it is right.
    wrench_problem: str
    #: Messages of which no temperature could be read.
    unreadable: int
    #: Why a thermometer, counted from 0, can't be read; only those that can't.
    thermometer_problems: Mapping[int, str]
    wrench_publishers: int
    temperature_publishers: tuple[int, ...]

    def rate_hz(self, what: str) -> float:
        """Messages of one count per second, since the report before."""
        return self.grown(what) / max(self.elapsed_s, 1e-9)

    def grown(self, what: str) -> int:
        """Messages of one count since the report before."""
        return int(getattr(self.health.counts, what) - getattr(self.before, what))

    def age(self, at_s: float | None) -> str:
        """Write how long ago something was, s."""
        return 'never' if at_s is None else f'{self.now_s - at_s:.1f}'


def diagnostics(snapshot: Snapshot) -> list[Status]:
    """Judge a snapshot: input, temperature, model, calibration, output."""
    return [judge(snapshot) for judge in (_input, _temperature, _model, _calibration, _output)]


def _input(now: Snapshot) -> Status:
    """Judge the raw wrenches: stale, unusable, suspicious, or well."""
    health, counts, rate_hz = now.health, now.health.counts, now.rate_hz('wrenches')
    numbers = {
        'rate_hz': f'{rate_hz:.1f}',
        'age_s': now.age(health.last_wrench_s),
        'frame': health.frame,
        'received': str(counts.wrenches),
        'dropped_malformed': str(counts.malformed),
        'dropped_not_finite': str(counts.not_finite),
        'dropped_references': str(counts.bad_references),
        'publishers': str(now.wrench_publishers),
        'stamps_ran_back': str(health.sensor.ran_back),
        'stamps_leapt': str(health.sensor.leapt),
        'frame_changes': str(health.frame_changes),
    }
    if now.grown('malformed') + now.grown('not_finite'):
        which = 'some wrenches are' if rate_hz else 'all wrenches are'
        return Status('input', WARN, f'{which} unusable and dropped; check the driver', numbers)
    if not rate_hz:
        return Status('input', STALE, _wrench_silence(now), numbers)
    doubt, well = next(_suspicions(now), ''), f'{rate_hz:.0f} wrenches per second'
    return Status('input', WARN if doubt else OK, doubt or well, numbers)


def _wrench_silence(now: Snapshot) -> str:
    """Say that no wrenches come, and guess why."""
    policy, topic = now.incompatible.get('wrench_raw'), now.wrench_topic
    if policy:
        return f'no raw wrenches arrive: their publisher offers less {policy} than is asked for'
    if now.wrench_problem:
        return f'no raw wrenches arrive: {now.wrench_problem}'
    if now.wrench_publishers:
        return f'no raw wrenches arrive, though {topic} has a publisher; is the sensor running?'
    return 'no raw wrenches arrive; is the driver running?'


def _suspicions(now: Snapshot) -> Iterator[str]:
    """Say what is suspicious about wrenches that do arrive, the worst first."""
    sensor, recent = now.health.sensor, now.health.recent(now.now_s)
    if now.wrench_publishers > 1:
        yield f'{now.wrench_publishers} publishers share the topic; their readings are mixed'
    if sensor.frozen:
        yield 'the reading has not changed by a bit for seconds; is the sensor frozen?'
    if sensor.saturated:
        yield f'{", ".join(sensor.saturated)} stays at its extreme; is the sensor saturated?'
    if sensor.unstamped:
        yield 'wrenches come without stamps; the time of their arrival is taken'
    if sensor.stamps_stand_still:
        yield 'stamps stand still; the correction is that of one moment'
    if 'frame' in recent:
        before, after = now.health.last_frames
        yield f'the frame changed from {before!r} to {after!r}; is it another sensor?'
    if 'ran_back' in recent:
        yield 'stamps ran back; was a clock set, or a simulation begun anew?'
    if 'leapt' in recent:
        yield 'stamps leapt ahead; was a clock set?'


def _temperature(now: Snapshot) -> Status:
    """Judge the thermometers: silent, unusable, on another clock, out of range, or well."""
    health, tracker = now.health, now.stream.tracker
    numbers = {
        'state': now.state_keeper.outcome,
        'rate_hz': f'{now.rate_hz("temperatures"):.1f}',
        'rejected': str(tracker.grid.rejected),
        'stray_stamps': str(tracker.timestamp_filter.strays),
        'stamps_leapt': str(tracker.timestamp_filter.leaps),
        'stamps_restarted': str(tracker.grid.restarts),
        'unusable': str(health.counts.bad_temperatures + now.unreadable),
        'jumps': str(health.thermometers.jumps.sum()),
    }
    for j, last_s in enumerate(health.last_temperature_s, start=1):
        numbers[f'thermometer_{j}_age_s'] = now.age(last_s)
    if tracker.temperature_c is not None:
        for j, value in enumerate(tracker.temperature_c, start=1):
            numbers[f'thermometer_{j}_c'] = f'{value:.2f}'
    trouble = next(_thermometer_troubles(now), '')
    level, well = WARN if trouble else OK, 'all thermometers report'
    return Status('temperature', level, trouble or well, numbers)


def _thermometer_troubles(now: Snapshot) -> Iterator[str]:
    """Say what is wrong with temperatures, the worst first."""
    health, recent = now.health, now.health.recent(now.now_s)
    if now.grown('bad_temperatures') and health.last_unusable is not None:
        j, value = health.last_unusable
        low, high = PLAUSIBLE_C
        yield (
            f'thermometer {j + 1} reads {value:.4g} °C, which is dropped: no sensor is outside '
            f'{low:g} to {high:g} °C. Check it and its unit; drift is held meanwhile'
        )
    yield from _silence(now)
    shared = [
        f'thermometer {j} has {publishers} publishers; their readings are mixed'
        for j, publishers in enumerate(now.temperature_publishers, start=1)
        if publishers > 1
    ]
    if shared:
        yield '; '.join(shared)
    if health.stamps_apart_s > _SAME_CLOCK_S:
        yield (
            f'stamps of wrench and temperature are {health.stamps_apart_s:.0f} s apart; both '
            'drivers must use one clock'
        )
    if 0 < now.grown('rejected') >= now.grown('temperatures') / 2:
        yield 'temperatures are dropped: their stamps do not increase'
    if any(health.unstamped):
        them = _numbers(j for j, without in enumerate(health.unstamped) if without)
        yield f'thermometer {them} does not stamp its readings; the time of arrival is taken'
    if 'temperature leapt' in recent:
        yield 'stamps of temperatures leapt; was a clock set, or a simulation begun anew?'
    if 'stray temperature' in recent:
        yield 'a temperature was dropped, because its stamp was far from those around it'
    yield from _outside(now)
    if 'jump' in recent:
        worst = int(np.argmax(health.thermometers.jumps))
        yield (
            f'thermometer {worst + 1} jumped by {health.thermometers.last_jump_k[worst]:.1f} K, '
            'faster than metal can; is it loose? The correction follows at max_drift_rate'
        )


def _numbers(thermometers: Iterable[int]) -> str:
    """Write thermometers as numbers from 1."""
    return ', '.join(str(j + 1) for j in thermometers)


def _silence(now: Snapshot) -> Iterator[str]:
    """Say which thermometers can't be read or are silent."""
    for j, problem in sorted(now.thermometer_problems.items()):
        yield f'thermometer {j + 1}: {problem}; drift {_fate(now)}'
    limit_s, last_s = now.stream.settings.temperature_timeout_s, now.health.last_temperature_s
    never = [j for j, at_s in enumerate(last_s) if at_s is None]
    if never:
        fate = _fate(now)
        policies = [now.incompatible.get(now.temperature_topics[j], '') for j in never]
        if any(policies):
            yield (
                f'thermometer {_numbers(never)} is not heard: a publisher offers less '
                f'{max(policies)} than is asked for; drift {fate}'
            )
        yield f'thermometer {_numbers(never)} has not reported; drift {fate}'
    silent = [
        j for j, at_s in enumerate(last_s) if at_s is not None and now.now_s - at_s > limit_s
    ]
    if silent:
        yield f'thermometer {_numbers(silent)} silent for more than {limit_s:g} s; drift is held'


def _fate(now: Snapshot) -> str:
    """Say what becomes of the drift while a thermometer has not reported."""
    return 'is held' if now.stream.compensating else 'waits for it'


def _outside(now: Snapshot) -> Iterator[str]:
    """Say which thermometers are outside the calibrated range, and guess why."""
    model, temperature_c = now.stream.model, now.stream.tracker.temperature_c
    outside = [] if model is None or temperature_c is None else model.outside(temperature_c)
    if not outside or temperature_c is None:
        return
    hint = ''
    if now.live.stored is not None:
        low_c, high_c = now.live.stored.document['thermometers'][outside[0]]['range_c']
        unit = other_unit(float(temperature_c[outside[0]]), low_c, high_c)
        hint = f'. In {unit} it would be inside: check the unit' if unit else ''
    yield (
        f'thermometer {_numbers(outside)} outside the calibrated range; drift is less '
        f'certain there, and held further out{hint}'
    )


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
