"""Specific force, live: of an IMU, or by TF."""

from collections.abc import Callable
from functools import partial
import math
from typing import Any

import numpy as np
from sensor_msgs.msg import Imu

from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.payload.weight import ForceFrame, FrameIds
from wrist_ft_comp.ros import messages
from wrist_ft_comp.ros.raw_node import RawNode, waiting
from wrist_ft_comp.ros.topic_types import load_type, wrong_type
from wrist_ft_comp.wire.cdr import ACCELERATION, IMU, IMU_DOUBLES, locate, ROTATION, TF
from wrist_ft_comp.wire.tf_messages import Layouts
from wrist_ft_comp.wire.tf_tree import GravityByTf

#: TF comes in pieces of several publishers; it is looked at no more often than this, ns, and what
#: is too old is dropped once in so many pieces.
_STEP_NS, _TIDY = 10_000_000, 100

#: Takes a stamp, ns, 0 without one, specific force, m/s², and speed of rotation, rad/s, if known.
OnForce = Callable[[int, tuple[float, float, float], float | None], None]


class GravitySource:
    """
    Hears what the parameters ``gravity.…`` say, and gives each specific force to a callback.

    As field_inputs, it polls what ``subscribe_unserved`` keeps: an IMU may send at a kilohertz.
    ``frame`` tells the name of the wrench's frame; '' before it is known.

    Raises
    ------
    SettingsError
        When TF is asked for and cannot be had.

    """

    def __init__(
        self,
        chosen: dict[str, Any],
        node: RawNode,
        frame: Callable[[], str],
        on_force: OnForce,
        guard: Callable[[Callable[..., Any]], Callable[..., Any]] = lambda callback: callback,
    ) -> None:
        #: Messages that could not be read, or held no numbers.
        self.unreadable = 0
        self._node, self._frame, self._on_force, self._guard = node, frame, on_force, guard
        self._told_ns: int | None = None
        self._pieces = self._unreadable_before = 0
        self._by_tf = chosen['gravity.source'] == 'tf'
        #: Of an IMU: how its frame, that of the newest message, is turned in the wrench's.
        self._tree = GravityByTf(chosen['gravity.frame'], frame())
        self._imu: Any = None
        self._newest = b''
        if chosen['gravity.source'] == 'imu':
            self._imu = node.subscribe_unserved(Imu, 'imu', messages.FAST_SENSOR)
            try:
                self._subscribe('/tf_static')
            except SettingsError as error:  # a payload that was learnt knows
                node.log.info(f'TF is not asked how the IMU is mounted: {error}')
        elif self._by_tf:
            if not chosen['gravity.frame']:
                raise SettingsError(
                    'gravity.source is tf, and gravity.frame is empty; expected the frame whose z '
                    'is up. Set it at start-up with -p gravity.frame:=base_link or the like.'
                )
            for topic in ('/tf', '/tf_static'):
                self._subscribe(topic)

    def _subscribe(self, topic: str) -> None:
        """Hear transforms."""
        static = topic == '/tf_static'
        take = self._guard(partial(self._on_tf, Layouts(), static=static))
        qos = messages.LATCHED if static else messages.FAST_SENSOR
        self._node.subscribe(load_type(topic, TF), topic, take, qos)

    def poll(self) -> None:
        """Take what an IMU has sent."""
        if self._imu is not None:
            for data in waiting(self._imu):
                self._on_imu(data)

    def frames(self) -> FrameIds:
        """Tell the frame of the specific force, which by TF is the upper one, and the wrench's."""
        if self._by_tf or not self._newest:
            return FrameIds(self._tree.upper if self._by_tf else '', self._frame())
        return FrameIds(locate(self._newest, IMU_DOUBLES).frame_id(self._newest), self._frame())

    def mount(self) -> ForceFrame | None:
        """Tell how TF turns specific force into the wrench's frame; None where it does not."""
        if self._by_tf:
            return ForceFrame()
        names = self.frames()
        if not self._newest or not names.wrench_frame:
            return None
        self._tree.lower, self._tree.upper = names
        (rotation,) = self._tree.rotations(np.zeros(1, np.int64))
        return ForceFrame(rotation, source='imu') if np.isfinite(rotation).all() else None

    def _on_imu(self, data: bytes) -> None:
        """Take one sensor_msgs/Imu; a gyroscope that is not there leaves zeros."""
        try:
            stamp_ns, numbers = locate(data, IMU_DOUBLES).decode(data)
        except RecordingError:
            self.unreadable += 1
            return
        self._newest = data
        x, y, z = numbers[ACCELERATION]
        speed = math.hypot(*numbers[ROTATION])
        if math.isfinite(x + y + z):
            self._on_force(stamp_ns, (x, y, z), speed if speed > 0 else None)
        else:
            self.unreadable += 1

    def _on_tf(self, layouts: Layouts, data: bytes, *, static: bool) -> None:
        """Take one tf2_msgs/TFMessage; tells specific force of where all transforms are there."""
        if self._by_tf:
            self._tree.lower = self._frame()
        try:
            layout = layouts.find(data)
        except RecordingError:
            self.unreadable += 1
            return
        needed = self._tree.needed(layout.frames, static=static)
        for transforms in layout.decode([data], needed):
            self._tree.add(transforms, static=static)
        self._pieces += 1
        if self._pieces % _TIDY == 0:
            self._tree.forget()
        if self._by_tf and needed:
            self._tell()

    def _tell(self) -> None:
        """Tell specific force of where all transforms are there, if that is news."""
        at_ns = self._tree.settled_ns()
        told_ns = self._told_ns
        # Stamps that ran back are a simulation begun anew.
        if at_ns is None or (told_ns is not None and 0 <= at_ns - told_ns < _STEP_NS):
            return
        self._told_ns = at_ns
        force, speed = self._tree.read(np.array([at_ns]))
        if math.isfinite(force[0, 0]):
            x, y, z = force[0].tolist()
            self._on_force(at_ns, (x, y, z), float(speed[0]) if math.isfinite(speed[0]) else None)

    def doubt(self) -> str:
        """Say what is wrong with what is sent, since the last time; empty when nothing is."""
        unreadable, self._unreadable_before = self._unreadable_before, self.unreadable
        if self._imu is not None:
            topic = self._imu.topic_name
            if other := wrong_type(self._node, topic, IMU):
                return other
            if (publishers := self._node.count_publishers(topic)) > 1:
                return f'{topic} has {publishers} publishers; their readings are mixed'
        if self.unreadable == unreadable:
            return ''
        what = 'transforms' if self._by_tf else 'messages of the IMU or transforms'
        return f'{self.unreadable} {what} could not be read, or hold no numbers'

    def problem(self) -> str:
        """Say why TF tells nothing; empty where it tells something, or is not asked."""
        if not self._by_tf or self._told_ns is not None or not self._frame():
            return ''
        return self._tree.missing()
