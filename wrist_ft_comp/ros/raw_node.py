"""A node that hears serialized messages, some when it asks, and minds quality of service."""

from collections.abc import Callable, Iterator
from copy import copy
from typing import Any, cast

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import qos_policy_name_from_kind

from wrist_ft_comp.ros import messages
from wrist_ft_comp.ros.node_log import NodeLog

#: What is made, and said, where the other side of our subscription or publisher does not agree.
_UNLIKE = {
    'subscription': (
        SubscriptionEventCallbacks,
        'a publisher of {} offers less {} than is asked for: nothing of it will be received',
    ),
    'publisher': (
        PublisherEventCallbacks,
        'a subscriber of {} asks for more {} than is offered: it will receive nothing',
    ),
}


class RawNode(Node):
    """Opens topics, whose QoS parameters may override; SettingsError when one cannot be used."""

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.log = NodeLog(cast('Any', self).get_logger())
        #: Per topic, by relative name, the policy on which some other side does not agree.
        self.incompatible: dict[str, str] = {}
        self._unserved: list[Any] = []

    def advertise(self, kind: Any, topic: str, *, negotiable: bool = False) -> Any:
        """Make a publisher."""
        with messages.opening(topic):
            options = self._negotiable('publisher', topic) if negotiable else {}
            return self.create_publisher(kind, topic, copy(messages.OUTPUT), **options)

    def subscribe(self, kind: Any, topic: str, callback: Callable[[bytes], None], qos: Any) -> Any:
        """Subscribe to serialized messages."""
        with messages.opening(topic):
            options = self._negotiable('subscription', topic)
            return self.create_subscription(kind, topic, callback, copy(qos), raw=True, **options)

    def subscribe_unserved(self, kind: Any, topic: str, qos: Any = messages.NEWEST) -> Any:
        """Subscribe to messages that no executor takes, but ``waiting``."""
        result = self.subscribe(kind, topic, lambda _: None, qos)
        # Executors serve what stands in this list, at once or at their next wake-up.
        self._subscriptions.remove(result)
        self._unserved.append(result)
        return result

    def destroy_subscription(self, subscription: Any) -> bool:
        """Destroy a subscription, also one that no executor takes."""
        if subscription in self._unserved:
            self._unserved.remove(subscription)
            self._subscriptions.append(subscription)
        return bool(super().destroy_subscription(subscription))

    def destroy_node(self) -> None:
        """Destroy everything."""
        for each in tuple(self._unserved):
            self.destroy_subscription(each)
        super().destroy_node()  # type: ignore[no-untyped-call] # as rclpy declares it

    def _negotiable(self, ours: str, topic: str) -> dict[str, Any]:
        """Make options: policies are overridable; one that two don't agree on is noted, logged."""
        callbacks, said = _UNLIKE[ours]

        def tell(event: Any) -> None:
            policy = str(qos_policy_name_from_kind(event.last_policy_kind)).lower()
            self.incompatible[topic] = policy
            name = f'qos_overrides.{self.resolve_topic_name(topic)}.{ours}.{policy}'
            own = f'Set {name} of this node, or' if self.has_parameter(name) else 'Set'
            self.log.error(
                f'{said.format(topic, policy)}. {own} the quality of service of the other side.'
            )

        return {
            'event_callbacks': callbacks(incompatible_qos=tell),
            'qos_overriding_options': messages.overridable(),
        }


def waiting(subscription: Any) -> Iterator[bytes]:
    """Take, one after the other, what came to a subscription that no executor serves."""
    handle = subscription.handle
    for _ in range(subscription.qos_profile.depth):
        with handle:
            taken = handle.take_message(subscription.msg_type, True)  # as bytes
        if taken is None:
            return
        yield taken[0]
