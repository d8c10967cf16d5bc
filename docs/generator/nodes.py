"""
What the nodes offer: topics, services and diagnostics, asked of running ones, and parameters.

What they are for is written in the parts; a topic or service without such words is an error.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
import json
import re
import sys
import tempfile
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from markdown import table
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from std_srvs.srv import SetBool

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.node.compensator_node import CompensatorNode, PARAMETERS, SERVICES, TOPICS
from wrist_ft_comp.node.simulated_sensor import PARAMETERS as SIMULATED
from wrist_ft_comp.node.simulated_sensor import SimulatedSensor
from wrist_ft_comp.ros.parameters import descriptor, Parameter

TIMEOUT_S = 20.0
#: Beginning of the values that every axis has.
AN_AXIS = rf'^({"|".join(AXES)})(?=_)'
#: Every node has these; rclpy's own documentation describes them. With an IMU the last is heard
#: where the package tf2_msgs is, which is not everywhere that this runs.
COMMON = {'/rosout', '/parameter_events', '/clock', '/tf_static'}
COMMON_SERVICES = ('logger_levels', 'parameter', 'type_description')
#: So that whatever it may say is said.
_LEARNING = {
    'learning.mode': 'propose', 'calibration.reference': 'payload', 'gravity.source': 'imu',
}  # fmt: skip
STATUSES = """\
Statuses in `/diagnostics` (REP-107), each named `NODE: STATUS`. `AXIS` stands for `force_x` and
so on. A model and the first messages bring further values: in `output` `AXIS_raw`,
`AXIS_compensated` and `AXIS_drift_deviation`, the standard deviation of the drift that is
subtracted; in `temperature` `thermometer_1_c`, and `…_believed_c` of one that is predicted; in
`model` `file`, `sha256`, `axes` and `thermometer_1_calibrated_c`; in `payload` `AXIS_external`.
`state` says where the drift comes from, after a restart, too, `turn` how the IMU is turned.
`learning` is there unless its mode is off.
"""
#: What the topics and services are for.
PURPOSE = {
    **TOPICS,
    **SERVICES,
    'temperature_2': 'second thermometer, at the motor',
    'wrench_external_reference': 'true wrench of the environment on the tool; with tool_mass only',
}


def parameter_row(row: Parameter) -> list[str]:
    """Describe a parameter as the node does."""
    kind = row.ros_type.name.lower().replace('_', ' ')
    default: Any = list(row.default) if isinstance(row.default, tuple) else row.default
    shown = descriptor(row).additional_constraints.removeprefix('Must be ').removesuffix('.')
    when = 'start-up' if row.read_only else 'run time'
    return [f'`{row.name}`', kind, f'`{json.dumps(default)}`', shown, when, row.description]


def parameters(rows: Iterable[Parameter]) -> str:
    """List a node's parameters."""
    titles = ('parameter', 'type', 'default', 'allowed', 'may change', 'what it does')
    return table(titles, map(parameter_row, rows))


@contextmanager
def running(factory: Callable[..., Node], **values: str | float) -> Iterator[tuple[Any, Any, Any]]:
    """Run a node beside another one that asks it; both are in this process only."""
    context = Context()
    context.init([])
    executor = SingleThreadedExecutor(context=context)
    untyped: Any = RosParameter
    overrides = [untyped(name, value=value) for name, value in values.items()]
    node = factory(context=context, parameter_overrides=overrides)
    asker = Node('asker', context=context)
    try:
        executor.add_node(node)
        executor.add_node(asker)
        yield node, asker, executor
    finally:
        executor.shutdown()
        for running_node in (asker, node):
            running_node.destroy_node()  # type: ignore[no-untyped-call] # as rclpy declares it
        context.shutdown()


def name_in_code(name: str, node: Any) -> str:
    """Write a name as the code does: relative, or below the node's own."""
    inside = f'/{node.get_name()}/'
    relative = name if name in PURPOSE else name.removeprefix('/')
    return f'~/{name.removeprefix(inside)}' if name.startswith(inside) else relative


def type_name(kind: Any) -> str:
    """Name a message or service type."""
    return f'{kind.__module__.split(".")[0]}/{kind.__name__}'


def topic_rows(node: Any) -> Iterator[list[str]]:
    """Describe a node's topics."""
    heard = (*node.subscriptions, *getattr(node, '_unserved', ()))
    for word, ends in (('in', heard), ('out', node.publishers)):
        for end in ends:
            if end.topic_name in COMMON:
                continue
            name = name_in_code(end.topic_name, node)
            qos = end.qos_profile
            quality = f'{qos.reliability.name.lower().replace("_", " ")}, depth {qos.depth}'
            yield [f'`{name}`', word, f'`{type_name(end.msg_type)}`', quality, PURPOSE[name]]


def topics(node: Any) -> str:
    """List a node's topics; those of several purposes come once."""
    rows = {tuple(row) for row in topic_rows(node)}
    titles = ('topic', 'direction', 'type', 'QoS', 'what it is')
    return table(titles, sorted(rows, key=lambda row: (row[1], row[0])))


def services(node: Any) -> str:
    """List a node's services."""
    named = ((name_in_code(service.srv_name, node), service.srv_type) for service in node.services)
    rows = [
        [f'`{name}`', f'`{type_name(kind)}`', PURPOSE[name]]
        for name, kind in named
        if not any(word in name for word in COMMON_SERVICES)
    ]
    return table(('service', 'type', 'what it does'), sorted(rows))


def diagnostics(asker: Any, executor: Any) -> str:
    """List the statuses that the node publishes, and their values."""
    arrays: list[Any] = []
    asker.create_subscription(DiagnosticArray, '/diagnostics', arrays.append, 10)
    while not arrays:
        executor.spin_once(timeout_sec=TIMEOUT_S)
    rows = []
    for status in arrays[0].status:
        keys = [re.sub(AN_AXIS, 'AXIS', value.key) for value in status.values]
        values = ', '.join(f'`{key}`' for key in dict.fromkeys(keys))
        rows.append([f'`{status.name.split(": ")[1]}`', values or 'none'])
    return table(('status', 'values without a model'), rows)


def compensator() -> Iterator[str]:
    """Describe the node, while a recording runs."""
    with (
        tempfile.TemporaryDirectory() as folder,
        running(CompensatorNode, data_directory=folder, **_LEARNING) as (node, asker, executor),
    ):
        client = asker.create_client(SetBool, f'/{node.get_name()}/record')
        if not client.wait_for_service(TIMEOUT_S):
            sys.exit(f'{client.srv_name} is not offered within {TIMEOUT_S:g} s.')
        future = client.call_async(SetBool.Request(data=True))
        executor.spin_until_future_complete(future, TIMEOUT_S)
        yield f'## Node `{node.get_name()}` (executable `compensator`)\n'
        yield topics(node)
        yield ''
        yield services(node) + '\n'
        yield parameters(PARAMETERS) + '\n'
        yield STATUSES
        yield diagnostics(asker, executor) + '\n'


def simulated_sensor() -> Iterator[str]:
    """Describe the simulated sensor."""
    with running(SimulatedSensor, tool_mass=1.0) as (node, _, _):
        purpose = {
            'wrench_raw': 'raw wrench of the sensor', 'wrench_reference': 'true wrench',
            'temperature': 'thermometer in the sensor',
            'imu': 'specific force at the sensor; with tool_mass only',
        }  # fmt: skip
        PURPOSE.update(purpose)
        yield f'## Node `{node.get_name()}` (executable of the same name)\n'
        yield topics(node) + '\n'
        yield parameters(SIMULATED) + '\n'
