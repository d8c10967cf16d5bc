"""
The hub of a node: it owns the parts and calls them, and no part can end it.

A part is one feature of the node: what it subscribes to, serves, and says in the diagnostics. All
parts have the same verbs. What a part throws that is no refusal is a fault of the program: the hub
logs it once with its traceback, calls that part no more, says so in the diagnostics and in the
answers of the part's services, and goes on.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
import time
import traceback
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.ros.deferred import DeferredService, Reply
from wrist_ft_comp.ros.node_log import ERROR, Status
from wrist_ft_comp.ros.raw_node import RawNode

HOUSEKEEPING_PERIOD_S = 0.1
DIAGNOSTICS_PERIOD_S = 1.0
#: An answer that the asker has not taken yet is lost when its sender leaves the network.
FAREWELL_S = 0.5


@dataclass(frozen=True)
class Service:
    """A service that a part offers; DeferredService says what its handler gets and returns."""

    kind: Any
    name: str
    handler: Callable[[Any, Reply], str | None]


class Part:
    """
    One feature of a node; every verb does nothing until a part has a use for it.

    A constructor only stores: what a part needs of the node, it asks the hub for in ``start``,
    when all parts exist. Their order decides nothing but the order of their diagnostics.
    """

    #: What people call it, in the log and the diagnostics.
    title = ''
    #: Why the hub calls it no more; empty while all is well.
    stopped = ''

    def services(self) -> Sequence[Service]:
        """List the services that it offers."""
        return ()

    def start(self, hub: Any) -> None:
        """Begin; a refusal (WristFtCompError) ends the node, as a wrong parameter does."""

    def on_model(self) -> None:
        """Follow the model that is live: called when all parts have started, and at a change."""

    def on_wrench(self, stamp_ns: int, raw: Sequence[float], data: bytes, layout: Any) -> None:
        """Take a raw wrench, N and N m, that was sent on; only while the hub's ``listen`` says."""

    def on_cells(self, cells: Sequence[Any], stamp_ns: int) -> None:
        """Take thermal cells that a temperature of a stamp, ns, has completed."""

    def on_force(
        self, stamp_ns: int, force: tuple[float, float, float], speed: float | None
    ) -> None:
        """Take a specific force, m/s², and the speed of rotation, rad/s, where it is known."""

    def check_parameters(self, parameters: Sequence[Any]) -> None:
        """Refuse parameters that cannot be had; changes nothing."""

    def apply_parameters(self, parameters: Sequence[Any]) -> None:
        """Follow parameters that have changed."""

    def poll(self) -> None:
        """Do what is due; ten times a second."""

    def statuses(self) -> Iterable[Status]:
        """Judge how it stands; once a second."""
        return ()

    def end(self) -> bool:
        """End with the node, or with the part; tell whether somebody was answered just now."""
        return False


_VERBS = ('on_model', 'on_cells', 'on_force', 'check_parameters', 'apply_parameters', 'poll')


