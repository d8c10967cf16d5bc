"""The parts that take raw wrenches and temperatures in, and judge them."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
import math
import time
from typing import TypeAlias

import numpy as np

from wrist_ft_comp.channels import AXES, is_plausible, LARGEST, temperature_channel
from wrist_ft_comp.node.live_model import LiveModel
from wrist_ft_comp.node.message_fields import TemperatureTopic
from wrist_ft_comp.node.specific_force import SpecificForceInput
from wrist_ft_comp.node.state_keeper import StateKeeper
from wrist_ft_comp.ros.diagnostics import doubtful, Growth, STALE, Status, WARN
from wrist_ft_comp.ros.hub import Hub, Part
from wrist_ft_comp.ros.topics import unpublished, wrong_type
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stream.batch_grid import why_unusable
from wrist_ft_comp.stream.clock import ClockComparison
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.stream.wrench_watch import SensorWatch
from wrist_ft_comp.wire.cdr import locate, TEMPERATURE, WRENCH, WRENCH_DOUBLES
from wrist_ft_comp.wire.temperature_source import other_unit, TemperatureSource, unit_remedy

#: The newest raw wrench: stamp, ns, six numbers, N and N m, and the message's bytes.
Newest: TypeAlias = tuple[int, Sequence[float], bytes]
#: The diagnostics warn of an event for this time, s.
_WARNED_S = 10.0


@dataclass
class Counts:
    """Numbers of wrenches since the start."""

    #: Usable wrenches that arrived.
    wrenches: int = 0
    #: Corrected wrenches that were published.
    published: int = 0
    malformed: int = 0
    not_finite: int = 0
    implausible: int = 0
    bad_references: int = 0
    #: Wrenches that were lost by a fault of this program, and the last one of those.
    failed: int = 0
    fault: str = ''
    #: The number that no sensor reads, of the newest wrench that was dropped for one.
    strange: float = 0.0

    def drop(self, value: float) -> None:
        """Count a wrench by a number in it that no sensor reads."""
        self.strange = value
        if math.isfinite(value):
            self.implausible += 1
        else:
            self.not_finite += 1


class _Events:
    """Remembers when every kind of event happened last."""

    def __init__(self) -> None:
        self._counted: dict[str, tuple[int, float]] = {}

    def note(self, **counts: int) -> None:
        """Take the present count of every kind."""
        for kind, count in counts.items():
            before, at_s = self._counted.get(kind, (0, -math.inf))
            self._counted[kind] = count, time.monotonic() if count > before else at_s

    def recent(self) -> set[str]:
        """List the kinds of events of the last _WARNED_S seconds."""
        since_s = time.monotonic() - _WARNED_S
        return {kind for kind, (_, at_s) in self._counted.items() if at_s > since_s}


def _age(at_s: float | None) -> str:
    """Write how long ago a time of the steady clock was, s."""
    return 'never' if at_s is None else f'{time.monotonic() - at_s:.1f}'


def _arrival(stamp_ns: int) -> str:
    """Say which time is used for messages without a stamp; ``stamp_ns`` is that of the newest."""
    if stamp_ns == 0:
        return 'the time of arrival is 0: use_sim_time is set, and nothing comes on /clock'
    return 'the time of arrival is taken'


class WrenchInput(Part):
    """Judges the raw wrenches, by the node's counts and its newest wrench."""

    title, logged = 'input', True
    hub: Hub

    def __init__(
        self, counts: Counts, newest: Callable[[], Newest | None], name: str = 'wrench_raw'
    ) -> None:
        self._counts, self.newest, self._name = counts, newest, name
        self.sensor = SensorWatch()
        #: Stamp of the newest wrench that was looked at, ns; None before the first.
        self.stamp_ns: int | None = None
        #: Axes of which the newest wrench had no number, as those of a sensor of three forces.
        self.absent: list[str] = []
        self._heard_s: float | None = None
        self._frame = ''
        #: How often the frame changed, and from what to what the last time.
        self._frame_changes = 0
        self._last_frames = ('', '')
        self._looked_at = 0
        self._growth, self._events = Growth(), _Events()

    def start(self) -> None:
        """Learn what the topic is called."""
        self.topic = self.hub.resolve_topic_name(self._name)

    def admits(self, raw: Sequence[float]) -> bool:
        """
        Decide whether a wrench passes that holds NaN, or what no sensor reads; else count it.

        An axis that was NaN in every earlier wrench may be NaN: the sensor does not have it.
        """
        newest = self.newest()
        before = raw if newest is None else newest[1]
        numbers = [value for value in raw if not math.isnan(value)]
        lost = any(
            math.isnan(value) and not math.isnan(last)
            for value, last in zip(raw, before, strict=True)
        )
        if numbers and not lost and math.hypot(*numbers) < LARGEST:
            return True
        self._counts.drop(math.nan if lost or not numbers else max(numbers, key=abs))
        return False

    def poll(self) -> None:
        """Look at the newest wrench, if it is another one than at the last look."""
        newest, number = self.newest(), self._counts.wrenches
        if newest is not None and number != self._looked_at:
            self._looked_at, self._heard_s = number, time.monotonic()
            self.stamp_ns, raw, data = newest
            layout = locate(data, WRENCH_DOUBLES)
            stamped, frame = bool(layout.decode(data)[0]), layout.frame_id(data)
            self.absent = [AXES[i] for i in np.flatnonzero(np.isnan(raw))]
            self.sensor.look(self.stamp_ns if stamped else 0, np.nan_to_num(raw).tolist())
            if self._frame and frame != self._frame:
                self._frame_changes += 1
                self._last_frames = (self._frame, frame)
            self._frame = frame
        sensor = self.sensor
        self._events.note(frame=self._frame_changes, back=sensor.ran_back, leapt=sensor.leapt)

    def statuses(self) -> Iterator[Status]:
        """Judge the raw wrenches: stale, unusable, suspicious, or well."""
        self.poll()
        counts, publishers = self._counts, self.hub.count_publishers(self.topic)
        strange = counts.not_finite + counts.implausible
        grown, elapsed_s = self._growth.since(
            wrenches=counts.wrenches, unusable=counts.malformed + strange, strange=strange
        )
        rate_hz = grown['wrenches'] / elapsed_s
        numbers = {
            'rate_hz': f'{rate_hz:.1f}',
            'age_s': _age(self._heard_s),
            'frame': self._frame,
            'received': str(counts.wrenches),
            'dropped_malformed': str(counts.malformed),
            'dropped_not_finite': str(counts.not_finite),
            'dropped_implausible': str(counts.implausible),
            'dropped_references': str(counts.bad_references),
            'publishers': str(publishers),
            'stamps_ran_back': str(self.sensor.ran_back),
            'stamps_leapt': str(self.sensor.leapt),
            'frame_changes': str(self._frame_changes),
        }
        if grown['unusable']:
            which = 'some wrenches are' if rate_hz else 'all wrenches are'
            message = f'{which} unusable and dropped; check the driver'
            if grown['strange']:
                message += f': they are {why_unusable(AXES[0], counts.strange)}'
            yield Status(self.title, WARN, message, numbers)
        elif not rate_hz:
            why = wrong_type(self.hub, self.topic, WRENCH)
            if policy := self.hub.incompatible.get(self._name):
                why = f'their publisher offers less {policy} than is asked for'
            elif publishers and not why:
                why = f'{self.topic} has a publisher that sends none; is the sensor running?'
            elif not why:
                why = unpublished(self.hub, self.topic, WRENCH)
            yield Status(self.title, STALE, f'no raw wrenches arrive: {why}', numbers)
        else:
            well = f'{rate_hz:.0f} wrenches per second'
            if self.absent:
                well += f'; {", ".join(self.absent)} never had a number'
            yield doubtful(self.title, self._doubts(publishers), well, numbers)

    def sickness(self) -> str:
        """Say that the sensor is frozen or saturated; empty where it lives."""
        if self.sensor.frozen:
            return 'the reading has not changed by a bit for seconds; is the sensor frozen?'
        if axes := self.sensor.saturated:
            return f'{", ".join(axes)} stays at its extreme; is the sensor saturated?'
        return ''

    def _doubts(self, publishers: int) -> Iterator[str]:
        """Say what is suspicious about wrenches that do arrive, the worst first."""
        sensor, recent = self.sensor, self._events.recent()
        if publishers > 1:
            yield f'{publishers} publishers share the topic; their readings are mixed'
        if sick := self.sickness():
            yield sick
        if sensor.stamps_stand_still:
            yield 'stamps stand still; the correction is that of one moment'
        if 'frame' in recent:
            before, after = self._last_frames
            yield f'the frame changed from {before!r} to {after!r}; is it another sensor?'
        if 'back' in recent:
            yield 'stamps ran back; was a clock set, or a simulation restarted?'
        if 'leapt' in recent:
            yield 'stamps leapt ahead; was a clock set?'
        if sensor.unstamped and self.stamp_ns is not None:
            yield f'wrenches come without stamps; {_arrival(self.stamp_ns)}'


