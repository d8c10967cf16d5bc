"""The part that publishes ~/correction: what a controller adds to the raw wrench by itself."""

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import WrenchStamped
import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from wrist_ft_comp.node.inputs import Newest
from wrist_ft_comp.ros.hub import Hub, Part
from wrist_ft_comp.ros.topics import wrench_message
from wrist_ft_comp.stream.compensator import Compensator

#: How often ~/correction is published, Hz: for at most one period, a controller that was just
#: activated sees the raw wrench.
RATE_HZ = 10.0


class CorrectionTopic(Part):
    """
    Publishes, RATE_HZ times a second, the compensated minus the raw wrench of the newest wrench.

    A controller that adds its last message to each raw wrench, such as admittance_controller by
    its ~/wrench_reference, is compensated without the wrench going through this node.
    """

    title = 'correction'
    topics = (('~/correction', 'compensated minus raw, ten times a second: what controllers add'),)
    hub: Hub

    def __init__(self, compensator: Compensator, newest: Callable[[], Newest | None]) -> None:
        self._compensator, self._newest = compensator, newest
        self._publisher: Any = None

    def start(self) -> None:
        """Offer the topic."""
        self._publisher = self.hub.advertise(WrenchStamped, '~/correction')
        # A steady clock: a controller waits for it where simulated time stands still, too.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        publish = self.hub.guarded(self, self.publish)
        self.hub.create_timer(1 / RATE_HZ, publish, clock=steady)

    def publish(self) -> None:
        """
        Publish, unless there was no wrench yet or the live model's drift has not been found.

        Then the controller holds the last one, which a restarted node sent before it ended.
        """
        stream, newest = self._compensator, self._newest()
        if newest is None or (stream.model is not None and not stream.compensating):
            return
        stamp_ns, raw, _ = newest
        correction = np.subtract(stream.correct(stamp_ns, raw), raw)
        self._publisher.publish(wrench_message(stamp_ns, self.hub.hardware_id(), correction))
