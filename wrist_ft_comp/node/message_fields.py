"""
Takes in what lies in messages of any type: raw wrenches, and temperatures, which are polled.

Also takes sensor_msgs/Temperature.
"""

from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from typing import Any

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Temperature

from wrist_ft_comp.errors import RecordingError, SettingsError, WristFtCompError
from wrist_ft_comp.recordings.bag import Connection, define_installed
from wrist_ft_comp.ros.hub import Hub
from wrist_ft_comp.ros.qos import FAST_SENSOR, SLOW_SENSOR
from wrist_ft_comp.ros.rclpy_internals import waiting
from wrist_ft_comp.ros.topic_types import (
    load_type,
    no_temperature,
    other_version,
    short,
    types_on,
)
from wrist_ft_comp.wire.temperature_source import header_stamp_ns, TemperatureSource
from wrist_ft_comp.wire.wrench_source import WrenchReader, WrenchSource

#: Takes a thermometer, counted from 0, a stamp, ns, 0 if it was not filled and None where the type
#: has none, and a temperature, °C.
Take = Callable[[int, int | None, float], None]


class PlainTopic:
    """A topic of sensor_msgs/Temperature."""

    def __init__(self, node: Hub, topic: str, name: str, take: Callable[[bytes], None]) -> None:
        #: Why its type is wrong; empty when it is right, or not known.
        self.problem = ''
        self._node, self._topic, self._name, self._take = node, topic, name, take
        self._subscription: Any = self._subscribe()

    def _subscribe(self) -> Any:
        return self._node.subscribe(Temperature, self._name, self._take, SLOW_SENSOR)

    def look(self) -> None:
        """
        Subscribe while the topic has this type, or may have it; called about once a second.

        In one process, DDS has one type per topic: to subscribe with a wrong one would cut off all
        other sensors of the process.
        """
        self.problem = no_temperature(self._node, self._topic)
        if self.problem and self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None
        elif not self.problem and self._subscription is None:
            with suppress(SettingsError):  # another sensor has to let go of it first
                self._subscription = self._subscribe()


class AnyTopic:
    """A topic, by full and by given name, that is subscribed to once its type is known."""

    def __init__(self, node: Hub, topic: str, name: str) -> None:
        #: Why nothing can be read; empty when something can.
        self.problem = ''
        #: Whether it has a publisher.
        self.published = False
        self._node, self._topic, self._name = node, topic, name
        self._type = ''
        self._subscription: Any = None

    def look(self) -> None:
        """Ask which type the topic has, and subscribe when that is new."""
        types = types_on(self._node, self._topic)
        self.published = bool(types)
        if not types:
            unseen = f'{self._topic} has no publisher yet, so what it carries is not known'
            self.problem = '' if self._type else unseen
        elif not self._type:
            self._subscribe(types[0])
        elif self._type not in types:
            # The new type comes at the next look: until the executor has let go, DDS has the old.
            self._node.destroy_subscription(self._subscription)
            self._subscription, self._type = None, ''

    def _subscribe(self, name: str) -> None:
        try:
            self._subscription = self._open(load_type(self._topic, name), name)
        except WristFtCompError as error:
            self.problem = str(error).rstrip('.')
            return
        self._type, self.problem = name, ''

    def _open(self, kind: Any, _name: str) -> Any:
        """Subscribe to messages of a type, by its class and its name."""
        return self._node.subscribe_unserved(kind, self._name)


class WrenchTopic(AnyTopic):
    """Makes geometry_msgs/WrenchStamped, for ``take``, of what one topic's messages hold."""

    def __init__(
        self, node: Hub, topic: str, source: WrenchSource, take: Callable[[bytes], None]
    ) -> None:
        super().__init__(node, topic, source.topic)
        #: Messages without a wrench, and what was wrong with the last one.
        self.unreadable, self.misread = 0, ''
        self._source, self._take, self._publishers = source, take, 0

    def poll(self) -> None:
        """Look as soon as publishers came or went, ten times a second; a look takes half a ms."""
        publishers = self._node.count_publishers(self._topic)
        if publishers != self._publishers:
            self._publishers = publishers
            self.look()

    def look(self) -> None:
        """Look for publishers that came, or came back with another type or version."""
        super().look()
        if self._type:
            self.problem = other_version(self._node, self._topic)

    def _open(self, kind: Any, name: str) -> Any:
        """Subscribe to every message, as to raw wrenches."""
        definitions = define_installed(Connection(0, self._topic, name, 0, None))
        reader = WrenchReader(self._source, name, definitions)
        return self._node.subscribe(
            kind, self._name, partial(self._on_message, reader), FAST_SENSOR
        )

    def _on_message(self, reader: WrenchReader, data: bytes) -> None:
        """Hand on the wrench of one message."""
        if self.problem:
            return
        try:
            wrench = reader.stamped(data, self._node.now_ns())
        except (RecordingError, SettingsError) as error:
            self.unreadable, self.misread = self.unreadable + 1, str(error).rstrip('.')
            return
        self._take(wrench)