class TemperatureInput(Part):
    """
    Gives temperatures to the stream, and judges the thermometers, which count from 0.

    ``sources`` are how each temperature is read, ``topics`` the full names of their topics.
    """

    title, logged = 'temperature', True
    topics = (('temperature', 'one per entry of temperature_topics, which hears any type, too'),)
    hub: Hub

    def __init__(  # noqa: PLR0913 -- parts that it needs, by name
        self, *, sources: Sequence[TemperatureSource], topics: Sequence[str],
        compensator: Compensator, wrenches: WrenchInput, specific_force: SpecificForceInput,
        live: LiveModel, state_keeper: StateKeeper,
    ) -> None:  # fmt: skip
        self._sources, self._topics, self._compensator = sources, topics, compensator
        self._wrenches, self._specific_force = wrenches, specific_force
        self._live, self._state_keeper = live, state_keeper
        #: Usable temperatures of all thermometers, and those that no sensor reads.
        self.usable = self.unusable = 0
        #: Thermometer and value, °C, of the newest unusable reading.
        self._last_unusable: tuple[int, float] | None = None
        #: Stamp of the newest usable reading, ns.
        self._stamp_ns = 0
        self._tracker, count = compensator.tracker, len(sources)
        #: When every thermometer reported last, by the steady clock.
        self._heard_s: list[float | None] = [None] * count
        #: Whether their newest readings had stamps; None where the type has none.
        self._stamped: list[bool | None] = [True] * count
        self._growth, self._events = Growth(), _Events()
        self._comparison = ClockComparison()
        #: Stamps of the wrench and of the IMU that were compared last, ns.
        self._wrench_ns: int | None = None
        self._imu_ns = 0

    def start(self) -> None:
        """Subscribe to every thermometer."""
        by_imu = self.hub.chosen()['gravity.source'] == 'imu'
        self._imu_topic = self.hub.resolve_topic_name('imu') if by_imu else ''
        by_topic: defaultdict[str, dict[int, TemperatureSource]] = defaultdict(dict)
        for j, (topic, source) in enumerate(zip(self._topics, self._sources, strict=True)):
            by_topic[topic][j] = source
        self._by_topic = [
            TemperatureTopic(self, topic, sources, self._take)
            for topic, sources in by_topic.items()
        ]

    def on_temperature(self, thermometer: int, data: bytes) -> None:
        """Take one message of a thermometer's topic."""
        for topic in self._by_topic:
            if thermometer in topic.sources:
                topic.read(data)

    @property
    def unreadable(self) -> int:
        """Messages of which some temperature could not be read."""
        return sum(topic.unreadable for topic in self._by_topic)

    def _take(self, thermometer: int, stamp_ns: int | None, temperature_c: float) -> None:
        """Give one temperature, °C, to the thermal grid; stamps, ns, are as in message_fields."""
        if not is_plausible(temperature_c):
            self.unusable += 1
            self._last_unusable = thermometer, temperature_c
            return
        at_ns, newest = stamp_ns or self.hub.now_ns(), self._wrenches.newest()
        if stamp_ns:
            self._compare(self._topics[thermometer], stamp_ns)
        # Specific force that came before this would else be too late for the recording's cell.
        self.hub.do(self._specific_force, self._specific_force.poll)
        wrench = newest and newest[:2]
        # The clock of the time since the boot is never set, and goes on while the machine sleeps.
        # With simulated time, stamps have nothing to do with it.
        simulated = self.hub.get_parameter('use_sim_time').value
        cells = self._compensator.add_temperature(
            thermometer,
            at_ns,
            temperature_c,
            wrench,
            arrival_ns=None if simulated else time.clock_gettime_ns(time.CLOCK_BOOTTIME),
        )
        self.usable += 1
        self._stamp_ns, self._heard_s[thermometer] = at_ns, time.monotonic()
        self._stamped[thermometer] = None if stamp_ns is None else stamp_ns != 0
        if cells:
            self.hub.broadcast('on_cells', cells, at_ns)

    def poll(self) -> None:
        """Take temperatures that are fields of messages, and note what several messages show."""
        wrench_ns, imu_ns = self._wrenches.stamp_ns, self._specific_force.forces.newest_ns
        if wrench_ns is not None and wrench_ns != self._wrench_ns:
            self._wrench_ns = wrench_ns
            self._comparison.note_wrench(wrench_ns, self._now_ns())
        if self._imu_topic and imu_ns != self._imu_ns:
            self._imu_ns = imu_ns
            self._compare(self._imu_topic, imu_ns)
        for topic in self._by_topic:
            topic.poll()
        clocks = self._tracker.clocks
        self._events.note(
            stray=clocks.strays,
            leapt=clocks.leaps + clocks.restarts,
            **{f'spike {j}': spikes.dropped for j, spikes in enumerate(self._tracker.spikes)},
        )

    def _compare(self, topic: str, stamp_ns: int) -> None:
        """Compare the clock of a topic with that of the wrench."""
        cell_s = self._tracker.grid.period_ns / NANOSECONDS
        self._comparison.note(topic, stamp_ns, self._now_ns(), cell_s)

    def _now_ns(self) -> int:
        """Time of arrival: of the simulation, or by a clock that nobody sets."""
        if self.hub.get_parameter('use_sim_time').value:
            return self.hub.now_ns()
        return time.monotonic_ns()

    def statuses(self) -> Iterator[Status]:
        """Judge the thermometers: silent, unusable, on another clock, out of range, or well."""
        for topic in self._by_topic:
            topic.look()
        self.poll()
        clocks = self._tracker.clocks
        rejected = clocks.rejected + self._tracker.grid.rejected
        grown, elapsed_s = self._growth.since(
            usable=self.usable, unusable=self.unusable, rejected=rejected + clocks.strays
        )
        numbers = {
            'state': self._state_keeper.outcome,
            'rate_hz': f'{grown["usable"] / elapsed_s:.1f}',
            'rejected': str(rejected),
            'stray_stamps': str(clocks.strays),
            'spikes': str(sum(spikes.dropped for spikes in self._tracker.spikes)),
            'stamps_leapt': str(clocks.leaps),
            'stamps_restarted': str(clocks.restarts),
            'unusable': str(self.unusable + self.unreadable),
            'jumps': str(sum(spikes.jumps for spikes in self._tracker.spikes)),
        }
        for j, at_s in enumerate(self._heard_s, start=1):
            numbers[f'thermometer_{j}_age_s'] = _age(at_s)
            if self._stamped[j - 1] is None:
                numbers[f'thermometer_{j}_time'] = 'of arrival: its messages have no header'
        if self._tracker.reading_c is not None and self._tracker.temperature_c is not None:
            for j, value in enumerate(self._tracker.reading_c, start=1):
                numbers[f'thermometer_{j}_c'] = f'{value:.2f}'
            for j in self._tracker.replaced:
                believed_c = self._tracker.temperature_c[j]
                numbers[f'thermometer_{j + 1}_believed_c'] = f'{believed_c:.2f}'
        yield doubtful(self.title, self._doubts(grown), 'all thermometers report', numbers)

    def _doubts(self, grown: dict[str, int]) -> Iterator[str]:
        """Say what is wrong with temperatures, the worst first; counts grew since a report."""
        if grown['unusable'] and self._last_unusable is not None:
            j, value = self._last_unusable
            remedy = unit_remedy(value, self._sources[j].in_unit)
            yield (
                f'readings of thermometer {j + 1} are dropped; they are '
                f'{why_unusable(temperature_channel(j), value)}. {remedy} Drift is held meanwhile'
            )
        if self._tracker.thermometers is not None:
            yield from self._tracker.thermometers.sentences
        yield from self._silence()
        if 0 < grown['rejected'] >= grown['usable'] / 2:
            clock = '' if self._stamp_ns else f': {_arrival(0)}'
            yield f'temperatures are dropped, because their stamps do not increase{clock}'
        for topic, ahead_s in self._comparison.ahead_s.items():
            side = 'ahead of' if ahead_s > 0 else 'behind'
            yield (
                f'stamps of {topic} are {abs(ahead_s):.1f} s {side} those of '
                f'{self._wrenches.topic}, compared with their arrival; all drivers must use one '
                'clock'
            )
        yield from self._outside()
        for j, publishers in enumerate(map(self.hub.count_publishers, self._topics), start=1):
            if publishers > 1:
                yield f'thermometer {j} has {publishers} publishers; their readings are mixed'
        recent = self._events.recent()
        jumps_k = self._tracker.remembered_jumps_k
        for j, (spikes, jump_k) in enumerate(zip(self._tracker.spikes, jumps_k, strict=True)):
            if spikes.leaves_out or f'spike {j}' in recent:
                yield (
                    f'thermometer {j + 1} read {spikes.strange_c:.1f} °C, where metal cannot have '
                    f'gone from {spikes.believed_c:.1f} °C; that is left out; is it loose?'
                )
            if jump_k:
                yield (
                    f'thermometer {j + 1} jumped by {jump_k:.1f} K, faster than metal can, and '
                    'stayed; is it loose? The correction follows at max_drift_rate'
                )
        if 'leapt' in recent:
            yield 'stamps of temperatures leapt; was a clock set, or a simulation restarted?'
        if 'stray' in recent:
            yield 'a temperature was dropped, because its stamp was far from those around it'
        if unstamped := [j for j, stamped in enumerate(self._stamped) if stamped is False]:
            arrival = _arrival(self._stamp_ns)
            yield f'thermometer {_numbers(unstamped)} does not stamp its readings; {arrival}'

    def _silence(self) -> Iterator[str]:
        """Say which thermometers can't be read or are silent, and why, where that is known."""
        limit_s = self._compensator.settings.temperature_timeout_s
        problems = {j: why for topic in self._by_topic for j, why in topic.problems().items()}
        drift = 'drift is held' if self._compensator.compensating else 'drift waits for it'
        silent = []
        for j, (at_s, source) in enumerate(zip(self._heard_s, self._sources, strict=True)):
            policy = self.hub.incompatible.get(source.topic, '')
            if j in problems:
                yield f'thermometer {j + 1}: {problems[j]}; {drift}'
            elif at_s is None and policy:
                yield (
                    f'thermometer {j + 1} is not heard: a publisher offers less {policy} than is '
                    f'asked for; {drift}'
                )
            elif at_s is None:
                why = f'{self._topics[j]} has a publisher that sends none'
                if not self.hub.count_publishers(self._topics[j]):
                    why = unpublished(self.hub, self._topics[j], TEMPERATURE)
                yield f'thermometer {j + 1} has not reported: {why}; {drift}'
            elif time.monotonic() - at_s > limit_s and j not in self._tracker.replaced:
                silent.append(j)
        if silent:
            yield (
                f'thermometer {_numbers(silent)} silent for more than {limit_s:g} s; drift is held'
            )

    def _outside(self) -> Iterator[str]:
        """Say which thermometers are outside the calibrated range, and guess why."""
        model, temperature_c = self._compensator.model, self._tracker.temperature_c
        outside = [] if model is None or temperature_c is None else model.outside(temperature_c)
        if not outside or temperature_c is None:
            return
        hint = ''
        if self._live.stored is not None:
            low_c, high_c = self._live.stored.document['thermometers'][outside[0]]['range_c']
            unit = other_unit(float(temperature_c[outside[0]]), low_c, high_c)
            hint = f'. In {unit} it would be inside: check the unit' if unit else ''
        yield (
            f'thermometer {_numbers(outside)} outside the calibrated range; drift is less '
            f'certain there, and held further out{hint}'
        )


def _numbers(thermometers: Iterable[int]) -> str:
    """Write thermometers as numbers from 1."""
    return ', '.join(str(j + 1) for j in thermometers)
