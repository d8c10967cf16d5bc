"""
Services that answer later, on every executor, without stopping the stream.

A callback has to return at once, and a coroutine as callback fails on the EventsExecutor and
starves timers on the others. So the service object's ``send_response`` is replaced by one that
keeps the request's header; the original is called when the work is done.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, InitVar
from typing import Any

from rclpy.node import Node

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.ros.messages import SERVICE


class Reply:
    """The answer to one request: call it once, now or later; further calls do nothing."""

    def __init__(self, response: Any, send: Callable[[Any, Any], None]) -> None:
        self._response = response
        self._send = send
        self._header: Any = None
        self._answered = False

    def __call__(self, *, success: bool, message: str) -> None:
        """Answer."""
        if self._answered:
            return
        self._answered = True
        self._response.success, self._response.message = success, message
        if self._header is not None:
            self._send(self._response, self._header)

    def arrive(self, header: Any) -> None:
        """Take the header, which comes after the callback has returned."""
        self._header = header
        if self._answered:
            self._send(self._response, header)


@dataclass(eq=False)
class DeferredService:
    """A service that answers with what its handler returns or refuses, or later by the Reply."""

    # A handler gets request and reply. Refusals are WristFtCompErrors, told to ``refused``, too.

    node: InitVar[Node]
    service_type: InitVar[Any]
    _name: str
    _handler: Callable[[Any, Reply], str | None]
    _refused: Callable[[str, str], None]
    _replies: dict[int, Reply] = field(default_factory=dict)

    def __post_init__(self, node: Node, service_type: Any) -> None:
        """Offer the service."""
        kind, answer = service_type, self._on_request
        self.service: Any = node.create_service(kind, self._name, answer, qos_profile=SERVICE)
        self._send = self.service.send_response
        self.service.send_response = self._on_header  # type: ignore[method-assign] # see above

    def _on_request(self, request: Any, response: Any) -> Any:
        """Give the request to the handler; the executor then asks to send what is returned."""
        reply = Reply(response, self._send)
        try:
            said = self._handler(request, reply)
        except WristFtCompError as error:
            self._refused(self._name, str(error))
            reply(success=False, message=str(error))
        else:
            if said is not None:
                reply(success=True, message=said)
        self._replies[id(response)] = reply  # which keeps the response, so the id stays its own
        return response

    def _on_header(self, response: Any, header: Any) -> None:
        """Keep the header until the answer is there."""
        self._replies.pop(id(response)).arrive(header)
