"""
The hub of a node: it owns the parts and calls them, and no part can end it.

An exception of a part that is no refusal (WristFtCompError) is a fault of the program. The hub
logs it once with its traceback, does not call that part again, reports it in the diagnostics and
in the answers of the part's services, and goes on. The hub also opens topics for its parts:
messages come as bytes, and parameters may override the quality of service.
"""

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from functools import partial
import time
import traceback
from typing import Any, cast

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import qos_policy_name_from_kind

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.ros.diagnostics import diagnostic_array, ERROR, Status
from wrist_ft_comp.ros.node_log import NodeLog
from wrist_ft_comp.ros.parameters import Parameter, Parameters
from wrist_ft_comp.ros.part import Part
from wrist_ft_comp.ros.qos import NEWEST, opening, OUTPUT, overridable
from wrist_ft_comp.ros.rclpy_internals import keep_from_executors, return_to_node
from wrist_ft_comp.ros.services import DeferredService

#: Parts are polled once in this time, s.
HOUSEKEEPING_PERIOD_S = 0.1
#: Diagnostics are published once in this time, s.
DIAGNOSTICS_PERIOD_S = 1.0
#: The node waits for this time at its end, s, so that callers take the last answers.
FAREWELL_S = 0.5
#: Verbs that the hub calls only for parts that define them.
_VERBS = (
    'on_model', 'on_cells', 'on_specific_force', 'check_parameters', 'apply_parameters', 'poll',
)  # fmt: skip
#: Events of quality of service that do not match, and what is logged then.
_DISAGREEMENTS = {
    'subscription': (
        SubscriptionEventCallbacks,
        'a publisher of {} offers less {} than is asked for: nothing of it will be received',
    ),
    'publisher': (
        PublisherEventCallbacks,
        'a subscriber of {} asks for more {} than is offered: it will receive nothing',
    ),
}


