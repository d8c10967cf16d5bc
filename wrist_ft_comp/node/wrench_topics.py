"""The topics of wrenches: wrench_raw is judged, ~/drift and ~/correction are published."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
import math
import time
from typing import Any

from geometry_msgs.msg import WrenchStamped
import numpy as np

from wrist_ft_comp.channels import AXES, axis_unit, LARGEST
from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.ros.diagnostics import doubtful, ERROR, Growth, STALE, Status, WARN
from wrist_ft_comp.ros.hub import Hub, Part
from wrist_ft_comp.ros.topics import why_silent, wrench_message
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stream.clock import WrenchStamps
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.stream.drift_limits import axis_limits
from wrist_ft_comp.stream.live_thermal_cells import ThermalCell
from wrist_ft_comp.stream.recorded_thermal_cells import why_unusable
from wrist_ft_comp.stream.wrench_watch import SensorWatch
from wrist_ft_comp.wire.cdr import locate, WRENCH, WRENCH_DOUBLES

#: A sensor that is silent for longer, s, may have been switched off, and have another zero then.
_AWAY_S = 5.0
#: A node that did not look for longer, s, was held up itself: nobody knows whether wrenches came.
_HELD_UP_S = 3.0
#: Two nodes of one name are said when they have been there for this time, s: one that was killed
#: stays in the graph for 20 s with Fast DDS.
_TWINS_S = 30.0
#: What a free sensor reads is known to this many standard deviations of the model, but not better
#: than the second, N, and to the third on axes without a model.
_CERTAIN, _RESOLVED_N, _UNKNOWN_N = 3.0, 0.2, 0.5


@dataclass
class Counts:
    """What has come of raw wrenches since the start, in numbers, and the newest one."""

    #: Stamp of the newest one, ns, its six numbers, N and N m, and the message's bytes.
    newest: tuple[int, Sequence[float], bytes] | None = None
    #: The publishers, by their identity in the graph; at first, those before a restart.
    drivers: set[str] = field(default_factory=set)
    #: Usable wrenches that arrived, and corrected ones that were published.
    wrenches: int = 0
    published: int = 0
    #: Those that could not be used, and the number that no sensor reads of the newest of them;
    #: None where its bytes were no wrench.
    dropped: int = 0
    strange: float | None = None
    #: Wrenches that were lost by a fault of this program, and the last one of those.
    failed: int = 0
    fault: str = ''


def age(at_s: float | None) -> str:
    """Write how long ago a time of the steady clock was, s."""
    return 'never' if at_s is None else f'{time.monotonic() - at_s:.1f}'


def arrival(stamp_ns: int) -> str:
    """Say which time is used for messages without a stamp; ``stamp_ns`` is that of the newest."""
    if stamp_ns == 0:
        return 'the time of arrival is 0: use_sim_time is set, and nothing comes on /clock'
    return 'the time of arrival is taken'


def raw_topic(hub: Hub) -> str:
    """Give the topic of the raw wrench; SettingsError where the node would hear itself."""
    topic = hub.resolve_topic_name('wrench_raw')
    for name in ('wrench', 'wrench_external'):
        if topic == hub.resolve_topic_name(name):
            raise SettingsError(
                f'wrench_raw and {name} are both {topic}: the node would hear itself. Remap '
                f"wrench_raw to the driver's topic, and {name} to another."
            )
    return topic


def is_silent(hub: Hub, stream: Compensator) -> bool:
    """Whether nothing is published, because a model or the first temperature is missing."""
    return not stream.compensating and hub.get_parameter('uncalibrated').value == 'silent'


class WrenchInput(Part):
    """Judges the raw wrenches, by the node's counts and its newest wrench."""

    title, logged = 'input', True

    def __init__(self, counts: Counts, compensator: Compensator) -> None:
        self._counts, self._compensator = counts, compensator
        self.sensor, self.stamps = SensorWatch(), WrenchStamps()
        self._heard_s: float | None = None
        #: When it was looked last, and since when no wrench has come, s.
        self._looked_s = self._quiet_s = 0.0
        #: Number and stamp of the wrench that was looked at last, ns, and the first frame_id.
        self._looked_at, self._stamp_ns, self._frame = 0, 0, ''
        self._growth = Growth()
        #: How far what a free sensor is to read may be wrong, N and N m, (6,).
        self._off = axis_limits(_UNKNOWN_N)

    def admits(self, raw: Sequence[float]) -> bool:
        """
        Decide whether a wrench passes that holds NaN, or what no sensor reads; else count it.

        An axis that was NaN in every earlier wrench may be NaN: the sensor does not have it.
        """
        newest = self._counts.newest
        before = raw if newest is None else newest[1]
        numbers = [value for value in raw if not math.isnan(value)]
        lost = any(
            math.isnan(value) and not math.isnan(last)
            for value, last in zip(raw, before, strict=True)
        )
        if numbers and not lost and math.hypot(*numbers) < LARGEST:
            return True
        self._counts.strange = math.nan if lost or not numbers else max(numbers, key=abs)
        self._counts.dropped += 1
        return False

    def poll(self) -> None:
        """Look at the newest wrench, if it is another one than at the last look."""
        newest, number, now_s = self._counts.newest, self._counts.wrenches, time.monotonic()
        if now_s - self._looked_s > _HELD_UP_S:
            self._quiet_s = now_s
        self._looked_s = now_s
        if newest is None or number == self._looked_at:
            return
        (stamp_ns, raw, data), compensator = newest, self._compensator
        # Before the first one only a tare from before a restart can be in doubt.
        is_judged = self._heard_s is not None or compensator.tared
        away_s = now_s - self._quiet_s if is_judged else 0.0
        # By the stamps, too: a simulation that was held up goes on with the next one, a clock that
        # stands still shows nothing.
        passed_s = (stamp_ns - self._stamp_ns) / NANOSECONDS
        if away_s > _AWAY_S and not 0 < passed_s <= _AWAY_S:
            if abs(passed_s - away_s) < 1:  # no clock was set
                self.sensor, self.stamps = SensorWatch(), WrenchStamps()
            compensator.doubt_zero(
                f'no raw wrenches, or unusable ones, came for {away_s:.0f} s: if the sensor was '
                'off, its zero may be another one; call ~/tare'
            )
        self._heard_s = self._quiet_s = now_s
        self._looked_at, self._stamp_ns = number, stamp_ns
        layout = locate(data, WRENCH_DOUBLES)
        self._frame = self._frame or layout.frame_id(data)
        self.stamps.look(stamp_ns if layout.decode(data)[0] != 0 else 0)
        self.sensor.look(np.nan_to_num(raw).tolist())
        # What a free sensor reads is known as long as the tare is not in doubt.
        free = compensator.compensation.zero + compensator.tare
        if not compensator.zero_doubts and self.sensor.zeroed(free, self._off):
            compensator.doubt_zero(
                'the raw wrench jumped to zero on all axes at once: a program or the driver may '
                'have zeroed the sensor; call ~/tare'
            )

    def statuses(self) -> Iterator[Status]:
        """Judge the raw wrenches: stale, unusable, suspicious, or well."""
        self.poll()
        counts, sensor, stream = self._counts, self.sensor, self._compensator
        topic = self.hub.resolve_topic_name('wrench_raw')
        if stream.model is not None and stream.tracker.temperature_c is not None:
            deviation = stream.model.uncertainty(stream.tracker.temperature_c)
            known = np.fmax(_CERTAIN * deviation, axis_limits(_RESOLVED_N))
            self._off = np.where(np.isnan(deviation), axis_limits(_UNKNOWN_N), known)
        ends = self.hub.get_publishers_info_by_topic(topic)
        drivers = {bytes(end.endpoint_gid).hex() for end in ends}
        if drivers and drivers.isdisjoint(counts.drivers):
            if counts.drivers:
                self._compensator.doubt_zero(
                    f'the publisher of {topic} has left and another one came: its zero may be '
                    'another one; call ~/tare'
                )
            counts.drivers = drivers
        grown, elapsed_s = self._growth.since(
            wrenches=counts.wrenches, dropped=counts.dropped, back=self.stamps.ran_back,
            leapt=self.stamps.leapt,
        )  # fmt: skip
        rate_hz = grown['wrenches'] / elapsed_s
        numbers = {
            'rate_hz': f'{rate_hz:.1f}',
            'age_s': age(self._heard_s),
            'frame': self.hub.hardware_id(),
            'received': str(counts.wrenches),
            'dropped': str(counts.dropped),
        }
        if grown['dropped']:
            which = 'some wrenches are' if rate_hz else 'all wrenches are'
            message = f'{which} unusable and dropped; check the driver'
            if counts.strange is not None:
                message += f': they are {why_unusable(AXES[0], counts.strange)}'
            yield Status(self.title, WARN, message, numbers)
        elif not rate_hz:
            incompatible = self.hub.incompatible.get('wrench_raw', '')
            why = why_silent(self.hub, topic, WRENCH, incompatible)
            yield Status(self.title, STALE, f'no raw wrenches arrive: {why}', numbers)
        else:
            well = f'{rate_hz:.0f} wrenches per second'
            raw = () if counts.newest is None else counts.newest[1]
            absent = [axis for axis, value in zip(AXES, raw, strict=False) if math.isnan(value)]
            unused = [axis for axis in sensor.unused if axis not in absent]
            if absent:
                well += f'; {", ".join(absent)} never had a number'
            if unused:
                well += f'; {", ".join(unused)} never read anything but 0'
            yield doubtful(self.title, self._doubts(topic, ends), well, numbers)

    def sickness(self) -> str:
        """Say that readings are mixed, or frozen, or an axis stuck; empty where a sensor lives."""
        if (count := self.hub.count_publishers(self.hub.resolve_topic_name('wrench_raw'))) > 1:
            return f'{count} publishers share the topic; their readings are mixed'
        if self.sensor.frozen:
            return 'the reading has not changed by a bit for seconds; is the sensor frozen?'
        if axes := ', '.join(self.sensor.stuck):
            return f'{axes} repeats one value to the last bit; is it saturated, or broken?'
        return ''

    def _doubts(self, topic: str, publishers: Sequence[Any]) -> Iterator[str]:
        """Say what is suspicious about wrenches that do arrive, the worst first."""
        sensor, lately, model = self.sensor, self._growth.lately(), self._compensator.model
        for end in publishers:
            name = f'{end.node_namespace.rstrip("/")}/{end.node_name}'
            if self.hub.count_publishers(f'{name}/drift'):
                yield (
                    f'{topic} comes from another compensator, {name}: drift is taken off twice; '
                    "remap wrench_raw to the driver's topic"
                )
        if self._frame and (frame := self.hub.hardware_id()) != self._frame:
            yield (
                f'frame_id was {self._frame} and is {frame or "empty"} now; is it another sensor, '
                f'or turned? Drift, payload and tare are those of {self._frame}'
            )
        if sick := self.sickness():
            yield sick
        elif model and (lost := model.axes.keys() & sensor.unused):
            yield (
                f'{", ".join(sorted(lost))} never read anything but 0 or NaN, but worked when the '
                'model was learnt; is it broken?'
            )
        if self.stamps.stand_still:
            yield 'stamps stand still; the correction is that of one moment'
        if 'back' in lately:
            yield 'stamps ran back; was a clock set, or a simulation restarted?'
        if 'leapt' in lately:
            yield 'stamps leapt ahead; was a clock set?'
        if self.stamps.missing and self._counts.newest is not None:
            yield f'wrenches come without stamps; {arrival(self._counts.newest[0])}'


