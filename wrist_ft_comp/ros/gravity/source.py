"""Specific force, live: of an IMU, or by TF."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
import math
from typing import Any

import numpy as np
from sensor_msgs.msg import Imu

from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.files.bags.tf_messages import decode_transforms
from wrist_ft_comp.files.cdr import ACCELERATION, IMU_DOUBLES, locate, ROTATION, TF
from wrist_ft_comp.model.payload.tf_tree import GravityByTf
from wrist_ft_comp.model.payload.weight import ForceFrame, FrameIds
from wrist_ft_comp.ros import messages
from wrist_ft_comp.ros.inputs.raw_node import waiting
from wrist_ft_comp.ros.inputs.topic_types import load_type

#: TF comes in pieces of several publishers; it is looked at no more often than this, ns, and what
#: is too old is dropped once in so many pieces.
_STEP_NS, _TIDY = 10_000_000, 100

#: Takes type, topic, callback for serialized messages, and quality of service.
Subscribe = Callable[[Any, str, Callable[[bytes], None], Any], Any]
#: Takes a stamp, ns, 0 without one, specific force, m/s², and speed of rotation, rad/s, if known.
OnForce = Callable[[int, tuple[float, float, float], float | None], None]


class GravitySource:
    """Hears what the parameters ``gravity.…`` say, and gives each specific force to a callback."""

    # As field_inputs, it polls what ``subscribe_unserved`` keeps: an IMU may send at a kilohertz.
    # The frame, of which ``frame`` tells the name, is that of the wrench; '' before it is known.
    # SettingsError when TF is asked for and cannot be had.

    def __init__(
        self,
        chosen: dict[str, Any],
        subscribe: Subscribe,
        subscribe_unserved: Callable[[Any, str, Any], Any],
        frame: Callable[[], str],
        on_force: OnForce,
    ) -> None:
        #: Messages that could not be read, or held no numbers.
        self.unreadable = 0
        self._frame, self._on_force = frame, on_force
        self._told_ns: int | None = None
        self._pieces = 0
        self._by_tf = chosen['gravity.source'] == 'tf'
        #: Of an IMU: how its frame, that of the newest message, is turned in the wrench's.
        self._tree = GravityByTf(chosen['gravity.frame'], frame())
        self._imu: Any = None
        self._newest = b''
        static = partial(self._on_tf, static=True)
        if chosen['gravity.source'] == 'imu':
            self._imu = subscribe_unserved(Imu, 'imu', messages.FAST_SENSOR)
            with suppress(SettingsError):  # no TF here; a payload that was learnt knows
                subscribe(load_type('/tf_static', TF), '/tf_static', static, messages.LATCHED)
        elif self._by_tf:
            if not chosen['gravity.frame']:
                raise SettingsError(
                    'gravity.source is tf, and gravity.frame is empty; expected the frame whose z '
                    'is up. Set it at start-up with -p gravity.frame:=base_link or the like.'
                )
            kind = load_type('/tf', TF)
            subscribe(kind, '/tf', partial(self._on_tf, static=False), messages.FAST_SENSOR)
            subscribe(kind, '/tf_static', static, messages.LATCHED)

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

    def _on_tf(self, data: bytes, *, static: bool) -> None:
        """Take one tf2_msgs/TFMessage; tells specific force of where all transforms are there."""
        try:
            for transforms in decode_transforms([data]):
                self._tree.add(transforms, static=static)
        except RecordingError:
            self.unreadable += 1
        if not self._by_tf:
            return
        self._pieces += 1
        if self._pieces % _TIDY == 0:
            self._tree.forget()
        self._tree.lower = self._frame()
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

    def problem(self) -> str:
        """Say why TF tells nothing; empty where it tells something, or is not asked."""
        if not self._by_tf or self._told_ns is not None or not self._frame():
            return ''
        return self._tree.missing()
