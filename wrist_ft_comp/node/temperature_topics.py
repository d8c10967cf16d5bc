"""Thermometers: sensor_msgs/Temperature, or numbers in messages of any type, taken and judged."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
import math
import time
from typing import Any

from wrist_ft_comp.channels import is_plausible, temperature_channel, why_unusable
from wrist_ft_comp.errors import RecordingError, WristFtCompError
from wrist_ft_comp.node.live_model import LiveModel
from wrist_ft_comp.node.raw_wrench import age
from wrist_ft_comp.node.specific_force import SpecificForceInput
from wrist_ft_comp.ros import topics as ros_topics
from wrist_ft_comp.ros.diagnostics import doubtful, Growth, Status
from wrist_ft_comp.ros.hub import Hub, Part
from wrist_ft_comp.ros.rclpy_internals import waiting
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stream.clock import ClockComparison
from wrist_ft_comp.stream.drift_warnings import frozen_doubts, gap_doubts, seldom_doubts
from wrist_ft_comp.stream.gaps_and_restarts import OUTAGE_S
from wrist_ft_comp.units import other_unit, UNIT_REMEDY
from wrist_ft_comp.wire import numbers_in_messages as in_messages
from wrist_ft_comp.wire.cdr import DOUBLES, RecentFrames, TEMPERATURE
from wrist_ft_comp.wire.temperature_source import TemperatureSource

#: One that does not report on change is silent after this, s, or three of its longest pauses.
_SILENT_S = 30.0


class TemperatureTopic:
    """
    One topic of a part, by its full name, and the thermometers in its messages, by number from 0.

    One of sensor_msgs/Temperature is subscribed to at once, and every message is taken as it
    comes. Any other is subscribed to when a publisher tells the type. It may be fast, and to be
    woken costs much: ten times a second the newest message that holds a temperature is taken.
    Nodes may share such a topic, as those of an arm and of its gripper do.
    """

    def __init__(self, part: Any, topic: str, sources: dict[int, TemperatureSource]) -> None:
        self.sources = sources
        #: The newest message, and the one before it.
        self._newest = self._before = b''
        self.frames = RecentFrames(DOUBLES[TEMPERATURE])
        #: Messages of which some temperature could not be read.
        self.unreadable = 0
        #: Why none can be read, and why the number of a thermometer cannot.
        self.trouble, self.problems = '', dict[int, str]()
        self._hub: Hub = part.hub
        self._part, self._topic = part, topic
        self._is_plain = not all(source.path for source in sources.values())
        #: Of the messages that are subscribed to; empty while none are.
        self._type = ''
        #: Where messages wait for ``poll``, if they do.
        self._kept: Any = None
        if self._is_plain:
            self._subscribe(TEMPERATURE)

    def poll(self) -> None:
        """Take what came; ten times a second."""
        if self._kept is not None:
            self.read(*waiting(self._kept))

    def look(self) -> None:
        """Ask which type the topic has, and subscribe when that is new; once a second."""
        hub, topic, self.trouble = self._hub, self._topic, ''
        if self._type == TEMPERATURE:
            self.frames.look(self._before, self._newest)
        types = ros_topics.types_on(hub, topic)
        try:
            if types and not self._type:
                self._subscribe(TEMPERATURE if TEMPERATURE in types else types[0])
            if types:
                wrong = ros_topics.wrong_type(hub, topic, self._type)
                if wrong and self._is_plain:
                    wrong = f'{wrong}; write {topic}:FIELD to take a number in it'
                self.trouble = wrong or ros_topics.other_version(hub, topic)
        except WristFtCompError as error:
            self.trouble = str(error).rstrip('.')
        if self.trouble or not types:
            self.problems = {}

    def _subscribe(self, name: str) -> None:
        """Subscribe to messages of a type; WristFtCompError where they cannot be had."""
        kind, (source, *_) = ros_topics.load_type(self._topic, name), self.sources.values()
        self._definitions = in_messages.define_installed(self._topic, name)
        paths = [source.number for source in self.sources.values()]
        self._reader = in_messages.NumberReader(self._definitions, name, paths)
        if self._is_plain:
            take = self._hub.guarded(self._part, self.read)
            self._hub.subscribe(kind, source.topic, take, ros_topics.SLOW_SENSOR)
        else:
            self._kept = self._hub.subscribe_unserved(kind, source.topic)
        self._type = name

    def read(self, *messages: bytes) -> None:
        """Take the newest temperature of each thermometer out of messages, newest last."""
        wanted = {*self.sources}
        for data in () if self.trouble else reversed(messages):
            try:
                (stamp_ns,), (numbers,) = (part.tolist() for part in self._reader.read([data]))
            except RecordingError:
                self.unreadable += 1
                sentence = (
                    f"a message of {self._topic} can't be read as {ros_topics.short(self._type)}; "
                    'is the package here of the same version as where it comes from?'
                )
                self.problems = dict.fromkeys(self.sources, sentence)
                return
            self._before, self._newest = self._newest, data
            stamped = stamp_ns if self._reader.has_header else None
            for (thermometer, source), number in zip(self.sources.items(), numbers, strict=True):
                if thermometer not in wanted:
                    continue
                if math.isnan(number):
                    layout = in_messages.follow(self._definitions, self._type, data)
                    if layout.find(source.number) is None:
                        self.problems[thermometer] = source.missing(layout).rstrip('.')
                        continue
                wanted.remove(thermometer)
                self.problems.pop(thermometer, None)
                self._part.take(thermometer, stamped, source.celsius(number))
            if not wanted:
                return


@dataclass
class Thermometer:
    """What is known of one thermometer."""

    source: TemperatureSource
    #: Full name of its topic.
    topic: str
    #: When it reported last, by the steady clock.
    heard_s: float | None = None
    #: The same by the node's clock, ns, which a simulation may set.
    heard_ns: int = 0
    #: Its newest stamp, ns, 0 where it was not filled, None where the type has none; reading, °C.
    newest: tuple[int | None, float] = (None, math.nan)
    #: Its longest pause between two reports, s, and whether two in a row ever read the same.
    longest_s: float = 0.0
    repeats: bool = False


@dataclass(eq=False)
class TemperatureInput(Part):
    """Gives temperatures to the stream, and judges the thermometers, which count from 0."""

    thermometers: Sequence[Thermometer]
    live: LiveModel
    specific_force: SpecificForceInput
    #: Usable temperatures of all thermometers, and those that no sensor reads.
    usable: int = 0
    unusable: int = 0
    #: Thermometer and value, °C, of the newest unusable reading.
    _last_unusable: tuple[int, float] | None = None
    _growth: Growth = field(default_factory=Growth)
    #: Stamp of the wrench that was compared last, ns.
    _compared_ns: int | None = None

    title = 'temperature'
    topics = (('temperature', 'one topic per entry of temperature_topics; TOPIC:FIELD: any type'),)

    def start(self) -> None:
        """Subscribe to every thermometer."""
        self._tracker, self._comparison = self.live.compensator.tracker, ClockComparison()
        by_topic: dict[str, dict[int, TemperatureSource]] = {}
        for j, thermometer in enumerate(self.thermometers):
            by_topic.setdefault(thermometer.topic, {})[j] = thermometer.source
        self.by_topic = [
            TemperatureTopic(self, topic, sources) for topic, sources in by_topic.items()
        ]

    def take(self, thermometer: int, stamp_ns: int | None, temperature_c: float) -> None:
        """
        Give one temperature, °C, to the thermal grid.

        Its stamp, ns, is 0 where it was not filled, and None where the type has none.
        """
        if not is_plausible(temperature_c):
            self.unusable += 1
            self._last_unusable = thermometer, temperature_c
            return
        heard = self.thermometers[thermometer]
        if stamp_ns and (stamp_ns, temperature_c) == heard.newest:
            return  # sent again until there is another one
        heard.repeats |= temperature_c == heard.newest[1]
        heard.newest = stamp_ns, temperature_c
        at_ns, newest = stamp_ns or self.hub.now_ns(), self.live.counts.newest
        arrival_ns = self._arrival_ns()
        came_ns, period_ns = arrival_ns or self.hub.now_ns(), self._tracker.grid.period_ns
        self._comparison.note(heard.topic, at_ns, came_ns, period_ns / NANOSECONDS)
        # Specific force that came before this would else be too late for the recording's cell.
        self.hub.do(self.specific_force, self.specific_force.poll)
        cells = self.live.compensator.add_temperature(
            thermometer, at_ns, temperature_c, newest and newest[:2], arrival_ns
        )
        self.usable += 1
        now_s = time.monotonic()
        heard.longest_s = max(heard.longest_s, now_s - (heard.heard_s or now_s))
        heard.heard_s, heard.heard_ns = now_s, self.hub.now_ns()
        if cells:
            self.hub.broadcast('on_cells', cells, at_ns)

    def poll(self) -> None:
        """Take temperatures that are fields of messages, and compare clocks."""
        newest, before_ns = self.live.counts.newest, self._compared_ns
        if newest is not None and newest[0] != before_ns:
            self._compared_ns = newest[0]
            self._comparison.note_wrench(newest[0], self._arrival_ns() or self.hub.now_ns())
        for topic in self.by_topic:
            topic.poll()

    def _arrival_ns(self) -> int | None:
        """Time since the boot, ns, which nobody sets; None where time is simulated."""
        simulated = self.hub.get_parameter('use_sim_time').value
        return None if simulated else time.clock_gettime_ns(time.CLOCK_BOOTTIME)

    def statuses(self) -> Iterator[Status]:
        """Judge the thermometers: silent, unusable, on another clock, out of range, or well."""
        for topic in self.by_topic:
            topic.look()
        tracker, clocks = self._tracker, self._tracker.clocks
        rejected = clocks.rejected + tracker.grid.rejected
        grown, elapsed_s = self._growth.since(
            usable=self.usable, unusable=self.unusable, rejected=rejected, leapt=clocks.leaps,
            **{f'spike {j}': spikes.dropped for j, spikes in enumerate(tracker.spikes)},
        )  # fmt: skip
        numbers = {
            'state': tracker.origin,
            'rate_hz': f'{grown["usable"] / elapsed_s:.1f}',
            'unusable': str(self.unusable + sum(topic.unreadable for topic in self.by_topic)),
        }
        for j, thermometer in enumerate(self.thermometers, start=1):
            numbers[f'thermometer_{j}_age_s'] = age(thermometer.heard_s)
        if tracker.reading_c is not None and tracker.temperature_c is not None:
            for j, value in enumerate(tracker.reading_c, start=1):
                numbers[f'thermometer_{j}_c'] = f'{value:.2f}'
            for j in tracker.replaced:
                numbers[f'thermometer_{j + 1}_believed_c'] = f'{tracker.temperature_c[j]:.2f}'
        yield doubtful(self.title, self._doubts(grown), 'all thermometers report', numbers)

    def _doubts(self, grown: dict[str, int]) -> Iterator[str]:
        """Say what is wrong with temperatures, the worst first; counts grew since a report."""
        if grown['unusable'] and self._last_unusable is not None:
            j, value = self._last_unusable
            yield (
                f'readings of thermometer {j + 1} are dropped; they are '
                f'{why_unusable(temperature_channel(j), value)}. {UNIT_REMEDY} Drift is held '
                'meanwhile'
            )
        yield from self._tracker.thermometer_doubts
        yield from frozen_doubts(self._tracker)
        yield from seldom_doubts(self._tracker, self.live.compensator.moves)
        yield from gap_doubts(self._tracker, (self.live.counts.newest or [0])[0])
        yield from self._silence()
        if 0 < grown['rejected'] >= grown['usable']:  # of whole seconds, one counts
            yield 'temperatures are dropped, because their stamps do not increase'
        for topic, ahead_s in self._comparison.ahead_s.items():
            side = 'ahead of' if ahead_s > 0 else 'behind'
            yield (
                f'stamps of {topic} are {abs(ahead_s):.1f} s {side} those of '
                f'{self.hub.resolve_topic_name("wrench_raw")}, compared with their arrival; all '
                'drivers must use one clock'
            )
        stored, temperature_c = self.live.stored, self._tracker.temperature_c
        if stored and temperature_c is not None and (out := stored.model.outside(temperature_c)):
            low_c, high_c = stored.document['thermometers'][out[0]]['range_c']
            unit = other_unit(float(temperature_c[out[0]]), low_c, high_c)
            hint = f'. In {unit} it would be inside: check the unit' if unit else ''
            yield (
                f'thermometer {_numbers(out)} outside the calibrated range; the correction is '
                f'extrapolated, and held further out{hint}'
            )
        lately = self._growth.lately()
        for j, spikes in enumerate(self._tracker.spikes):
            if spikes.leaves_out or f'spike {j}' in lately:
                yield (
                    f'thermometer {j + 1} changed faster than metal can, from '
                    f'{spikes.believed_c:.1f} to {spikes.strange_c:.1f} °C; that is left out; is '
                    'it loose?'
                )
        if 'leapt' in lately:
            yield 'stamps of temperatures leapt; was a clock set, or a simulation restarted?'
        for j, thermometer in enumerate(self.thermometers, start=1):
            is_named = any(str(step).startswith('[') for step in thermometer.source.path)
            publishers = 0 if is_named else self.hub.count_publishers(thermometer.topic)
            if publishers > 1:
                yield f'thermometer {j} has {publishers} publishers; their readings are mixed'
        for mixed in filter(None, (topic.frames.mixed for topic in self.by_topic)):
            yield f'temperatures of {mixed}; let the driver publish each on a topic of its own'
        if unstamped := [j for j, t in enumerate(self.thermometers) if t.newest[0] == 0]:
            yield (
                f'thermometer {_numbers(unstamped)} does not stamp its readings; the time of '
                'arrival is taken'
            )

    def _silence(self) -> Iterator[str]:
        """Say which thermometers can't be read or are silent, and why, where that is known."""
        limit_s = self.live.compensator.settings.temperature_timeout_s
        problems = {
            j: topic.trouble or topic.problems.get(j, '')
            for topic in self.by_topic
            for j in topic.sources
        }
        drift = 'nothing is compensated until then'
        if self.live.compensator.compensating:
            drift = 'drift is held'
        silent, grid = dict[int, float](), self._tracker.grid
        for j, thermometer in enumerate(self.thermometers):
            heard_s = thermometer.heard_s
            spacing_s = grid.spacing(j) * grid.period_ns / NANOSECONDS
            silent_s = time.monotonic() - (-math.inf if heard_s is None else heard_s)
            simulated_s = (self.hub.now_ns() - thermometer.heard_ns) / NANOSECONDS
            if self._arrival_ns() is None and simulated_s >= 0:  # a simulation may be slow
                silent_s = min(silent_s, simulated_s)
            usual_s = max(limit_s, 2 * spacing_s)
            if thermometer.repeats:  # it reports as time passes, not on change
                usual_s = min(usual_s, max(_SILENT_S, 3 * thermometer.longest_s))
            effect = 'it is predicted' if j in self._tracker.replaced else drift
            if problems[j] and silent_s > max(OUTAGE_S, 2 * spacing_s):
                yield f'thermometer {j + 1}: {problems[j]}; {effect}'
            elif heard_s is None:
                wanted = '' if thermometer.source.path else TEMPERATURE
                why = ros_topics.why_silent(self.hub, thermometer.source.topic, wanted)
                yield f'thermometer {j + 1} has not reported: {why}; {effect}'
            elif silent_s > usual_s and j not in self._tracker.replaced:
                silent[j] = usual_s
        if silent:
            named, least_s = _numbers([*silent]), min(limit_s, *silent.values())
            yield f'thermometer {named} silent for more than {least_s:.3g} s; drift is held'


def _numbers(thermometers: Sequence[int]) -> str:
    return ', '.join(str(j + 1) for j in thermometers)
