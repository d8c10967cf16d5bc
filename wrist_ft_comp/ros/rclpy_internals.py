"""
What is borrowed from rclpy's inside, which has no public name for it: five things, and why.

Tests over DDS need each: of numbers in messages, of services, of running, of wrong arguments.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from rclpy.node import Node


def given_parameters(node: Node) -> Mapping[str, Any]:
    """
    Read the values that a node was given, by name; that of an empty array is None.

    rclpy lists declared parameters only, and takes an empty array for none at all.
    """
    overrides: Mapping[str, Any] = getattr(node, '_parameter_overrides', {})
    return {name: parameter.value for name, parameter in overrides.items()}


def intercept_answers(service: Any, on_header: Callable[..., None]) -> Callable[..., None]:
    """
    Give the response and the header of every request to a function; returns what sends them.

    A callback has to return at once, and a coroutine as callback fails on the EventsExecutor and
    starves timers on the others. So what would send the returned response keeps it.
    """
    send: Callable[..., None] = service.send_response
    service.send_response = on_header
    return send


def keep_from_executors(node: Any, subscription: Any) -> None:
    """Take a subscription from all executors; they serve what stands in this list."""
    node._subscriptions.remove(subscription)  # noqa: SLF001 -- see above


def return_to_node(node: Any, subscription: Any) -> None:
    """Give a subscription back, so that it can be destroyed."""
    node._subscriptions.append(subscription)  # noqa: SLF001 -- see above


def waiting(subscription: Any) -> Iterator[bytes]:
    """Take, one after the other, what came to a subscription that no executor serves."""
    handle = subscription.handle
    for _ in range(subscription.qos_profile.depth):
        with handle:
            taken = handle.take_message(subscription.msg_type, True)  # as bytes
        if taken is None:
            return
        yield taken[0]


class Stop:
    """
    A flag that ends an executor's spinning: what it is told to wait for, in place of a Future.

    A Future has a lock, which a signal handler must not take. This one has none, and keeps the
    newest callback only.
    """

    def __init__(self) -> None:
        self._set = False
        self._callback: Callable[[Stop], object] = lambda _: None

    def set(self) -> None:  # noqa: A003 -- as threading.Event calls it
        """Set the flag, for ever."""
        self._set = True
        self._callback(self)

    def done(self) -> bool:
        """Tell whether the flag is set."""
        return self._set

    def cancelled(self) -> bool:
        """Nobody cancels it."""
        return False

    def add_done_callback(self, callback: Callable[['Stop'], object]) -> None:
        """Call this when the flag is set, or is set already."""
        self._callback = callback
        if self._set:
            callback(self)

    def remove_done_callback(self, _: object) -> bool:
        """Call nothing any more."""
        self._callback = lambda _: None
        return True
