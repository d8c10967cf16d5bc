"""Services whose answer comes later: the callback returns at once, the work goes on."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.ros.rclpy_internals import intercept_answers
from wrist_ft_comp.ros.topics import SERVICE


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


@dataclass(frozen=True)
class Service:
    """
    A service that parts of a class offer.

    Its handler takes the part, the request and a Reply. It returns the answer, or None where the
    Reply is called later, or refuses by a WristFtCompError.
    """

    #: As std_srvs.srv.Trigger.
    kind: Any
    name: str
    #: What it does, in a sentence, for ``--help`` and the documentation.
    purpose: str
    handler: Callable[..., str | None]


class DeferredService:
    """
    Offers a service on a node.

    ``handle`` takes the request and a Reply, as the handler of a Service does; ``refused`` takes
    the service's name and why a request was refused.
    """

    def __init__(
        self,
        node: Node,
        offer: Service,
        handle: Callable[[Any, Reply], str | None],
        refused: Callable[[str, str], None],
    ) -> None:
        self._name, self._handle, self._refused = offer.name, handle, refused
        self._replies: dict[int, Reply] = {}
        self.service: Any = node.create_service(
            offer.kind, offer.name, self._on_request, qos_profile=SERVICE
        )
        self._send = intercept_answers(self.service, self._on_header)

    def _on_request(self, request: Any, response: Any) -> Any:
        """Give the request to the handler; the executor then asks to send what is returned."""
        reply = Reply(response, self._send)
        try:
            answer = self._handle(request, reply)
        except WristFtCompError as error:
            self._refused(self._name, str(error))
            reply(success=False, message=str(error))
        else:
            if answer is not None:
                reply(success=True, message=answer)
        self._replies[id(response)] = reply  # it keeps the response, so no other gets its id
        return response

    def _on_header(self, response: Any, header: Any) -> None:
        self._replies.pop(id(response)).arrive(header)
