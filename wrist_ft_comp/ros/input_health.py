"""Faults that no single message shows, looked for beside the stream."""

from collections.abc import Sequence
import math
import time
from typing import Any, NamedTuple, TYPE_CHECKING

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import qos_policy_name_from_kind

from wrist_ft_comp.model.signals import NANOSECONDS
from wrist_ft_comp.model.stream_grid import CompletedCells
from wrist_ft_comp.stream.input_checks import SensorWatch, ThermometerWatch

if TYPE_CHECKING:
    from wrist_ft_comp.ros.compensator_node import CompensatorNode


class Period(NamedTuple):
    """
    What happened since the last report.

    Attributes
    ----------
    in_hz, out_hz, warm_hz : float
        Usable wrenches that came, wrenches that went, and finite temperatures, per second.
    unusable : int
        Wrenches that were dropped.
    temperatures : int
        Finite temperatures of all thermometers.
    rejected : int
        Temperatures whose stamp did not increase, or leapt and came alone.
    unusable_temperatures : int
        Temperatures that were dropped because no sensor reads them.

    """

    in_hz: float
    out_hz: float
    warm_hz: float
    unusable: int
    temperatures: int
    rejected: int
    unusable_temperatures: int


class Counts:
    """
    What came in and what went out.

    Parameters
    ----------
    thermometers : int
        Number of thermometers J.

    """

    def __init__(self, thermometers: int) -> None:
        self.wrenches = 0
        self.published = 0
        self.malformed = 0
        self.not_finite = 0
        self.bad_temperatures = 0
        self.bad_references = 0
        self.temperatures = 0
        self.last_temperature: list[float | None] = [None] * thermometers
        self._wrench_stamp_ns = self._temperature_stamp_ns = 0
        self._before = (time.monotonic(), 0, 0, 0, 0, 0, 0)

    def wrench(self, stamp_ns: int) -> None:
        """Count one usable wrench."""
        self.wrenches += 1
        self._wrench_stamp_ns = stamp_ns

    def temperature(self, thermometer: int, stamp_ns: int) -> None:
        """Count one finite temperature and remember when it came."""
        self.temperatures += 1
        self._temperature_stamp_ns = stamp_ns
        self.last_temperature[thermometer] = time.monotonic()

    @property
    def apart_s(self) -> float:
        """How far the stamps of the newest wrench and temperature are apart, s; 0 before both."""
        if not (self.wrenches and self.temperatures):
            return 0.0
        return abs(self._wrench_stamp_ns - self._temperature_stamp_ns) / NANOSECONDS

    def period(self, rejected: int) -> Period:
        """Count since the last call; rejected is what the core has counted so far."""
        unusable = self.malformed + self.not_finite
        now = (
            time.monotonic(), self.wrenches, self.published, unusable, self.temperatures, rejected,
            self.bad_temperatures,
        )  # fmt: skip
        before, self._before = self._before, now
        elapsed, came, went, *rest = (a - b for a, b in zip(now, before, strict=True))
        elapsed = max(elapsed, 1e-9)
        warm = now[4] - before[4]
        return Period(came / elapsed, went / elapsed, warm / elapsed, *map(int, rest))


#: An event is worth a warning for this long, s.
_RECENT_S = 10.0


class InputWatch:
    """
    Watches what comes in, and who sends it.

    Parameters
    ----------
    node : CompensatorNode
        The owner.
    thermometers : int
        Number of thermometers J.

    """

    def __init__(self, node: 'CompensatorNode', thermometers: int) -> None:
        self.sensor = SensorWatch()
        self.thermometers = ThermometerWatch(thermometers)
        #: Thermometer (counted from 1) and value of the newest unusable reading.
        self.last_unusable: tuple[int, float] | None = None
        #: Whether the newest reading of each thermometer had no stamp.
        self.unstamped = [False] * thermometers
        #: How often the frame changed, and from what to what the last time.
        self.frame_changes = 0
        self.last_frames = ('', '')
        #: Per topic, the policy on which some other side and this node do not agree.
        self.incompatible: dict[str, str] = {}
        #: When a new wrench was seen last, s of the steady clock.
        self.last_seen: float | None = None
        self._node = node
        self._frame = ''
        self._received = 0
        #: Count of each kind of event, and when it last grew, s of the steady clock.
        self._events: dict[str, tuple[int, float]] = {}

    @property
    def recent(self) -> set[str]:
        """Which events happened lately; their names stand in _note_events."""
        now = time.monotonic()
        return {kind for kind, (_, at) in self._events.items() if at > now - _RECENT_S}

    def _note_events(self) -> None:
        """Remember when the counts of events grew."""
        tracker, now = self._node.compensator.tracker, time.monotonic()
        counts = {
            'frame': self.frame_changes,
            'ran_back': self.sensor.ran_back,
            'leapt': self.sensor.leapt,
            'jump': sum(self.thermometers.jumps),
            'stray temperature': tracker.timestamp_filter.strays,
            'temperature leapt': tracker.timestamp_filter.leaps + tracker.grid.restarts,
        }
        for kind, count in counts.items():
            before, at = self._events.get(kind, (0, -math.inf))
            self._events[kind] = (count, now if count > before else at)

    def unusable(self, thermometer: int, value: float) -> None:
        """Remember a reading, °C, of a thermometer counted from 0, that was dropped."""
        self.last_unusable = thermometer + 1, value

    def cells(self, completed: list[CompletedCells]) -> None:
        """Look at completed thermal cells."""
        period_ns = self._node.compensator.tracker.grid.period_ns
        for each in completed:
            self.thermometers.look(each.temperature_c, each.count, period_ns)

    def poll(self) -> None:
        """Look at the newest wrench, and at its frame."""
        newest = self._node.compensator.newest
        if newest is not None:
            self._look(*newest)
        self._note_events()

    def _look(self, at_ns: int, raw: Sequence[float]) -> None:
        """Look at a wrench, and at its frame."""
        received = self._node.counts.wrenches
        if received != self._received:
            self._received, self.last_seen = received, time.monotonic()
        stamp_ns = at_ns if self._node.stamped else 0
        self.sensor.look(received, stamp_ns, raw)
        frame = self._node.frame_id
        if frame != self._frame:
            if self._frame:
                self.frame_changes += 1
                self.last_frames = (self._frame, frame)
            self._frame = frame

    def subscription_events(self, topic: str) -> SubscriptionEventCallbacks:
        """Make what tells of publishers that cannot be heard on a topic, by its relative name."""

        def tell(event: Any) -> None:
            policy = self._note(topic, event)
            self._node.console.error(
                f'a publisher of {topic} offers less {policy} than is asked for: nothing of it '
                f'will be received. Set qos_overrides.…/{topic}.subscription.{policy} of this '
                'node, or the quality of service of the publisher.'
            )

        return SubscriptionEventCallbacks(incompatible_qos=tell)

    def publisher_events(self, topic: str) -> PublisherEventCallbacks:
        """Make what tells of subscribers that cannot hear a topic, by its relative name."""

        def tell(event: Any) -> None:
            policy = self._note(topic, event)
            self._node.console.error(
                f'a subscriber of {topic} asks for more {policy} than is offered: it will receive '
                f'nothing. Set qos_overrides.…/{topic}.publisher.{policy} of this node, or the '
                'quality of service of the subscriber.'
            )

        return PublisherEventCallbacks(incompatible_qos=tell)

    def _note(self, topic: str, event: Any) -> str:
        """Remember a mismatch; return the policy's name."""
        policy = str(qos_policy_name_from_kind(event.last_policy_kind)).lower()
        self.incompatible[topic] = policy
        return policy
