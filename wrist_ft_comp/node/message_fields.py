"""Takes temperatures: sensor_msgs/Temperature, and numbers in messages of any type."""

from collections.abc import Callable
import math
from typing import Any

from wrist_ft_comp.errors import RecordingError, SettingsError, WristFtCompError
from wrist_ft_comp.ros.hub import Hub, Part
from wrist_ft_comp.ros.rclpy_internals import waiting
from wrist_ft_comp.ros.topics import (
    load_type,
    no_temperature,
    other_version,
    short,
    SLOW_SENSOR,
    types_on,
    unpublished,
)
from wrist_ft_comp.wire.cdr import TEMPERATURE
from wrist_ft_comp.wire.message_layout import (
    define_installed,
    Definitions,
    follow,
    NumberReader,
)
from wrist_ft_comp.wire.temperature_source import TemperatureSource

#: Takes a thermometer, counted from 0, a stamp, ns, 0 if it was not filled and None where the type
#: has none, and a temperature, °C.
Take = Callable[[int, int | None, float], None]


class TemperatureTopic:
    """
    One topic of a part, by its full name, and the thermometers in its messages, by number from 0.

    One of sensor_msgs/Temperature is subscribed to at once, and every message is taken as it
    comes. Any other is subscribed to when a publisher tells the type. It may be fast, and to be
    woken costs much: its newest message is taken ten times a second.
    """

    def __init__(
        self, part: Part, topic: str, sources: dict[int, TemperatureSource], take: Take
    ) -> None:
        self.sources = sources
        #: Messages of which some temperature could not be read.
        self.unreadable = 0
        #: Why nothing can be read, and why a thermometer could not be.
        self._problem, self._misread = '', dict[int, str]()
        self._hub: Hub = part.hub
        self._part, self._topic, self._take = part, topic, take
        self._name = next(iter(sources.values())).topic
        self._is_plain = not all(source.path for source in sources.values())
        #: Of the messages that are subscribed to; empty while none are.
        self._type = ''
        self._definitions: Definitions = {}
        self._subscription: Any = None
        self._publishers = 0
        #: Whether no message is taken until the next look: to say what is missing takes time.
        self._is_resting = False
        if self._is_plain:
            self._subscribe(TEMPERATURE)

    def poll(self) -> None:
        """Take what came, and look as soon as publishers came or went; ten times a second."""
        publishers = self._hub.count_publishers(self._topic)
        if publishers != self._publishers:
            self._publishers = publishers
            self.look()
        if self._subscription is not None and not (self._is_plain or self._is_resting):
            for data in waiting(self._subscription):
                self.read(data)

    def look(self) -> None:
        """Ask which type the topic has, and subscribe when that is new; takes half a ms."""
        self._is_resting = False
        types = types_on(self._hub, self._topic)
        if not types:
            self._misread.clear()
            self._problem = '' if self._type else unpublished(self._hub, self._topic)
        elif not self._type:
            try:
                self._subscribe(TEMPERATURE if TEMPERATURE in types else types[0])
            except WristFtCompError as error:
                self._problem = str(error).rstrip('.')
        elif self._type not in types:
            # The new type comes at the next look: until the executor has let go, DDS has the old.
            # In one process, DDS has one type per topic, which may be another sensor's, too.
            self._hub.destroy_subscription(self._subscription)
            self._subscription, self._type = None, ''
        if self._type:
            self._problem = other_version(self._hub, self._topic)

    def _subscribe(self, name: str) -> None:
        """Subscribe to messages of a type; WristFtCompError where they cannot be had."""
        if self._is_plain and name != TEMPERATURE:
            raise SettingsError(no_temperature(self._hub, self._topic))
        kind = load_type(self._topic, name)
        self._definitions = define_installed(self._topic, name)
        paths = [source.number for source in self.sources.values()]
        self._reader = NumberReader(self._definitions, name, paths)
        if self._is_plain:
            take = self._hub.guarded(self._part, self.read)
            self._subscription = self._hub.subscribe(kind, self._name, take, SLOW_SENSOR)
        else:
            self._subscription = self._hub.subscribe_unserved(kind, self._name)
        self._type = name

    def read(self, data: bytes) -> None:
        """Take the temperatures of one message."""
        if self._problem:
            return
        try:
            (stamp_ns,), (numbers,) = (part.tolist() for part in self._reader.read([data]))
        except RecordingError:
            self.unreadable += 1
            sentence = (
                f"a message of {self._topic} can't be read as {short(self._type)}; is the package "
                'here of the same version as where it comes from?'
            )
            self._misread = dict.fromkeys(self.sources, sentence)
            return
        stamped = stamp_ns if self._reader.has_header else None
        for (thermometer, source), number in zip(self.sources.items(), numbers, strict=True):
            if math.isnan(number):
                layout = follow(self._definitions, self._type, data)
                if layout.find(source.number) is None:
                    self.unreadable, self._is_resting = self.unreadable + 1, True
                    self._misread[thermometer] = source.missing(layout).rstrip('.')
                    continue
            self._misread.pop(thermometer, None)
            self._take(thermometer, stamped, source.celsius(number))

    def problems(self) -> dict[int, str]:
        """Say why temperatures cannot be read, by thermometer."""
        if self._problem:
            return dict.fromkeys(self.sources, self._problem)
        return self._misread
