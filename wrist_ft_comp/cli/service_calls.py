"""Who operates a running compensator from outside: by its services and its diagnostics."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import shlex
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from wrist_ft_comp.errors import NodeError
from wrist_ft_comp.report.advice import start_command
from wrist_ft_comp.ros.diagnostics import Status
from wrist_ft_comp.ros.topics import OUTPUT

#: How long a node, a service or a first answer is waited for, s.
DISCOVERY_S = 10.0
#: A request that got no answer for this long, s, may have been dropped, and is sent again.
_AGAIN_S = 1.0
#: A node without diagnostics for this long, s, has ended or hangs.
SILENCE_S = 10.0
#: The service by which a compensator is known among other nodes.
_KNOWN_BY = '/identify_payload'


class Operator:
    """A node that asks a compensator; sros2's policy has a profile for its name."""

    def __init__(self, context: Context) -> None:
        name = 'wrist_ft_comp_operator'
        self.node: Any = Node(name, context=context, use_global_arguments=False)
        self.executor = EventsExecutor(context=context)
        self.executor.add_node(self.node)

    def wait_for(self, done: Callable[[], Any], timeout_s: float) -> bool:
        """Run callbacks until a condition holds; tell whether it does in time."""
        deadline_s = time.monotonic() + timeout_s
        while not done():
            if time.monotonic() > deadline_s:
                return False
            self.executor.spin_once(timeout_sec=0.1)
        return True

    def services(self, begin: str = '') -> list[str]:
        """List services that a person may ask for, of those whose full name begins so."""
        offered = self.node.get_service_names_and_types()
        names = sorted(name for name, types in offered if types[0].startswith('std_srvs/'))
        return [name.removeprefix(begin) for name in names if name.startswith(begin)]

    def running(self) -> list[str]:
        """List the full names of the compensators that run."""
        return [n.removesuffix(_KNOWN_BY) for n in self.services() if n.endswith(_KNOWN_BY)]

    def find(self, wanted: str = '') -> str:
        """Find a compensator by its full name or its namespace, or the only one; or NodeError."""
        name_or_namespace = f'/{wanted.strip("/")}'

        def found() -> list[str]:
            return [
                name for name in self.running()
                if not wanted or name_or_namespace in {name, name.rpartition('/')[0]}
            ]  # fmt: skip

        if not self.wait_for(found, DISCOVERY_S):
            others = f'; running are: {", ".join(self.running())}' if self.running() else ''
            raise NodeError(
                f'No compensator {wanted and f"named {wanted} "}was found within '
                f'{DISCOVERY_S:.0f} s{others}. Start it: {shlex.join(start_command())}. If '
                'it runs, set ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE here as there.'
            )
        if not wanted:  # others may be found later
            self.wait_for(lambda: False, 0.5)
        if len(several := found()) != 1:  # none: it has ended meanwhile
            names = ', '.join(several) or 'start one'
            raise NodeError(f'{len(several)} compensators run: {names}. Choose one with --name.')
        return several[0]

    def introduce(self, name: str) -> None:
        """Ask a node something harmless until it answers: it drops answers to who is unknown."""
        client = self.node.create_client(GetParameters, f'{name}/get_parameters')
        harmless = GetParameters.Request(names=['use_sim_time'])
        asked, deadline_s = list[Any](), time.monotonic() + DISCOVERY_S
        while time.monotonic() < deadline_s:
            if self.wait_for(client.service_is_ready, _AGAIN_S):
                asked.append(client.call_async(harmless))
            # A busy node may take longer than until the next time.
            if self.wait_for(lambda: any(future.done() for future in asked), _AGAIN_S):
                return
        raise NodeError(f'{name} gave no answer in {DISCOVERY_S:.0f} s; it hangs or has ended.')


@contextmanager
def operating() -> Iterator[Operator]:
    """Make an operator in the domain that the environment names, and end it."""
    context = Context()
    context.init([])
    operator = Operator(context)
    try:
        yield operator
    finally:
        operator.executor.shutdown()
        operator.node.destroy_node()
        context.try_shutdown()


class Watch:
    """A compensator that is asked by its services, and its newest statuses, by their names."""

    def __init__(self, operator: Operator, name: str) -> None:
        self.operator, self.name = operator, name
        self.statuses: dict[str, Status] = {}
        self.hardware_id = ''
        #: How many reports came, and when the newest did, by the steady clock, s.
        self.reports, self.heard_s = 0, time.monotonic()
        self._begin = f'{name.lstrip("/")}: '
        operator.node.create_subscription(DiagnosticArray, '/diagnostics', self._take, OUTPUT)

    def _take(self, array: Any) -> None:
        ours = [status for status in array.status if status.name.startswith(self._begin)]
        for status in ours:
            name = status.name.removeprefix(self._begin)
            values = {pair.key: pair.value for pair in status.values}
            self.statuses[name] = Status(name, status.level, status.message, values)
            self.hardware_id = status.hardware_id
        if ours:
            self.reports, self.heard_s = self.reports + 1, time.monotonic()

    @property
    def silent(self) -> bool:
        """Whether no report has come for long."""
        return time.monotonic() - self.heard_s > SILENCE_S

    def ask(self, action: str) -> str:
        """Call a service, or record or stop, and give the answer; NodeError when it refuses."""
        self.operator.introduce(self.name)
        kind, service, request = Trigger, action, Trigger.Request()
        if action in {'record', 'stop'}:
            kind, service, request = SetBool, 'record', SetBool.Request(data=action == 'record')
        client = self.operator.node.create_client(kind, f'{self.name}/{service}')
        if not self.operator.wait_for(client.service_is_ready, DISCOVERY_S):
            raise NodeError(f'{client.srv_name} is not offered. Does the node still run?')
        future = client.call_async(request)
        try:
            self.operator.wait_for(lambda: future.done() or self.silent, float('inf'))
        except KeyboardInterrupt as error:
            goes_on = f'{self.name} goes on with {action}: its log says how it ends.'
            raise KeyboardInterrupt(f'interrupted; {goes_on}') from error
        if not future.done():
            raise NodeError(
                f'{self.name} has said nothing for {SILENCE_S:.0f} s: it has ended, or hangs. Its '
                f'log says whether {action} was done.'
            )
        answer = future.result()
        if not answer.success:
            raise NodeError(str(answer.message))
        return str(answer.message)
