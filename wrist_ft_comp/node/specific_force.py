"""The part that takes specific force from an IMU or from TF, and hands it to all parts."""

from collections import deque
from collections.abc import Iterator, Mapping
from functools import partial
import math
from typing import Any

import numpy as np
from sensor_msgs.msg import Imu

from wrist_ft_comp.channels import GRAVITY
from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.payload.motion_collector import CALM_RAD_S, CALM_S
from wrist_ft_comp.payload.weight import Force, ForceFrame, FrameIds
from wrist_ft_comp.ros.hub import Part, Vector
from wrist_ft_comp.ros.parameters import at_start
from wrist_ft_comp.ros.rclpy_internals import waiting
from wrist_ft_comp.ros.topics import FAST_SENSOR, LATCHED, load_type, why_silent, wrong_type
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stream.clock import FORCE_APART_S
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.wire import cdr
from wrist_ft_comp.wire.gravity_by_tf import GravityByTf, Layout, tf_layouts
from wrist_ft_comp.wire.numbers_in_messages import Layouts

#: Least time between two specific forces by TF, ns: several publishers send parts of the tree.
_STEP_NS = 10_000_000
#: A frame that turns faster than this, rad/s, was moved on the robot: three times as fast
#: as the fastest wrists. Orientations are 10 ms apart at least, so that is a turn by 17 degrees.
_LEAP_RAD_S = 30.0
#: Where TF was away, or a static transform came again, a turn by more than this, degrees, may be
#: one of the frame on the robot.
_UNSEEN_DEG = 3.0
#: Specific force is judged over this many reports in a row: motion changes it in some of them.
_REPORTS = 10
#: The norm of a calibrated accelerometer deviates from gravity by less than this share of it, or
#: by more to both sides, as motion makes it.
_NORM_DEVIATION = 0.03
#: Specific force whose stamps are further ahead of those of the wrench, s, is of another clock,
#: and the weight that is taken off is as old.
_AHEAD_S = 0.3
#: More of the wrenches than this share without fresh specific force are a warning.
_MISSED_SHARE = 0.1
#: The weight is in doubt where half of a step between two samples is more than this share of it,
#: or, by TF, which has no noise, than this, N.
_STEP_SHARE, _STEP_N = 0.05, 1.0
#: Samples that are kept, so that an IMU of 1 kHz may be a quarter of a second ahead of the wrench.
_KEPT_SAMPLES = 256


class RecentForces:
    """
    The newest samples of specific force, as measured, m/s².

    At a stamp the newest sample up to it counts, or else the nearest: no wrench waits for one.
    """

    def __init__(self, timeout_s: float) -> None:
        #: A sample is used for wrenches within this time, ns.
        self.timeout_ns = round(timeout_s * NANOSECONDS)
        #: Samples since the start.
        self.count = 0
        #: Stamp, ns, and specific force of the newest sample.
        self.newest: tuple[int, Force] | None = None
        self._kept: deque[tuple[int, Force]] = deque(maxlen=_KEPT_SAMPLES)

    @property
    def last_step(self) -> tuple[float, float]:
        """Time between the last two samples, s, and how far apart they are, m/s²."""
        if len(self._kept) < 2:
            return 0.0, 0.0
        (before_ns, before), (after_ns, after) = self._kept[-2], self._kept[-1]
        return (after_ns - before_ns) / NANOSECONDS, math.dist(before, after)

    def add(self, stamp_ns: int, specific_force: Force) -> None:
        """Add a sample; a late one is dropped, and a stamp that is far back begins anew."""
        self.count += 1
        if self.newest is not None and stamp_ns < self.newest[0]:
            if self.newest[0] - stamp_ns <= self.timeout_ns:
                return
            self._kept.clear()
        self.newest = stamp_ns, specific_force
        self._kept.append(self.newest)

    def at(self, stamp_ns: int) -> Force | None:
        """Find the sample for a stamp, ns; None where it is farther away than the timeout."""
        if self.newest is None or self.newest[0] - stamp_ns > self.timeout_ns + NANOSECONDS:
            return None  # there is none, or they are stamped by a clock that is ahead
        for sample in reversed(self._kept):
            if sample[0] <= stamp_ns:
                break
        return sample[1] if abs(stamp_ns - sample[0]) <= self.timeout_ns else None