class DriftTopic(Part):
    """
    Publishes the zero drift once per thermal cell, and the correction; judges what is subtracted.

    The correction is the compensated minus the raw wrench of the newest wrench. A controller that
    adds its last message to each raw wrench, such as admittance_controller by its
    ~/wrench_reference, is compensated without the wrench going through this node.
    """

    title, logged = 'output', True
    topics = (
        ('~/drift', 'zero drift being subtracted, once per thermal cell'),
        ('~/correction', 'compensated minus raw, ten times a second: what controllers add'),
    )

    def __init__(self, compensator: Compensator, counts: Counts) -> None:
        self._compensator, self._counts, self._growth = compensator, counts, Growth()
        #: When this node was the only one of its name last, by the steady clock, s.
        self._alone_s = time.monotonic()

    def start(self) -> None:
        """Offer the topics."""
        self.drift = self.hub.advertise(WrenchStamped, '~/drift')
        self.correction = self.hub.advertise(WrenchStamped, '~/correction')

    def on_cells(self, _cells: Sequence[ThermalCell], stamp_ns: int) -> None:
        """Publish what is subtracted at the end of cells."""
        if self._compensator.compensating:
            zero = self._compensator.compensation.zero
            self.drift.publish(wrench_message(stamp_ns, self.hub.hardware_id(), zero))

    def poll(self) -> None:
        """
        Publish the correction, unless there was no wrench yet or the drift has not been found.

        Then the controller holds the last one, which a restarted node sent before it ended.
        Without a model the parameter ``uncalibrated`` decides, as it does for the wrench.
        """
        stream, newest = self._compensator, self._counts.newest
        waits = stream.model is not None and not stream.compensating
        if newest is None or waits or is_silent(self.hub, stream):
            return
        stamp_ns, raw, _ = newest
        correction = np.subtract(stream.correct(stamp_ns, raw), raw)
        self.correction.publish(wrench_message(stamp_ns, self.hub.hardware_id(), correction))

    def statuses(self) -> Iterator[Status]:
        """Report what is subtracted, whether it hits a limit, and another node of this name."""
        hub, stream, counts = self.hub, self._compensator, self._counts
        own = hub.get_name(), hub.get_namespace()
        if hub.get_node_names_and_namespaces().count(own) <= 1:
            self._alone_s = time.monotonic()
        grown, _ = self._growth.since(failed=counts.failed, wrenches=counts.wrenches)
        comes = 'wrenches' in self._growth.lately()
        tare = 'active' if stream.tared else 'none'
        if not stream.tared and stream.tare.any():
            kept = np.linalg.norm(stream.tare[:3])
            tare = f'none; {kept:.2g} N are kept, so that the change of model made no step'
        numbers = {'published': str(counts.published), 'tare': tare}
        columns: dict[str, Any] = {'drift': stream.compensation.zero, 'tare': stream.tare}
        if stream.model is not None and stream.tracker.temperature_c is not None:
            known = np.array([axis in stream.model.axes for axis in AXES])
            deviation = stream.model.uncertainty(stream.tracker.temperature_c)
            columns['drift_deviation'] = np.where(known, deviation, math.nan)
        if (newest := counts.newest) is not None and comes:
            columns |= {'raw': newest[1], 'compensated': stream.correct(*newest[:2])}
        for name, values in columns.items():
            numbers |= {
                f'{axis}_{name}': f'{value:.4g} {axis_unit(axis)}'
                for axis, value in zip(AXES, values, strict=True)
                if not math.isnan(value)
            }
        for axis, share in zip(AXES, stream.compensation.sensitivity, strict=True):
            numbers[f'{axis}_sensitivity'] = f'{100 * share:.3g} %'
        status = doubtful(
            self.title, self._doubts(grown['failed'], comes=comes), 'compensated', numbers
        )
        is_error = grown['failed'] or stream.limits.too_large
        yield replace(status, level=ERROR) if is_error else status

    def _doubts(self, failed: int, *, comes: bool) -> Iterator[str]:
        """Say what is wrong with what is published, the worst first."""
        stream = self._compensator
        if self._counts.newest is not None and not comes:
            yield 'nothing is published, because no usable wrench comes; see the status input'
        large, fast = map(', '.join, (stream.limits.too_large, stream.limits.too_fast))
        if failed:
            yield f'wrenches were lost by a fault of this program: {self._counts.fault}'
        if large:
            yield f'drift of {large} is at its limit'
        if time.monotonic() - self._alone_s > _TWINS_S:
            name = self.hub.get_fully_qualified_name()
            yield f'two nodes are called {name}, and both publish; end one, or rename it'
        if fast:
            yield f'drift of {fast} moves at its limit (max_drift_rate) and lags behind the model'
        if not stream.compensating:
            yield 'not compensated: no model or no temperature yet'
        elif stream.model is not None and not stream.model.axes:
            yield 'not compensated: the model compensates no axis'
        yield from filter(None, [self.hub.incompatible.get('wrench')])
        yield from stream.zero_doubts
        if not stream.tared:
            yield 'no tare: wrench still holds the zero of the sensor; call ~/tare'
