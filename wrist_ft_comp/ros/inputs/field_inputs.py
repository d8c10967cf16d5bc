"""Temperatures that are numbers in messages of any type, polled: being woken costs much."""

from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

from rclpy.serialization import deserialize_message

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.model.temperature_source import header_stamp_ns, TemperatureSource
from wrist_ft_comp.ros.inputs.raw_node import RawNode, waiting
from wrist_ft_comp.ros.inputs.topic_types import load_type, short, types_on

#: Takes a thermometer, counted from 0, a stamp, ns, or 0 without one, and a temperature, °C.
Take = Callable[[int, int, float], None]


class FieldTopic:
    """One topic, and the thermometers in its messages, by number from 0."""

    def __init__(self, node: RawNode, topic: str, name: str) -> None:
        self.thermometers: dict[int, TemperatureSource] = {}
        #: Why nothing can come of it; empty when something can.
        self.problem = ''
        self._node, self._topic, self._name = node, topic, name
        self._type = ''
        self._subscription: Any = None

    def look(self) -> None:
        """Look what the topic carries, and subscribe if that is news."""
        types = types_on(self._node, self._topic)
        if not types and not self._type:
            self.problem = f'{self._topic} has no publisher yet, so what it carries is not known'
        if not types or self._type in types:
            return
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
        self._subscription, self._type = None, ''
        try:
            kind = load_type(self._topic, types[0])
            self._subscription = self._node.subscribe_unserved(kind, self._name)
        except SettingsError as error:
            self.problem = str(error).rstrip('.')
            return
        self._type, self.problem = types[0], ''

    def newest(self) -> Any:
        """Take the newest message that came since the last time; None when there is none."""
        if self._subscription is None:
            return None
        newest = deque(waiting(self._subscription), maxlen=1)
        if not newest:
            return None
        try:
            message = deserialize_message(newest[0], self._subscription.msg_type)
        except RuntimeError:
            self.problem = (
                f"a message of {self._topic} can't be read as {short(self._type)}; is the package "
                'here of the same version as where it comes from?'
            )
            return None
        self.problem = ''
        return message


class FieldInputs:
    """All thermometers that are fields, of all thermometers: full names of topics, and where."""

    def __init__(
        self,
        node: RawNode,
        sources: Iterable[tuple[str, TemperatureSource]],
        take: Take,
    ) -> None:
        #: Messages of which some temperature could not be read.
        self.unreadable = 0
        self._take = take
        self._topics: dict[str, FieldTopic] = {}
        for j, (topic, source) in enumerate(sources):
            if source.path:
                new = FieldTopic(node, topic, source.topic)
                self._topics.setdefault(topic, new).thermometers[j] = source
        #: Why a thermometer could not be read; and which are not read until the next look, because
        #: finding out what there is instead takes time.
        self._misread: dict[int, str] = {}
        self._resting: set[int] = set()

    def look(self) -> None:
        """Look for publishers that came, or came back with another type; about once a second."""
        self._resting.clear()
        for each in self._topics.values():
            each.look()

    def poll(self) -> None:
        """Take the newest temperatures; about ten times a second."""
        for each in self._topics.values():
            message = each.newest()
            for j, source in each.thermometers.items() if message is not None else ():
                if j not in self._resting:
                    self._read(j, source, message)

    def _read(self, thermometer: int, source: TemperatureSource, message: Any) -> None:
        """Take one temperature out of a message."""
        try:
            celsius = source.read(message)
        except SettingsError as error:
            self._misread[thermometer] = str(error).rstrip('.')
            self._resting.add(thermometer)
            self.unreadable += 1
            return
        self._misread.pop(thermometer, None)
        self._take(thermometer, header_stamp_ns(message) or 0, celsius)

    def problems(self) -> dict[int, str]:
        """Tell, by thermometer from 0, why its temperatures can't be had."""
        found = dict(self._misread)
        for each in self._topics.values():
            if each.problem:
                found.update(dict.fromkeys(each.thermometers, each.problem))
        return found
