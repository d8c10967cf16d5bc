"""What comes in, as the diagnostics say it; thermometer 0 is called 1."""

from collections.abc import Iterable, Iterator

import numpy as np

from wrist_ft_comp.node.snapshot import Snapshot
from wrist_ft_comp.ros.node_log import doubtful, STALE, Status, WARN
from wrist_ft_comp.signals import PLAUSIBLE_C
from wrist_ft_comp.wire.temperature_source import other_unit, unit_remedy

#: Stamps of wrenches and temperatures that differ by more come from different clocks.
_SAME_CLOCK_S = 3600.0


def judge_wrenches(now: Snapshot) -> Status:
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
    return doubtful('input', _suspicions(now), f'{rate_hz:.0f} wrenches per second', numbers)


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
    if sensor.stamps_stand_still:
        yield 'stamps stand still; the correction is that of one moment'
    if 'frame' in recent:
        before, after = now.health.last_frames
        yield f'the frame changed from {before!r} to {after!r}; is it another sensor?'
    if 'ran_back' in recent:
        yield 'stamps ran back; was a clock set, or a simulation begun anew?'
    if 'leapt' in recent:
        yield 'stamps leapt ahead; was a clock set?'
    if sensor.unstamped:
        yield f'wrenches come without stamps; {_arrival(now)}'


def _arrival(now: Snapshot) -> str:
    """Say which time counts where there is no stamp."""
    if now.health.clock_stands:
        return 'the time of arrival is 0: use_sim_time is set, and nothing comes on /clock'
    return 'the time of arrival is taken'


def judge_temperatures(now: Snapshot) -> Status:
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
        if health.stamped[j - 1] is None:
            numbers[f'thermometer_{j}_time'] = 'of arrival: its messages have no header'
    if tracker.temperature_c is not None:
        for j, value in enumerate(tracker.temperature_c, start=1):
            numbers[f'thermometer_{j}_c'] = f'{value:.2f}'
    troubles = _thermometer_troubles(now)
    return doubtful('temperature', troubles, 'all thermometers report', numbers)


def _thermometer_troubles(now: Snapshot) -> Iterator[str]:
    """Say what is wrong with temperatures, the worst first."""
    health, recent = now.health, now.health.recent(now.now_s)
    if now.grown('bad_temperatures') and health.last_unusable is not None:
        j, value = health.last_unusable
        low, high = PLAUSIBLE_C
        yield (
            f'thermometer {j + 1} reads {value:.4g} °C, which is dropped: no sensor is outside '
            f'{low:g} to {high:g} °C. {unit_remedy(value, now.sources[j].in_unit)} Drift is held '
            'meanwhile'
        )
    yield from _silence(now)
    if 0 < now.grown('rejected') >= now.grown('temperatures') / 2:
        clock = f': {_arrival(now)}' if health.clock_stands else ''
        yield f'temperatures are dropped, because their stamps do not increase{clock}'
    if health.stamps_apart_s > _SAME_CLOCK_S:
        yield (
            f'stamps of wrench and temperature are {health.stamps_apart_s:.0f} s apart; both '
            'drivers must use one clock'
        )
    yield from _outside(now)
    for j, publishers in enumerate(now.temperature_publishers, start=1):
        if publishers > 1:
            yield f'thermometer {j} has {publishers} publishers; their readings are mixed'
    if 'jump' in recent:
        worst = int(np.argmax(health.thermometers.jumps))
        yield (
            f'thermometer {worst + 1} jumped by {health.thermometers.last_jump_k[worst]:.1f} K, '
            'faster than metal can; is it loose? The correction follows at max_drift_rate'
        )
    if 'temperature leapt' in recent:
        yield 'stamps of temperatures leapt; was a clock set, or a simulation begun anew?'
    if 'stray temperature' in recent:
        yield 'a temperature was dropped, because its stamp was far from those around it'
    if unstamped := [j for j, stamped in enumerate(health.stamped) if stamped is False]:
        yield f'thermometer {_numbers(unstamped)} does not stamp its readings; {_arrival(now)}'


def _numbers(thermometers: Iterable[int]) -> str:
    """Write thermometers as numbers from 1."""
    return ', '.join(str(j + 1) for j in thermometers)


def _silence(now: Snapshot) -> Iterator[str]:
    """Say which thermometers can't be read or are silent, and of each why, if that is known."""
    limit_s, fate = now.stream.settings.temperature_timeout_s, _fate(now)
    never, silent = [], []
    for j, at_s in enumerate(now.health.last_temperature_s):
        policy = now.incompatible.get(now.sources[j].topic, '')
        if problem := now.thermometer_problems.get(j, ''):
            yield f'thermometer {j + 1}: {problem}; drift {fate}'
        elif at_s is None and policy:
            yield (
                f'thermometer {j + 1} is not heard: a publisher offers less {policy} than is '
                f'asked for; drift {fate}'
            )
        elif at_s is None:
            never.append(j)
        elif now.now_s - at_s > limit_s:
            silent.append(j)
    if never:
        yield f'thermometer {_numbers(never)} has not reported; drift {fate}'
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
