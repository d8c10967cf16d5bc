"""The raw wrenches: they are judged, and what has come of them is counted."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
import math
import time
from typing import Any

import numpy as np

from wrist_ft_comp.channels import AXES, why_unusable
from wrist_ft_comp.ros.diagnostics import doubtful, Growth, STALE, Status, WARN
from wrist_ft_comp.ros.hub import Hub, Part
from wrist_ft_comp.ros.topics import why_silent
from wrist_ft_comp.series import FloatArray, NANOSECONDS
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.stream.drift_limits import axis_limits
from wrist_ft_comp.stream.wrench_faults import SensorWatch, unusable, was_away
from wrist_ft_comp.wire.cdr import locate, RecentFrames, WRENCH, WRENCH_DOUBLES

#: A node that did not look for longer, s, was held up itself: nobody knows whether wrenches came.
_HELD_UP_S = 3.0
#: Messages that wait for longer in the node, s, during a whole second, are a delay of the force.
_BEHIND_S = 0.05
#: A sensor that sent zeros, or nothing usable, for this time, s, may have begun anew.
_RESET_S = 1.0
#: Where a counter of nano-, micro- or milliseconds in 32 bits begins anew, ns.
_FULL_NS = 2**32 * np.array([1, 1_000, 1_000_000])
#: A clock that begins anew below this, s, is that of a sensor that was switched on.
_SWITCHED_ON_S = 600.0
#: Stamps of wrenches stand still after this many looks in a row at the same one, 2 s: some drivers
#: stamp in whole seconds.
_SAME_LOOKS = 20
#: What an axis reads that is there, N; of a torque, a tenth of it in N m.
_THERE_N = 0.5


@dataclass
class Counts:
    """What has come of raw wrenches since the start, in numbers, and the newest one."""

    #: Stamp of the newest one, ns, its six numbers, N and N m, and the message's bytes.
    newest: tuple[int, Sequence[float], bytes] | None = None
    #: The one before it: two sensors may come by turns.
    before: tuple[int, Sequence[float], bytes] | None = None
    #: The publishers, by their identity in the graph; at first, those before a restart.
    drivers: set[str] = field(default_factory=set)
    #: The payload that was chosen at run time, in words, also before a restart; else empty.
    payload: str = ''
    #: The weight that was taken off at the tare, and how it was turned, in words; '' without one.
    weighed: str = ''
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


def is_silent(hub: Hub, stream: Compensator) -> bool:
    """Whether nothing is published, because a model or the first temperature is missing."""
    return not stream.compensating and hub.get_parameter('uncalibrated').value == 'silent'


class WrenchInput(Part):
    """Judges the raw wrenches, by the node's counts and its newest wrench."""

    title = 'input'

    def __init__(self, counts: Counts, compensator: Compensator) -> None:
        self._counts, self._compensator = counts, compensator
        self.sensor = SensorWatch()
        self._heard_s: float | None = None
        #: When it was looked last, and since when no wrench has come, s.
        self._looked_s = self._quiet_s = 0.0
        #: The shortest time that messages have waited since the last report, s.
        self._behind_s = math.inf
        #: Number and stamp of the wrench that was looked at last, ns.
        self._looked_at, self._stamp_ns = 0, 0
        #: How often in a row it had the stamp of the one before, and whether it had none.
        self._same_stamps, self._is_unstamped = 0, False
        #: When a wrench was sound last, s, and whether zeros, or no numbers, came since.
        self._sound_s, self._unsound = time.monotonic(), False
        #: The first frame_id, and those of the last two seconds.
        self._frame, self._frames = '', RecentFrames(WRENCH_DOUBLES)
        #: A third of what the model may be off, N and N m, (6,), NaN where there is none.
        self._deviation: FloatArray = np.full(len(AXES), np.nan)
        self._growth = Growth()

    def admits(self, raw: Sequence[float]) -> bool:
        """Decide whether a wrench of NaN, zeros, or what no sensor reads, passes; or count it."""
        newest = self._counts.newest
        strange = unusable(raw, raw if newest is None else newest[1])
        is_dead = not any(value for value in raw if math.isfinite(value))
        if is_dead and strange is None:  # zeros, where drift and tare say what a free sensor reads
            free = self._compensator.compensation.zero + self._compensator.tare
            is_dead = bool((np.abs(free) > axis_limits(_THERE_N)).any())
            is_dead &= not self.hub.get_parameter('use_sim_time').value
            # Drivers send them when a link fails; mock hardware never sends anything else.
            lived = self._compensator.tared and newest and np.nan_to_num(newest[1]).any()
            strange = 0.0 if is_dead and lived else None
        if strange is not None:
            self._counts.strange, self._counts.dropped = strange, self._counts.dropped + 1
        self._unsound |= is_dead
        return strange is None

    def poll(self) -> None:
        """Look at the newest wrench, if it is another one than at the last look."""
        newest, number, now_s = self._counts.newest, self._counts.wrenches, time.monotonic()
        self._behind_s = min(self._behind_s, self.hub.behind_s)
        if now_s - self._looked_s > _HELD_UP_S:
            self._quiet_s = now_s
        self._looked_s = now_s
        if newest is None or number == self._looked_at:
            return
        (stamp_ns, raw, data), compensator = newest, self._compensator
        # Before the first one only a tare from before a restart can be in doubt.
        is_judged = self._heard_s is not None or compensator.tared
        away_s = now_s - self._quiet_s if is_judged else 0.0
        passed_s = (stamp_ns - self._stamp_ns) / NANOSECONDS
        simulated = self.hub.get_parameter('use_sim_time').value
        read, drift, tare = np.nan_to_num(raw), compensator.compensation.zero, compensator.tare
        is_sound = read.any() or not self._unsound
        unsound_s = now_s - self._sound_s if is_judged and is_sound and self._unsound else 0.0
        if was_away(away_s, passed_s) or unsound_s > _RESET_S:
            if abs(passed_s - away_s) < 1 < away_s:  # no clock was set
                self.sensor = SensorWatch()
            # Once, and not after each gap of a link.
            if not any(why.startswith('no raw wrenches') for why in compensator.zero_doubts):
                compensator.doubt_zero(
                    'no raw wrenches, or unusable ones, came for '
                    f'{max(away_s, unsound_s):.0f} s: if the sensor was off, its zero may be '
                    'another one; call ~/tare'
                )
        if is_sound:
            self._sound_s, self._unsound = now_s, False
        is_full = bool((np.abs(self._stamp_ns - _FULL_NS) < NANOSECONDS).any())
        is_anew = passed_s < 0 and stamp_ns < _SWITCHED_ON_S * NANOSECONDS and not is_full
        if is_anew and not simulated:
            compensator.doubt_zero(
                'stamps of the wrench began anew: if the sensor was off, its zero may be another '
                'one; call ~/tare'
            )
        self._heard_s = self._quiet_s = now_s
        self._looked_at, self._stamp_ns = number, stamp_ns
        self._same_stamps = 0 if passed_s else self._same_stamps + 1
        self._is_unstamped = locate(data, WRENCH_DOUBLES).decode(data)[0] == 0
        before, known = self._counts.before, [*self._frames.names]
        self._frames.look(b'' if before is None else before[2], data)
        self._frame = self._frame or self._frames.names[-1]
        if known and (frame := self._frames.names[-1]) not in known:
            compensator.doubt_zero(
                f'frame_id changed from {known[-1] or "none"} to {frame or "none"} since the '
                'tare; call ~/tare with the model of this one'
            )
        self.sensor.look(read.tolist())
        # The tare of an axis that was not there is 0.
        is_there = np.abs(read) > axis_limits(_THERE_N)
        if compensator.tared and (is_new := is_there & (tare == 0)).any():
            axes = ', '.join(AXES[i] for i in np.flatnonzero(is_new))
            compensator.doubt_zero(f'{axes} read nothing, or 0, at the tare; call ~/tare')
        doubts = compensator.lasting_doubts
        if not doubts and (how := self.sensor.zeroed(drift, tare, self._deviation)):
            compensator.doubt_zero(
                f'the raw wrench {how}: a program or the driver may have zeroed the sensor, or a '
                'load was let go that had been tared; call ~/tare, and let programs call that'
            )

    def note_drivers(self) -> Sequence[Any]:
        """Doubt the zero where another publisher has come; give the publishers there are."""
        counts, topic = self._counts, self.hub.resolve_topic_name('wrench_raw')
        ends = self.hub.get_publishers_info_by_topic(topic)
        drivers = {bytes(end.endpoint_gid).hex() for end in ends}
        if drivers and drivers.isdisjoint(counts.drivers):
            if counts.drivers:
                self._compensator.doubt_zero(
                    f'the publisher of {topic} has left and another one came: its zero may be '
                    'another one; call ~/tare'
                )
            counts.drivers = drivers
        return list(ends)

    def statuses(self) -> Iterator[Status]:
        """Judge the raw wrenches: stale, unusable, suspicious, or well."""
        self.poll()
        counts, sensor, stream = self._counts, self.sensor, self._compensator
        topic = self.hub.resolve_topic_name('wrench_raw')
        if stream.model is not None and stream.tracker.temperature_c is not None:
            day = [stream.model.day_limits.get(axis, math.nan) for axis in AXES]
            self._deviation = np.fmax(stream.deviation, np.array(day) / 3)
        ends = self.note_drivers()
        grown, elapsed_s = self._growth.since(wrenches=counts.wrenches, dropped=counts.dropped)
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
            if counts.strange == 0:
                message += (
                    ': they are exactly zero on all axes, as where a link fails; if that is a '
                    'reading, call ~/reset_tare'
                )
            elif counts.strange is not None:
                message += f': they are {why_unusable(AXES[0], counts.strange)}'
            sick = self.sickness()
            yield Status(self.title, WARN, f'{message}; {sick}' if sick else message, numbers)
        elif not rate_hz:
            why = why_silent(self.hub, 'wrench_raw', WRENCH)
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
        if mixed := self._frames.mixed:
            return f'wrenches of {mixed}'
        if self.sensor.frozen:
            return 'the reading has not changed by a bit for seconds; is the sensor frozen?'
        if axes := ', '.join(self.sensor.stuck):
            return f'{axes} repeats one value to the last bit; is it saturated, or broken?'
        return ''

    def _doubts(self, topic: str, publishers: Sequence[Any]) -> Iterator[str]:
        """Say what is suspicious about wrenches that do arrive, the worst first."""
        sensor, model = self.sensor, self._compensator.model
        behind_s, self._behind_s = self._behind_s, math.inf
        if behind_s > _BEHIND_S:
            yield (
                f'wrenches wait {behind_s:.1f} s in this node, and force comes that late: the '
                'computer is too busy; give it less to do, or send fewer wrenches'
            )
        simulated = self.hub.get_parameter('use_sim_time').value
        if simulated and not self.hub.count_publishers('/clock'):
            yield (
                'use_sim_time is true, and nobody publishes /clock: times are unknown; on a robot '
                'set it to false at the start'
            )
        for end in publishers:
            name = f'{end.node_namespace.rstrip("/")}/{end.node_name}'
            if self.hub.count_publishers(f'{name}/drift'):
                yield (
                    f'{topic} comes from another compensator, {name}: drift is taken off twice; '
                    "remap wrench_raw to the driver's topic"
                )
        if self._frame and (others := [one for one in self._frames.names if one != self._frame]):
            yield (
                f'frame_id was {self._frame} and is {others[-1] or "empty"} now; is it another '
                f'sensor, or turned? Drift, payload and tare are those of {self._frame}'
            )
        if sick := self.sickness():
            yield sick
        elif model and (lost := model.axes.keys() & sensor.unused):
            yield (
                f'{", ".join(sorted(lost))} never read anything but 0 or NaN, but worked when the '
                'model was learnt; is it broken?'
            )
        if self._same_stamps >= _SAME_LOOKS:
            yield 'stamps stand still; the correction is that of one moment'
        if self._is_unstamped:
            yield 'wrenches come without stamps; the time of arrival is taken'