class SpecificForceInput(Part):
    """
    Takes specific force from where the parameters ``gravity.…`` say, and hands it to all parts.

    An IMU may send at 1 kHz, so it is polled: no executor wakes up for its messages.
    """

    title = 'gravity'
    parameters = (
        at_start(
            'gravity.source', 'none',
            'Where specific force comes from, to learn a payload and to subtract its weight: an '
            'IMU at the sensor on the topic imu, /tf and /tf_static (tf), or nothing (none).',
            choices=('none', 'imu', 'tf')),
        at_start(
            'gravity.frame', '',
            'With gravity.source tf: the frame whose z is up, against which the frame_id of the '
            'wrench turns.'),
        at_start(
            'gravity.timeout', 0.2,
            'Age above which a specific force is not used, so that no weight is subtracted.',
            's', 0.01, 10.0),
    )  # fmt: skip
    topics = (('imu', 'specific force, with gravity.source imu; with tf: /tf, /tf_static'),)

    def __init__(self, chosen: dict[str, Any], compensator: Compensator) -> None:
        self._compensator = compensator
        self.source, self._upper = chosen['gravity.source'], chosen['gravity.frame']
        self.forces = RecentForces(chosen['gravity.timeout'])
        #: Speed of rotation at the newest of them, rad/s; NaN where it is not known.
        self.speed = math.nan
        #: When TF showed a faster turn than CALM_RAD_S last, or one that is not known, ns.
        self._turned_ns = 0
        #: Messages that could not be read, or held no numbers.
        self.unreadable = 0
        self._unreadable_before = 0
        #: Links gravity.frame and the wrench's frame.
        self._tree = GravityByTf(self._upper, '')
        self._handed_out_ns: int | None = None
        self._tf_messages = 0
        self._imu: Any = None
        #: The newest message of the IMU, and the one before it; empty before the first.
        self._newest = self._before = b''
        self._recent = cdr.RecentFrames(cdr.IMU_DOUBLES)
        #: The specific forces of the last reports, while new ones come.
        self._felt = deque[Force](maxlen=_REPORTS)
        #: And how far these were stamped ahead of the newest wrench, s.
        self._ahead_s = deque[float](maxlen=_REPORTS)

    def start(self) -> None:
        """Subscribe; SettingsError when what is asked for cannot be had."""
        if self.source == 'imu':
            self._imu = self.hub.subscribe_unserved(Imu, 'imu', FAST_SENSOR)
        elif self.source == 'tf':
            if not self._upper:
                raise SettingsError(
                    'gravity.source is tf, and gravity.frame is empty; expected the frame whose z '
                    'is up. Set it at start-up with -p gravity.frame:=base_link or the like.'
                )
            for topic, qos in (('/tf', FAST_SENSOR), ('/tf_static', LATCHED)):
                take = partial(self.on_tf, tf_layouts(), static=qos is LATCHED)
                kind = load_type(topic, cdr.TF)
                self.hub.subscribe(kind, topic, self.hub.guarded(self, take), qos)

    def poll(self) -> None:
        """Take the messages that an IMU has sent."""
        if self._imu is not None:
            for data in waiting(self._imu):
                self.on_imu(data)

    def on_specific_force(self, stamp_ns: int, force: Vector, speed: float | None) -> None:
        """Keep one specific force, m/s², and its speed of rotation, rad/s."""
        self.forces.add(stamp_ns, force)
        self.speed = math.nan if speed is None else speed
        turns = self.source == 'tf' and not self.speed < CALM_RAD_S
        self._turned_ns = stamp_ns if turns else min(self._turned_ns, stamp_ns)

    def is_calm(self, stamp_ns: int) -> bool:
        """Whether specific force at a stamp, ns, is all there is: by TF not in a swing."""
        return stamp_ns - self._turned_ns > CALM_S * NANOSECONDS

    def frames(self) -> FrameIds:
        """
        Give the frame_ids of specific force and wrench, '' where one is not known yet.

        With TF, that of specific force is the frame whose z is up.
        """
        wrench = self.hub.hardware_id()
        if self.source == 'tf':
            return FrameIds(self._upper, wrench)
        newest = self._newest
        imu = cdr.locate(newest, cdr.IMU_DOUBLES).frame_id(newest) if newest else ''
        return FrameIds(imu, wrench)

    def on_imu(self, data: bytes) -> None:
        """Take one sensor_msgs/Imu; without a gyroscope its rotation is zero."""
        try:
            stamp_ns, numbers = cdr.locate(data, cdr.IMU_DOUBLES).decode(data)
        except RecordingError:
            self.unreadable += 1
            return
        self._before, self._newest = self._newest, data
        x, y, z = numbers[cdr.ACCELERATION]
        speed = math.hypot(*numbers[cdr.ROTATION])
        if math.isfinite(x + y + z):
            at_ns = stamp_ns or self.hub.now_ns()
            known = speed if speed > 0 else None
            self.hub.broadcast('on_specific_force', at_ns, (x, y, z), known)
        else:
            self.unreadable += 1

    def on_tf(self, layouts: Layouts[Layout], data: bytes, *, static: bool) -> None:
        """Take one tf2_msgs/TFMessage; ``layouts`` are those of its topic."""
        self._tree.lower = self.frames().wrench_frame
        try:
            layout = layouts.find(data)
        except RecordingError:
            self.unreadable += 1
            return
        needed = self._tree.needed(layout.frames, static=static)
        for transforms in layout.decode(np.frombuffer(data, np.uint8)[np.newaxis], needed):
            self._tree.add(transforms, static=static)
        self._tf_messages += 1
        if self._tf_messages % 100 == 0:  # at each message it would cost more than the message
            self._tree.forget()
        if not needed:
            return
        # At the newest stamp of all transforms, if it is a new one. Stamps that ran back are
        # those of a simulation that was restarted.
        at_ns, last_ns = self._tree.settled_ns(), self._handed_out_ns
        if at_ns is None or (last_ns is not None and 0 <= at_ns - last_ns < _STEP_NS):
            return
        self._handed_out_ns = at_ns
        (specific_force,), (turning,) = self._tree.read(np.array([at_ns]))
        if not math.isfinite(specific_force[0]):
            return
        x, y, z = specific_force.tolist()
        # Was the frame of the wrench moved on the robot?
        unseen_deg = math.degrees(self._tree.turned_unseen_rad)
        self._tree.turned_unseen_rad = 0.0
        if turning > _LEAP_RAD_S or unseen_deg > _UNSEEN_DEG:
            self._compensator.doubt_zero(
                'by TF the frame of the wrench turned faster than a robot does, or while /tf '
                'paused: if it was moved on the robot, perhaps by another TCP, then drift, '
                'payload and tare are those of the frame before; go back to it. If it was not '
                'moved, call ~/tare, and look whether two nodes publish that frame.'
            )
        speed = float(turning) if math.isfinite(turning) else None
        self.hub.broadcast('on_specific_force', at_ns, (x, y, z), speed)

    def doubt(self) -> str:
        """Say what is wrong with the messages since the last call; empty when nothing is."""
        unreadable, self._unreadable_before = self._unreadable_before, self.unreadable
        for topic in {'imu': ['imu'], 'tf': ['/tf', '/tf_static']}.get(self.source, ()):
            if why := self.hub.disagreement(topic):
                return why
        if self._imu is not None:
            topic = self._imu.topic_name
            if other := wrong_type(self.hub, topic, cdr.IMU):
                return other
            if (publishers := self.hub.count_publishers(topic)) > 1:
                return f'{topic} has {publishers} publishers; their readings are mixed'
        if self.unreadable == unreadable:
            return ''
        what = 'transforms' if self.source == 'tf' else 'messages of the IMU'
        return f'{self.unreadable} {what} could not be read, or hold no numbers'

    def problem(self) -> str:
        """Say why no specific force has come; empty where it is not known."""
        if self.source == 'imu' and not (self._newest or self.unreadable):
            return why_silent(self.hub, 'imu', cdr.IMU)
        self._tree.lower = self.frames().wrench_frame
        if self.source == 'tf' and not self._tree.lower:
            return 'the wrench has no frame_id, which TF is to turn; set it in its driver'
        return self._tree.missing() if self.source == 'tf' and self._handed_out_ns is None else ''

    def timing_doubts(
        self, wrench_ns: int | None, grown: Mapping[str, int], mass_kg: float
    ) -> Iterator[str]:
        """
        Say that specific force is missing, of another clock, or seldom; once a report.

        Takes the stamp of the newest wrench, ns, how many ``forces`` and wrenches ``came`` since
        the last report, how many of these ``missed`` a force, and what is taken off.
        """
        is_new, wrenches = grown['forces'] > 0, max(grown['came'], 1)
        newest, rests = self.forces.newest, 'wrench_external rests'
        if newest is None:
            yield f'{self.problem() or "no specific force has come"}; {rests}'
            return
        if is_new:
            self._felt.append(newest[1])
        else:
            self._felt.clear()
        if is_new and grown['came'] and wrench_ns is not None:
            self._ahead_s.append((newest[0] - wrench_ns) / NANOSECONDS)
        else:
            self._ahead_s.clear()
        if grown['missed'] / wrenches > _MISSED_SHARE and wrench_ns is not None:
            apart_s = abs(wrench_ns - newest[0]) / NANOSECONDS
            if apart_s > FORCE_APART_S and is_new:
                yield f'wrench and specific force are {apart_s:.0f} s apart: two clocks; {rests}'
            else:
                yield f'specific force is older than gravity.timeout, or stays away; {rests}'
        elif len(self._ahead_s) == _REPORTS and (ahead_s := min(self._ahead_s)) > _AHEAD_S:
            yield (
                f'specific force is stamped {ahead_s:.1f} s ahead of the wrench, so that the '
                'weight that is taken off may be as old: two clocks, or the wrench comes late; '
                'synchronise them, or look at its network'
            )
        step_s, step = self.forces.last_step
        wrong_n, limit_n = mass_kg * step / 2, mass_kg * _STEP_SHARE * GRAVITY
        limit_n = min(limit_n, _STEP_N) if self.source == 'tf' else limit_n
        if 0 < grown['forces'] / wrenches < 0.5 and wrong_n > limit_n:
            yield (
                f'specific force comes every {step_s:.2g} s, so that {wrong_n:.2g} N of the '
                'weight that is taken off are wrong in motion; let it come faster'
            )

    def value_doubts(self, frame: ForceFrame) -> Iterator[str]:
        """Say that it is mixed or frozen, or not as large as gravity in the frame of a payload."""
        self._recent.look(self._before, self._newest)
        if mixed := self._recent.mixed:
            yield f'specific force of {mixed}'
        if len(self._felt) < _REPORTS:
            return
        # Of a simulated one at rest, without noise, all are alike.
        simulated = self.hub.get_parameter('use_sim_time').value
        if len(set(self._felt)) == 1 and self.source == 'imu' and not simulated:
            yield 'specific force has not changed by a bit for seconds; is the IMU frozen?'
        off = np.linalg.norm(frame.turn(np.array(self._felt)), axis=1) / GRAVITY - 1
        if min(off) > _NORM_DEVIATION or max(off) < -_NORM_DEVIATION:
            yield (
                f'specific force is {off[-1]:+.0%} off gravity, and so is the weight that is '
                'taken off; check its unit, or call ~/identify_payload'
            )
