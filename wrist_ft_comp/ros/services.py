"""Services whose answer comes later: the callback returns at once, the work goes on."""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

from rclpy.node import Node
from std_srvs.srv import Trigger

from wrist_ft_comp.ros.rclpy_internals import intercept_answers
from wrist_ft_comp.ros.topics import SERVICE

#: Goes on from yield to yield, and returns the answer; a WristFtCompError refuses.
Work: TypeAlias = Generator[None, None, str]
_Handler = TypeVar('_Handler', bound=Callable[..., str | Work])


@dataclass(frozen=True)
class Service:
    """A service that a method offers."""

    name: str
    #: What it does, in a sentence, for ``--help`` and the documentation.
    purpose: str
    #: As std_srvs.srv.Trigger.
    kind: Any
    handler: Callable[..., str | Work]


def service(name: str, purpose: str, kind: Any = Trigger) -> Callable[[_Handler], _Handler]:
    """
    Let a method of a part be a service.

    It takes the request, and returns the answer, or a generator that ends with it. The hub goes on
    with that ten times a second, and refuses further requests meanwhile.
    """

    def offer(handler: _Handler) -> _Handler:
        handler.service = Service(name, purpose, kind, handler)  # type: ignore[attr-defined]
        return handler

    return offer


class Reply:
    """The answer to one request: call it once, now or later."""

    def __init__(self, response: Any, send: Callable[[Any, Any], None]) -> None:
        self._response, self._send = response, send
        self._header: Any = None
        self._answered = False

    def __call__(self, *, success: bool, message: str) -> None:
        """Answer."""
        self._answered = True
        self._response.success, self._response.message = success, message
        if self._header is not None:
            self._send(self._response, self._header)

    def arrive(self, header: Any) -> None:
        """Take the header, which comes after the callback has returned."""
        self._header = header
        if self._answered:
            self._send(self._response, header)


class DeferredService:
    """Offers a service on a node; ``handle`` takes each request and its Reply."""

    def __init__(self, node: Node, offer: Service, handle: Callable[[Any, Reply], None]) -> None:
        self._handle, self._replies = handle, dict[int, Reply]()
        self.service: Any = node.create_service(
            offer.kind, offer.name, self._on_request, qos_profile=SERVICE
        )
        self._send = intercept_answers(self.service, self._on_header)

    def _on_request(self, request: Any, response: Any) -> Any:
        """Hand the request on; the executor then asks to send what is returned."""
        reply = Reply(response, self._send)
        self._handle(request, reply)
        self._replies[id(response)] = reply  # it keeps the response, so no other gets its id
        return response

    def _on_header(self, response: Any, header: Any) -> None:
        self._replies.pop(id(response)).arrive(header)
