"""Services whose answer comes later: the callback returns at once, the work goes on."""

from collections.abc import Callable, Generator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

from rclpy.node import Node
from std_srvs.srv import Trigger

from wrist_ft_comp.ros.rclpy_internals import intercept_answers
from wrist_ft_comp.ros.topics import SERVICE

#: Goes on from yield to yield, and returns the answer; a WristFtCompError refuses.
Work: TypeAlias = Generator[None, None, str]
#: Takes ``success`` and ``message``, once.
Reply: TypeAlias = Callable[..., None]
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


class DeferredService:
    """Offers a service; ``handle`` takes a request, and what is called with its answer, later."""

    def __init__(self, node: Node, offer: Service, handle: Callable[[Any, Reply], None]) -> None:
        self._handle, self._asked = handle, dict[int, Any]()
        self.service: Any = node.create_service(
            offer.kind, offer.name, self._on_request, qos_profile=SERVICE
        )
        self._send = intercept_answers(self.service, self._on_header)

    def _on_request(self, request: Any, response: Any) -> Any:
        """Keep a request; the executor then asks to send what is returned."""
        self._asked[id(response)] = request
        return response

    def _on_header(self, response: Any, header: Any) -> None:
        """Hand the request on, now that it is known whom to answer."""

        def reply(*, success: bool, message: str) -> None:
            response.success, response.message = success, message
            with suppress(RuntimeError):  # rclpy's, where who asked has gone
                self._send(response, header)

        self._handle(self._asked.pop(id(response)), reply)


def warned(message: str, problem: str) -> str:
    """Add a warning to the answer of a service, where there is a problem."""
    return f'{message}\nwarning: {problem}' if problem else message