class Hub(RawNode):
    """A node made of parts; a subclass makes them and calls ``run`` with all of them."""

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.parts: tuple[Part, ...] = ()
        #: Parts that every wrench is handed to; in ordinary operation there are none.
        self._listeners: tuple[Part, ...] = ()
        #: Whether all parts have started.
        self.running = False
        self._hearing: dict[str, list[Part]] = {}
        self._offered: list[DeferredService] = []
        #: The refusal that a part's verb came to the last time, which is logged once.
        self._refusals: dict[Part, str] = {}

    def run(self, parts: Sequence[Part]) -> None:
        """Start parts, offer their services, and look after them; WristFtCompError refuses."""
        self.parts = tuple(parts)
        self._diagnostics = self.advertise(DiagnosticArray, '/diagnostics')
        # Most parts have no use for most verbs: those are not called a thousand times a second.
        self._hearing = {
            verb: [part for part in parts if getattr(type(part), verb) is not getattr(Part, verb)]
            for verb in _VERBS
        }
        try:
            for part in parts:
                self.call(part, part.start, self)
        except WristFtCompError:
            self._end_parts()  # what was begun, such as a locked folder, is not left behind
            raise
        self.running = True
        for part in self._hearing['on_model']:
            self.call(part, part.on_model)
        self._offered = [
            DeferredService(
                self, offer.kind, offer.name, partial(self._serve, part, offer.handler),
                self.log.note_refusal,
            )
            for part in parts for offer in part.services()
        ]  # fmt: skip
        self.add_on_set_parameters_callback(self._validate_parameters)
        self.add_post_set_parameters_callback(partial(self.tell, 'apply_parameters'))
        # A steady clock: the node looks after itself where simulated time stands still, too.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(HOUSEKEEPING_PERIOD_S, self._keep_house, clock=steady)
        self.create_timer(DIAGNOSTICS_PERIOD_S, self._diagnose, clock=steady)

    def call(self, part: Part, verb: Callable[..., Any], *values: Any) -> Any:
        """Call a part unless it has stopped; a fault stops it, a refusal is the caller's."""
        if part.stopped:
            return None
        try:
            return verb(*values)
        except WristFtCompError:
            raise
        except Exception as error:  # whatever it is, the wrench goes on
            self._stop(part, error)
            return None

    def do(self, part: Part, verb: Callable[..., Any], *values: Any) -> Any:
        """Call a part; a refusal is logged, once while it stays the same."""
        try:
            return self.call(part, verb, *values)
        except WristFtCompError as error:
            self._complain(part, str(error))
            return None

    def _complain(self, part: Part, trouble: str) -> None:
        """Log a trouble of a part, unless it was its last one, too."""
        if self._refusals.get(part) != trouble:
            self._refusals[part] = trouble
            self.log.error(trouble)

    def tell(self, verb: str, *values: Any) -> None:
        """Call a verb of all parts that have a use for it."""
        for part in self._hearing[verb]:
            self.do(part, getattr(part, verb), *values)

    def guarded(self, part: Part, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Make a callback of a part fit for an executor, which ends at whatever is thrown."""
        return partial(self.do, part, callback)

    def subscribe_for(
        self, part: Part, kind: Any, topic: str, callback: Callable[..., Any], qos: Any
    ) -> Any:
        """Subscribe a part to serialized messages."""
        return self.subscribe(kind, topic, self.guarded(part, callback), qos)

    def now_ns(self) -> int:
        """Time for drivers that do not stamp."""
        return int(self.get_clock().now().nanoseconds)

    def listen(self, part: Part, *, wanted: bool) -> None:
        """Hand every wrench to a part from now on, or no more."""
        others = tuple(listener for listener in self._listeners if listener is not part)
        self._listeners = (*others, part) if wanted and not part.stopped else others

    def _stop(self, part: Part, error: Exception) -> None:
        """Call a part no more, because of a fault."""
        reason = f'{type(error).__name__}: {error}'.rstrip('.')
        part.stopped = (
            f'{part.title} has stopped by a fault of this program ({reason}); wrenches go on '
            'without it. Restart the node, and report the traceback that is in the log.'
        )
        self.listen(part, wanted=False)
        self.log.error(part.stopped + '\n' + ''.join(traceback.format_exception(error)))
        try:
            part.end()
        except Exception as second:  # it has stopped already
            self._complain(part, f'{part.title} could not be ended either: {second!r}')

    def _serve(self, part: Part, handler: Callable[..., str | None], *asked: Any) -> str | None:
        """Handle a request, or refuse it where the part has stopped, before or by it."""
        said: str | None = self.call(part, handler, *asked)
        if part.stopped:
            raise WristFtCompError(part.stopped)
        return said

    def _validate_parameters(self, parameters: Sequence[Any]) -> SetParametersResult:
        """Allow or refuse parameters, changing nothing that runs."""
        try:
            for part in self._hearing['check_parameters']:
                self.call(part, part.check_parameters, parameters)
        except WristFtCompError as error:
            self.log.note_refusal('set_parameters', str(error))
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _keep_house(self) -> None:
        """Look after what does not come by message."""
        self.tell('poll')

    def _judge(self, part: Part) -> list[Status]:
        """Ask a part how it stands; the hub answers for one that has stopped."""
        statuses = self.do(part, lambda: list(part.statuses())) or []
        return [Status(part.title, ERROR, part.stopped)] if part.stopped else statuses

    def hardware_id(self) -> str:
        """Tell which device the diagnostics are about."""
        return ''

    def _diagnose(self) -> None:
        """Publish diagnostics; each status is named "node: status" (REP-107)."""
        statuses = [status for part in self.parts for status in self._judge(part)]
        self.log.tell(statuses)
        name, hardware_id = self.get_fully_qualified_name().lstrip('/'), self.hardware_id()
        array = DiagnosticArray()
        array.header.stamp = self.get_clock().now().to_msg()
        array.status = [
            DiagnosticStatus(
                level=status.level, name=f'{name}: {status.name}', message=status.message,
                hardware_id=hardware_id,
                values=[KeyValue(key=key, value=text) for key, text in status.values.items()])
            for status in statuses
        ]  # fmt: skip
        self._diagnostics.publish(array)

    def destroy_node(self) -> None:
        """End what runs beside the node; who waits for an answer is told."""
        if self._end_parts():
            time.sleep(FAREWELL_S)
        super().destroy_node()

    def _end_parts(self) -> bool:
        """End all parts; tell whether somebody was answered just now."""
        return any([self.do(part, part.end) for part in self.parts])  # noqa: C419 -- all of them
