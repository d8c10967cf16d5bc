"""A part of a node, which is one feature: what it brings, and what the hub asks of it."""

from collections.abc import Callable, Generator, Iterable, Sequence
from typing import Any, ClassVar, TypeAlias

from std_srvs.srv import Trigger

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.ros.diagnostics import ERROR, Status, WARN
from wrist_ft_comp.ros.parameters import Parameter
from wrist_ft_comp.ros.services import Reply, Service

#: Three numbers of the axes x, y and z.
Vector: TypeAlias = tuple[float, float, float]


class Part:
    """
    One feature of a node; a part defines the attributes and verbs that it needs.

    A constructor only stores. In ``start``, when all parts exist, a part asks the hub for what it
    needs of the node. The order of parts decides only the order of their diagnostics.
    """

    #: Its name in the log and the diagnostics.
    title: ClassVar[str] = ''
    #: Its parameters, which the hub's ``chosen`` reads.
    parameters: ClassVar[Sequence[Parameter]] = ()
    #: Its topics and what each is for, for ``--help`` and the documentation.
    topics: ClassVar[Sequence[tuple[str, str]]] = ()
    #: Whether troubles in its statuses are logged; False where it logs them itself.
    logged: ClassVar[bool] = False
    #: The node, from ``start`` on; a subclass that uses it declares its class, Hub.
    hub: Any
    #: Why the hub does not call it any more; empty while all is well.
    stopped = ''

    @classmethod
    def services(cls) -> Sequence[Service]:
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

    def on_specific_force(
        self, stamp_ns: int, specific_force: Vector, speed: float | None
    ) -> None:
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
    #: Such as ``~/tare``, and what it does.
    name: ClassVar[str]
    purpose: ClassVar[str]
    #: What the log says before an answer, and before a refusal.
    done = not_done = ''
    #: What the end of the node leaves as it was.
    unchanged = ''
    #: Whether a refusal is an error to the log.
    severe = False
    #: The last answer, empty before the first, and whether it was a refusal.
    last_outcome = ''
    refused = False
    _running: tuple[Work, Reply] | None = None

    @classmethod
    def services(cls) -> Sequence[Service]:
        """Offer the service of its name."""
        return (Service(Trigger, cls.name, cls.purpose, cls.on_request),)

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
        log = self.hub.log
        if success:
            log.info(f'{self.done}{message}')
        else:
            log.write(ERROR if self.severe else WARN, f'{self.not_done}{message}')
            log.note_refusal(self.name, message)
        reply(success=success, message=message)
