"""Services that take their time: one request at a time, by work that goes on when polled."""

from collections.abc import Callable, Generator, Sequence
from typing import Any

from std_srvs.srv import Trigger

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.ros.deferred import Reply
from wrist_ft_comp.ros.hub import Part, Service
from wrist_ft_comp.ros.node_log import NodeLog

#: Goes on from yield to yield, and returns the answer; a WristFtCompError refuses.
Work = Generator[None, None, str]


class LongService(Part):
    """Serves one request at a time, by work that goes on whenever it is polled."""

    #: Does what is asked; closed when the part ends. And what says that it is at work.
    _work: Callable[[], Work]
    _busy: Callable[[], str]
    #: Such as ``~/tare``; what the log says before answers; and what stays as it was at the end.
    name: str
    done = not_done = ''
    unchanged = ''
    #: Whether a refusal is an error to the log.
    severe = False
    #: What the last one answered, empty before the first, and whether it changed nothing.
    last_outcome = ''
    refused = False
    _log: NodeLog
    _running: tuple[Work, Reply] | None = None

    def services(self) -> Sequence[Service]:
        """Offer the service of its name."""
        return (Service(Trigger, self.name, self.on_request),)

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
        reason = self.stopped or f'The node is shutting down{self.unchanged}.'
        self._answer(reply, reason, success=False)
        work.close()
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
