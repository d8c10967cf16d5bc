"""
The hub of a node, and its parts: a part is one feature; the hub owns them, and none can end it.

An exception of a part that is no refusal (WristFtCompError) is a fault of the program. The hub
logs it once with its traceback, does not call that part again, reports it in the diagnostics and
in the answers of the part's services, and goes on. The hub also opens topics for its parts:
messages come as bytes, and parameters may override the quality of service.
"""

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import partial
import math
import time
import traceback
from typing import Any, cast, ClassVar, TypeAlias

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos_overriding_options import QoSOverridingOptions

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.ros.diagnostics import ERROR, NodeLog, Status
from wrist_ft_comp.ros.parameters import Parameter, Parameters
from wrist_ft_comp.ros.rclpy_internals import keep_from_executors, return_to_node
from wrist_ft_comp.ros.services import DeferredService, Reply, Service, Work
from wrist_ft_comp.ros.topics import disagreement, NEWEST, opening, OUTPUT

#: Diagnostics are published once in this time, s.
DIAGNOSTICS_PERIOD_S = 1.0
#: The node waits for this time at its end, s, so that callers take the last answers.
FAREWELL_S = 0.5
#: Verbs that the hub calls only for parts that define them.
_VERBS = ('on_cells', 'on_specific_force', 'check_parameters', 'apply_parameters', 'poll')
#: Three numbers of the axes x, y and z.
Vector: TypeAlias = tuple[float, float, float]


class Part:
    """
    One feature of a node; a part defines the attributes and verbs that it needs.

    A constructor only stores. In ``start``, when all parts exist, a part asks the hub for what it
    needs of the node. Parts start in their order, and end in the reverse one. Methods are services
    by the decorator ``service``.
    """

    #: Its name in the log and the diagnostics.
    title: ClassVar[str] = ''
    #: Its parameters, which the hub's ``chosen`` reads.
    parameters: ClassVar[Sequence[Parameter]] = ()
    #: Its topics and what each is for, for ``--help`` and the documentation.
    topics: ClassVar[Sequence[tuple[str, str]]] = ()
    #: The node, from ``start`` on.
    hub: 'Hub'
    #: Why the hub does not call it any more; empty while all is well.
    stopped = ''

    @classmethod
    def services(cls) -> list[Service]:
        """List the services that its methods are."""
        return [method.service for method in vars(cls).values() if hasattr(method, 'service')]

    def start(self) -> None:
        """Begin; a refusal (WristFtCompError) ends the node, as a wrong parameter does."""

    def on_wrench(self, stamp_ns: int, raw: Sequence[float], data: bytes, layout: Any) -> None:
        """Take a raw wrench, N and N m, that was published; only after the hub's ``listen``."""

    def on_cells(self, cells: Sequence[Any], stamp_ns: int) -> None:
        """Take thermal cells that a temperature, with its stamp, ns, has completed."""

    def on_specific_force(self, stamp_ns: int, force: Vector, speed: float | None) -> None:
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

    def end(self) -> None:
        """End with the node, or after a fault."""


@dataclass(eq=False)
class _Request:
    """A request that is being served."""

    part: Part
    work: Work
    begun_s: float = field(default_factory=time.monotonic)