class Hub(Node):
    """
    A node made of parts; a subclass makes them and calls ``run`` with all of them.

    ``table`` are parameters that are declared before those of the parts. SettingsError when a
    topic cannot be opened, or a parameter has a wrong value.
    """

    def __init__(self, name: str, table: Iterable[Parameter] = (), **options: Any) -> None:
        super().__init__(name, enable_logger_service=True, **options)
        self.log = NodeLog(cast('Any', self).get_logger())
        #: Policy that does not match that of another node, by relative name of the topic.
        self.incompatible: dict[str, str] = {}
        #: Subscriptions that no executor serves.
        self._unserved: list[Any] = []
        self._parameter_table = Parameters(self, table)
        self.parts: tuple[Part, ...] = ()
        #: Parts that get every wrench; usually there are none.
        self._listeners: tuple[Part, ...] = ()
        self._hearing: dict[str, list[Part]] = {}
        self._offered: list[DeferredService] = []
        #: The last refusal of a part, which is logged once.
        self._refusals: dict[Part, str] = {}

    def chosen(self) -> dict[str, Any]:
        """Read the present values of the parameters, by name; arrays are tuples."""
        return self._parameter_table.values()

    def run(self, parts: Sequence[Part]) -> None:
        """Start parts, offer their services, and poll them; WristFtCompError when one refuses."""
        self.parts = tuple(parts)
        self._parameter_table.declare(row for part in parts for row in part.parameters)
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
            for part in self._hearing['on_model']:
                self.call(part, part.on_model)
        except WristFtCompError:
            self._end_parts()  # one of them has locked its folder
            raise
        self._offered = [
            DeferredService(
                self, offer, partial(self._serve, part, offer.handler), self.log.note_refusal
            )
            for part in parts
            for offer in part.services()
        ]
        self.add_on_set_parameters_callback(self._validate_parameters)
        self.add_post_set_parameters_callback(partial(self.broadcast, 'apply_parameters'))
        # A steady clock: parts are polled where simulated time stands still, too.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(HOUSEKEEPING_PERIOD_S, partial(self.broadcast, 'poll'), clock=steady)
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
            self._complain(part, str(error))
            return None

    def _complain(self, part: Part, trouble: str) -> None:
        """Log a trouble of a part, unless it is the same as the last one."""
        if self._refusals.get(part) != trouble:
            self._refusals[part] = trouble
            self.log.error(trouble)

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
            options = self._negotiable('publisher', topic) if negotiable else {}
            return self.create_publisher(kind, topic, copy(OUTPUT), **options)

    def subscribe(self, kind: Any, topic: str, callback: Callable[[bytes], None], qos: Any) -> Any:
        """Subscribe to serialized messages."""
        with opening(topic):
            options = self._negotiable('subscription', topic)
            return self.create_subscription(kind, topic, callback, copy(qos), raw=True, **options)

    def subscribe_unserved(self, kind: Any, topic: str, qos: Any = NEWEST) -> Any:
        """Subscribe to messages that no executor takes, but ``waiting``."""
        result = self.subscribe(kind, topic, lambda _: None, qos)
        keep_from_executors(self, result)
        self._unserved.append(result)
        return result

    def destroy_subscription(self, subscription: Any) -> bool:
        """Destroy a subscription, also one that no executor takes."""
        if subscription in self._unserved:
            self._unserved.remove(subscription)
            return_to_node(self, subscription)
        return bool(super().destroy_subscription(subscription))

    def _negotiable(self, ours: str, topic: str) -> dict[str, Any]:
        """Make options: policies are overridable; one that two don't agree on is noted, logged."""
        callbacks, sentence = _DISAGREEMENTS[ours]

        def note(event: Any) -> None:
            policy = str(qos_policy_name_from_kind(event.last_policy_kind)).lower()
            self.incompatible[topic] = policy
            name = f'qos_overrides.{self.resolve_topic_name(topic)}.{ours}.{policy}'
            remedy = f'Set {name} of this node, or' if self.has_parameter(name) else 'Set'
            trouble = sentence.format(topic, policy)
            self.log.error(f'{trouble}. {remedy} the quality of service of the other side.')

        return {
            'event_callbacks': callbacks(incompatible_qos=note),
            'qos_overriding_options': overridable(),
        }

    def now_ns(self) -> int:
        """Time for drivers that do not stamp."""
        return int(self.get_clock().now().nanoseconds)

    def listen(self, part: Part, *, wanted: bool) -> None:
        """Hand every wrench to a part from now on, or no more."""
        others = tuple(listener for listener in self._listeners if listener is not part)
        self._listeners = (*others, part) if wanted and not part.stopped else others

    def _stop(self, part: Part, error: Exception) -> None:
        """Stop a part because of a fault."""
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
        answer: str | None = self.call(part, handler, part, *asked)
        if part.stopped:
            raise WristFtCompError(part.stopped)
        return answer

    def _validate_parameters(self, parameters: Sequence[Any]) -> SetParametersResult:
        """Allow or refuse parameters, changing nothing that runs."""
        try:
            for part in self._hearing['check_parameters']:
                self.call(part, part.check_parameters, parameters)
        except WristFtCompError as error:
            self.log.note_refusal('set_parameters', str(error))
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _judge(self, part: Part) -> list[Status]:
        """Get the statuses of a part; the hub gives that of a part that has stopped."""
        statuses = self.do(part, lambda: list(part.statuses())) or []
        return [Status(part.title, ERROR, part.stopped)] if part.stopped else statuses

    def hardware_id(self) -> str:
        """Name the device that the diagnostics are about."""
        return ''

    def _diagnose(self) -> None:
        """Publish diagnostics, and log what is new in those of parts that want it."""
        judged = [(part, status) for part in self.parts for status in self._judge(part)]
        self.log.report(status for part, status in judged if part.logged)
        self._diagnostics.publish(
            diagnostic_array(
                self.get_fully_qualified_name(), self.hardware_id(),
                self.get_clock().now().to_msg(), [status for _, status in judged],
            )
        )  # fmt: skip

    def destroy_node(self) -> None:
        """End all parts and the node; callers that wait for an answer get one."""
        if self._end_parts():
            time.sleep(FAREWELL_S)
        for subscription in tuple(self._unserved):
            self.destroy_subscription(subscription)
        super().destroy_node()  # type: ignore[no-untyped-call] # as rclpy declares it

    def _end_parts(self) -> bool:
        """End all parts; True when a caller was answered just now."""
        return any([self.do(part, part.end) for part in self.parts])  # noqa: C419 -- all of them
