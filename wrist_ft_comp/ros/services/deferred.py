"""
Services that answer later, on every executor, without stopping the stream.

A callback has to return at once, and a coroutine as callback fails on the EventsExecutor and
starves timers on the others. So the service object's ``send_response`` is replaced by one that
keeps the request's header; the original is called when the work is done.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, field, InitVar
from typing import Any

from rclpy.node import Node

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.ros.messages import SERVICE
from wrist_ft_comp.ros.node_log import NodeLog

#: Goes on from yield to yield, and returns the answer; a WristFtCompError refuses.
Work = Generator[None, None, str]


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


class LongService:
    """Serves one request at a time, by work that goes on whenever it is polled."""

    #: Does what is asked; closed when the node ends. And what says that it is at work.
    _work: Callable[[], Work]
    _busy: Callable[[], str]
    #: Such as ``~/tare``; what the log says before answers; and what is said at the node's end.
    name: str
    done = not_done = ''
    at_end: str
    #: Whether a refusal is an error to the log.
    severe = False
    #: What the last one answered, empty before the first, and whether it changed nothing.
    last_outcome = ''
    refused = False
    _log: NodeLog
    _running: tuple[Work, Reply] | None = None

    def on_request(self, _request: Any, reply: Reply) -> None:
        """Begin; the answer comes when it is done."""
        if self._running is not None:
            raise WristFtCompError(f'{self._busy()}; wait for its answer, then call again.')
        self._running = self._work(), reply
        self.poll()

    def poll(self) -> None:
        """Go on, and answer when that is the end of it."""
        if self._running is None:
            return
        work, reply = self._running
        try:
            next(work)
        except StopIteration as end:
            self._answer(reply, end.value, success=True)
        except WristFtCompError as error:
            self._answer(reply, str(error), success=False)

    def end(self) -> bool:
        """Stop; tell whether its asker was answered just now."""
        if self._running is None:
            return False
        work, reply = self._running
        work.close()
        self._answer(reply, self.at_end, success=False)
        return True

    def _answer(self, reply: Reply, message: str, *, success: bool) -> None:
        """Answer, and let log and diagnostics know."""
        self._running, self.last_outcome, self.refused = None, message, not success
        # One call site each: rclpy insists that a call site keeps its severity.
        if success:
            self._log.info(f'{self.done}{message}')
        elif self.severe:
            self._log.error(f'{self.not_done}{message}')
        else:
            self._log.warning(f'{self.not_done}{message}')
        if not success:
            self._log.note_refusal(self.name, message)
        reply(success=success, message=message)
