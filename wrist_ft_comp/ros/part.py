"""
A part of a node, which is one feature: what the hub asks of it, and services that answer later.

A callback has to return at once, and a coroutine as callback fails on the EventsExecutor and
starves timers on the others. So the service object's ``send_response`` is replaced by one that
keeps the request's header; the original is called when the work is done.
"""

from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from rclpy.node import Node
from std_srvs.srv import Trigger

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.ros.messages import SERVICE
from wrist_ft_comp.ros.node_log import NodeLog, Status

#: Three numbers of the axes x, y and z.
Vector: TypeAlias = tuple[float, float, float]


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
    A service that a part offers.

    Its handler takes the request and a Reply. It returns the answer, or None where the Reply is
    called later, or refuses by a WristFtCompError.
    """

    kind: Any
    name: str
    handler: Callable[[Any, Reply], str | None]


class DeferredService:
    """Offers a service on a node; ``refused`` takes its name and why a request was refused."""

    def __init__(self, node: Node, offer: Service, refused: Callable[[str, str], None]) -> None:
        self._offer, self._refused = offer, refused
        self._replies: dict[int, Reply] = {}
        self.service: Any = node.create_service(
            offer.kind, offer.name, self._on_request, qos_profile=SERVICE
        )
        self._send = self.service.send_response
        self.service.send_response = self._on_header  # type: ignore[method-assign] # see above

    def _on_request(self, request: Any, response: Any) -> Any:
        """Give the request to the handler; the executor then asks to send what is returned."""
        reply = Reply(response, self._send)
        try:
            answer = self._offer.handler(request, reply)
        except WristFtCompError as error:
            self._refused(self._offer.name, str(error))
            reply(success=False, message=str(error))
        else:
            if answer is not None:
                reply(success=True, message=answer)
        self._replies[id(response)] = reply  # it keeps the response, so no other gets its id
        return response

    def _on_header(self, response: Any, header: Any) -> None:
        """Keep the header until the answer is there."""
        self._replies.pop(id(response)).arrive(header)


class Part:
    """
    One feature of a node; a part defines the verbs that it needs.

    A constructor only stores. In ``start``, when all parts exist, a part asks the hub for what it
    needs of the node. The order of parts decides only the order of their diagnostics.
    """

    #: The node, from ``start`` on; a subclass that uses it declares its class, Hub.
    hub: Any
    #: Its name in the log and the diagnostics.
    title = ''
    #: Why the hub does not call it any more; empty while all is well.
    stopped = ''

    def services(self) -> Sequence[Service]:
        """List the services that it offers."""
        return ()

    def start(self) -> None:
        """Begin; a refusal (WristFtCompError) ends the node, as a wrong parameter does."""

    def on_model(self) -> None:
        """Follow the live model: called when all parts have started, and at every change."""

    def on_wrench(self, stamp_ns: int, raw: Sequence[float], data: bytes, layout: Any) -> None:
        """Take a raw wrench, N and N m, that was published; only after the hub's ``listen``."""

    def on_cells(self, cells: Sequence[Any], stamp_ns: int) -> None:
        """Take thermal cells that a temperature, with its stamp, ns, has completed."""

    def on_force(self, stamp_ns: int, force: Vector, speed: float | None) -> None:
        """Take a specific force, m/s², and the speed of rotation, rad/s, where it is known."""

    def check_parameters(self, parameters: Sequence[Any]) -> None:
        """Refuse parameters by a WristFtCompError; change nothing."""

    def apply_parameters(self, parameters: Sequence[Any]) -> None:
        """Follow parameters that have changed."""

    def poll(self) -> None:
        """Do what is due; called ten times a second."""

    def statuses(self) -> Iterable[Status]:
        """Report the state; called once a second."""
        return ()

    def end(self) -> bool:
        """End with the node, or after a fault; True when a caller was answered just now."""
        return False


#: Goes on from yield to yield, and returns the answer; a WristFtCompError refuses.
Work = Generator[None, None, str]


class LongService(Part):
    """Serves one request at a time, by work that continues at every poll."""

    #: Does the work of a request; closed when the part ends.
    _work: Callable[[], Work]
    #: Says that a request is being served.
    _busy: Callable[[], str]
    #: Such as ``~/tare``.
    name: str
    #: What the log says before an answer, and before a refusal.
    done = not_done = ''
    #: What the end of the node leaves as it was.
    unchanged = ''
    #: Whether a refusal is an error to the log.
    severe = False
    #: The last answer, empty before the first, and whether it was a refusal.
    last_outcome = ''
    refused = False
    _log: NodeLog
    _running: tuple[Work, Reply] | None = None

    def services(self) -> Sequence[Service]:
        """Offer the service of its name."""
        return (Service(Trigger, self.name, self.on_request),)

    def on_request(self, _request: Any, reply: Reply) -> None:
        """Begin the work; the answer comes at its end."""
        if self._running is not None:
            raise WristFtCompError(f'{self._busy()}; wait for its answer, then call again.')
        self._running = self._work(), reply
        self.poll()

    def poll(self) -> None:
        """Continue the work, and answer at its end."""
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
        """Stop; True when a caller was answered just now."""
        if self._running is None:
            return False
        work, reply = self._running
        reason = self.stopped or f'The node is shutting down{self.unchanged}.'
        self._answer(reply, reason, success=False)
        work.close()
        return True

    def _answer(self, reply: Reply, message: str, *, success: bool) -> None:
        """Answer, and note that in log and diagnostics."""
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