class FieldTopic(AnyTopic):
    """One topic, and the thermometers in its messages, by number from 0."""

    def __init__(self, node: Hub, topic: str, name: str) -> None:
        super().__init__(node, topic, name)
        self.thermometers: dict[int, TemperatureSource] = {}
        #: Whether no message is read until the next look, because the last one was unreadable.
        self._resting = False

    def look(self) -> None:
        """Ask which type the topic has, and subscribe when that is new."""
        self._resting = False
        super().look()

    def newest(self) -> Any:
        """Take the newest message that came since the last time; None when there is none."""
        if self._subscription is None:
            return None
        newest = deque(waiting(self._subscription), maxlen=1)
        if not newest or self._resting:
            return None
        self.problem = other_version(self._node, self._topic)
        if not self.problem:
            try:
                return deserialize_message(newest[0], self._subscription.msg_type)
            except RuntimeError:
                self.problem = (
                    f"a message of {self._topic} can't be read as {short(self._type)}; is the "
                    'package here of the same version as where it comes from?'
                )
        self._resting = True  # the middleware writes a line for every one that it cannot read
        return None


class FieldInputs:
    """
    All thermometers: full names of their topics, and where in the messages they are.

    Those in messages of any type are polled, because being woken costs much: ``take`` is given
    their temperatures. ``take_bytes`` is given what comes on topics of sensor_msgs/Temperature.
    """

    def __init__(
        self,
        node: Hub,
        sources: Iterable[tuple[str, TemperatureSource]],
        take: Take,
        take_bytes: Callable[[int, bytes], None],
    ) -> None:
        #: Messages of which some temperature could not be read.
        self.unreadable = 0
        self._take = take
        self._topics: dict[str, FieldTopic] = {}
        self._plain: dict[int, PlainTopic] = {}
        for j, (topic, source) in enumerate(sources):
            if source.path:
                new = FieldTopic(node, topic, source.topic)
                self._topics.setdefault(topic, new).thermometers[j] = source
            else:
                self._plain[j] = PlainTopic(node, topic, source.topic, partial(take_bytes, j))
        #: Why a thermometer could not be read; and which are not read until the next look, because
        #: finding out what there is instead takes time.
        self._misread: dict[int, str] = {}
        self._resting: set[int] = set()

    def look(self) -> None:
        """Look for publishers that came, or came back with another type; about once a second."""
        self._resting.clear()
        for topic in self._topics.values():
            topic.look()
            for thermometer in () if topic.published else topic.thermometers:
                self._misread.pop(thermometer, None)
        for plain in self._plain.values():
            plain.look()

    def poll(self) -> None:
        """Take the newest temperatures; about ten times a second."""
        for topic in self._topics.values():
            message = topic.newest()
            for j, source in topic.thermometers.items() if message is not None else ():
                if j not in self._resting:
                    self._read(j, source, message)

    def _read(self, thermometer: int, source: TemperatureSource, message: Any) -> None:
        try:
            celsius = source.read(message)
        except SettingsError as error:
            self._misread[thermometer] = str(error).rstrip('.')
            self._resting.add(thermometer)
            self.unreadable += 1
            return
        self._misread.pop(thermometer, None)
        self._take(thermometer, header_stamp_ns(message), celsius)

    def problems(self) -> dict[int, str]:
        """Say why temperatures cannot be read, by thermometer, counted from 0."""
        found = dict(self._misread)
        found.update((j, plain.problem) for j, plain in self._plain.items() if plain.problem)
        for topic in self._topics.values():
            if topic.problem:
                found.update(dict.fromkeys(topic.thermometers, topic.problem))
        return found
