"""What the node says about what comes in: the raw wrenches and the thermometers."""

from collections.abc import Iterator
import time
from typing import TYPE_CHECKING

from wrist_ft_comp.core.thermometer_watch import other_unit, PLAUSIBLE_C
from wrist_ft_comp.ros.counts import Period
from wrist_ft_comp.ros.diagnostics import Concern, OK, STALE, WARN

if TYPE_CHECKING:
    from wrist_ft_comp.ros.compensator_node import CompensatorNode

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
        'stray_stamps': str(compensator.tracker.guard.strays),
        'stamps_leapt': str(compensator.tracker.guard.leaps),
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