class Hub(Node):
    """
    A node made of parts; a subclass makes them and calls ``run`` with all of them.

    ``table`` are all parameters, also those of the parts. SettingsError when a topic cannot be
    opened, or a parameter has a wrong value.
    """

    def __init__(self, name: str, table: Iterable[Parameter], **options: Any) -> None:
        #: By full name of a topic, the name that it was resolved from.
        self._given = dict[str, str]()
        super().__init__(name, enable_logger_service=True, **options)
        self.log = NodeLog(cast('Any', self).get_logger())
        #: By name of a service, its last answer.
        self.answers: dict[str, str] = {}
        #: Subscriptions that no executor serves; they end with the node.
        self._unserved: list[Any] = []
        self._parameter_table = Parameters(self, table)
        self.parts: tuple[Part, ...] = ()
        #: Parts that get every wrench; usually there are none.
        self._listeners: tuple[Part, ...] = ()
        self._offered: list[DeferredService] = []
        #: Requests that are being served, by name of the service.
        self._requests: dict[str, _Request] = {}
        #: The last refusal of a part, which is logged once.
        self._refusals: dict[Part, str] = {}
        #: How long the last task waited behind all callbacks, s, and since when another one does.
        self._waited_s, self._waits_since_s = 0.0, math.inf

    def chosen(self) -> dict[str, Any]:
        """Read the present values of the parameters, by name; arrays are tuples."""
        return self._parameter_table.values()

    def run(self, parts: Sequence[Part]) -> None:
        """Start parts, offer their services, and poll them; WristFtCompError when one refuses."""
        self.parts = tuple(parts)
        self._diagnostics = self.advertise(DiagnosticArray, '/diagnostics')
        # Most parts define few verbs; the others need not be called a thousand times a second.
        self._hearing = {
            verb: [part for part in parts if getattr(type(part), verb) is not getattr(Part, verb)]
            for verb in _VERBS
        }
        for part in parts:
            part.hub = self
        try:
            for part in parts:
                self.call(part, part.start)
        except WristFtCompError:
            self._end_parts()  # one of them has locked its folder
            raise
        self._offered = [
            DeferredService(self, offer, partial(self._serve, part, offer))
            for part in parts
            for offer in part.services()
        ]
        self.add_on_set_parameters_callback(self._validate_parameters)
        self.add_post_set_parameters_callback(partial(self.broadcast, 'apply_parameters'))
        # A steady clock: parts are polled where simulated time stands still, too.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(0.1, self.housekeep, clock=steady)
        self.create_timer(DIAGNOSTICS_PERIOD_S, self._diagnose, clock=steady)

    def call(self, part: Part, verb: Callable[..., Any], *arguments: Any) -> Any:
        """Call a part unless it has stopped; a fault stops it, a refusal is the caller's."""
        if part.stopped:
            return None
        try:
            return verb(*arguments)
        except WristFtCompError:
            raise
        except Exception as error:  # whatever it is, the wrench goes on
            self._stop(part, error)
            return None

    def do(self, part: Part, verb: Callable[..., Any], *arguments: Any) -> Any:
        """Call a part; a refusal is logged, once while it stays the same."""
        try:
            return self.call(part, verb, *arguments)
        except WristFtCompError as error:
            if self._refusals.get(part) != str(error):
                self._refusals[part] = str(error)
                self.log.write(ERROR, str(error))
            return None

    def broadcast(self, verb: str, *arguments: Any) -> None:
        """Call a verb of all parts that define it."""
        for part in self._hearing[verb]:
            self.do(part, getattr(part, verb), *arguments)

    def guarded(self, part: Part, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Make a callback of a part fit for an executor, which ends at whatever is thrown."""
        return partial(self.do, part, callback)

    def advertise(self, kind: Any, topic: str, *, negotiable: bool = False) -> Any:
        """Make a publisher."""
        with opening(topic):
            overridable = QoSOverridingOptions.with_default_policies() if negotiable else None
            return self.create_publisher(
                kind, topic, copy(OUTPUT), qos_overriding_options=overridable
            )

    def subscribe(self, kind: Any, topic: str, callback: Callable[[bytes], None], qos: Any) -> Any:
        """Subscribe to serialized messages."""
        with opening(topic):
            overridable = QoSOverridingOptions.with_default_policies()
            return self.create_subscription(
                kind, topic, callback, copy(qos), raw=True, qos_overriding_options=overridable
            )

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        """Give the full name, and remember whose it is: the two below remap full names again."""
        full = super().resolve_topic_name(topic, only_expand=only_expand)
        self._given[full] = topic
        return full

    def get_publishers_info_by_topic(self, topic_name: str, no_mangle: bool = False) -> Any:
        """List who publishes on a topic, by a name that may be full."""
        given = self._given.get(topic_name, topic_name)
        return super().get_publishers_info_by_topic(given, no_mangle)

    def get_subscriptions_info_by_topic(self, topic_name: str, no_mangle: bool = False) -> Any:
        """List who subscribes to a topic, by a name that may be full."""
        given = self._given.get(topic_name, topic_name)
        return super().get_subscriptions_info_by_topic(given, no_mangle)

    def disagreement(self, topic: str) -> str:
        """Say why another node on a topic, by its relative name, and this one share nothing."""
        return disagreement(self, topic)

    def subscribe_unserved(self, kind: Any, topic: str, qos: Any = NEWEST) -> Any:
        """Subscribe to messages that no executor takes, but ``waiting``."""
        result = self.subscribe(kind, topic, lambda _: None, qos)
        keep_from_executors(self, result)
        self._unserved.append(result)
        return result

    def now_ns(self) -> int:
        """Time for drivers that do not stamp."""
        return int(self.get_clock().now().nanoseconds)

    def listen(self, part: Part, *, wanted: bool) -> None:
        """Hand every wrench to a part from now on, or no more."""
        others = tuple(listener for listener in self._listeners if listener is not part)
        self._listeners = (*others, part) if wanted and not part.stopped else others

    def _stop(self, part: Part, error: Exception) -> None:
        """Stop a part because of a fault; ``housekeep`` tells its callers."""
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
            self.log.write(ERROR, f'{part.title} could not be ended either: {second!r}')

    @property
    def behind_s(self) -> float:
        """How long a message waits for its callback, s: where it grows, the node is too slow."""
        return max(self._waited_s, time.monotonic() - self._waits_since_s)

    def _have_turn(self) -> None:
        self._waited_s, self._waits_since_s = time.monotonic() - self._waits_since_s, math.inf

    def housekeep(self) -> None:
        """Poll parts, and go on with the work of requests."""
        if self.executor is not None and self._waits_since_s == math.inf:
            self._waits_since_s = time.monotonic()
            self.executor.create_task(self._have_turn)
        self.broadcast('poll')
        for request in tuple(self._requests.values()):
            self._go_on(request)

    def running_s(self, name: str) -> float | None:
        """How long a request of a service has been served, s; None where none is."""
        request = self._requests.get(name)
        return None if request is None else time.monotonic() - request.begun_s

    def _serve(self, part: Part, offer: Service, asked: Any, reply: Reply) -> None:
        """Begin the work of a request; one is served at a time."""
        why = part.stopped
        if (running_s := self.running_s(offer.name)) is not None:
            for_s = f'has been running for {running_s:.0f} s'
            why = f'{offer.name} {for_s}; wait for its answer, then call again.'
        if why:
            reply(success=False, message=why)
            return
        request = _Request(part, self._work_on(part, offer, asked, reply))
        self._requests[offer.name] = request
        self._go_on(request)

    def _work_on(self, part: Part, offer: Service, asked: Any, reply: Reply) -> Work:
        """Do the work of a request from yield to yield; answer at its end, or when closed."""
        message, success = 'The node is shutting down.', False
        try:
            answer = offer.handler(part, asked)
            message = answer if isinstance(answer, str) else (yield from answer)
            success = True
        except WristFtCompError as error:
            message = str(error)
        except Exception as error:  # whatever it is, the wrench goes on
            self._stop(part, error)
        finally:
            del self._requests[offer.name]
            if success:
                self.log.info(f'{offer.name}: {message}')
            elif part.stopped:  # which has been logged
                message = part.stopped
            else:
                self.log.warning(f'{offer.name} was refused: {message}')
            self.answers[offer.name] = message
            reply(success=success, message=message)
        return message

    def _go_on(self, request: _Request) -> None:
        if request.part.stopped:
            request.work.close()
        else:
            next(request.work, None)

    def _validate_parameters(self, parameters: Sequence[Any]) -> SetParametersResult:
        try:
            for part in self._hearing['check_parameters']:
                self.call(part, part.check_parameters, parameters)
        except WristFtCompError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def hardware_id(self) -> str:
        """Name the device that the diagnostics are about."""
        return ''

    def _diagnose(self) -> None:
        """Publish diagnostics (REP-107), and log what is new in them."""
        statuses = list[Status]()
        for part in self.parts:
            statuses += self.do(part, lambda part=part: list(part.statuses())) or []
        self.log.report(statuses)
        statuses += [
            Status(part.title, ERROR, part.stopped) for part in self.parts if part.stopped
        ]
        array, device = DiagnosticArray(), self.hardware_id()
        array.header.stamp = self.get_clock().now().to_msg()
        name = self.get_fully_qualified_name().lstrip('/')
        array.status = [
            DiagnosticStatus(
                level=status.level, name=f'{name}: {status.name}', message=status.message,
                hardware_id=device,
                values=[KeyValue(key=key, value=text) for key, text in status.values.items()])
            for status in statuses
        ]  # fmt: skip
        self._diagnostics.publish(array)

    def destroy_node(self) -> None:
        """End all parts and the node; callers that wait for an answer get one."""
        callers = tuple(self._requests.values())
        self._end_parts()
        for request in callers:
            self._go_on(request)  # what waited for the disk has ended
            request.work.close()
        if callers:
            time.sleep(FAREWELL_S)
        while self._unserved:
            return_to_node(self, self._unserved.pop())
        super().destroy_node()  # type: ignore[no-untyped-call] # as rclpy declares it

    def _end_parts(self) -> None:
        for part in reversed(self.parts):
            self.do(part, part.end)
