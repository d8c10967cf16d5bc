"""
One process for several wrists: a node per sensor, each in a namespace of its own.

``sensors:=[left, right]`` makes ``/left/wrist_ft_comp`` and ``/right/wrist_ft_comp``. They share
the process and its executor, nothing else. Without it there is one node, named as ever.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
import re
from typing import Any, TYPE_CHECKING

from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from wrist_ft_comp import SettingsError, WristFtCompError
from wrist_ft_comp.ros.compensator_parameters import NODE_NAME, PROCESS_PARAMETERS
from wrist_ft_comp.ros.parameters import declare, values

if TYPE_CHECKING:
    from wrist_ft_comp.ros.compensator_node import CompensatorNode

#: A sensor's name becomes a namespace.
_NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]*')


def node_per_sensor(
    make: Callable[..., 'CompensatorNode'], **options: Any
) -> list['CompensatorNode']:
    """
    Make a node for each sensor that the parameter ``sensors`` lists, or one when it lists none.

    Parameters
    ----------
    make : callable
        Called as ``make(sensor=NAME, **options)``; CompensatorNode.
    **options
        As rclpy's Node takes them, such as ``context``.

    Returns
    -------
    list of CompensatorNode
        In the order of the names.

    Raises
    ------
    WristFtCompError
        When a name is unusable or comes twice, two sensors meet on a topic that each needs for
        itself, or a node cannot be made.

    """
    namespace, chosen = _ask(options)
    names: Sequence[str] = chosen['sensors']
    if not names:
        return [make(**options)]
    _check_names(names)
    nodes: dict[str, CompensatorNode] = {}
    with ExitStack() as made:
        for name in names:
            nodes[name] = _make_one(make, name, _options_of(name, namespace, chosen, options))
            made.callback(nodes[name].destroy_node)
        _check_topics(nodes)
        made.pop_all()
    return list(nodes.values())


def _ask(options: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Read, as the only node would, its namespace and what concerns the whole process."""
    asking: Any = Node(NODE_NAME, enable_rosout=False, start_parameter_services=False, **options)
    try:
        declare(asking, PROCESS_PARAMETERS)
        return asking.get_namespace(), values(asking, PROCESS_PARAMETERS)
    finally:
        asking.destroy_node()


def _check_names(names: Sequence[str]) -> None:
    """Refuse what cannot be a namespace of its own."""
    for name, count in Counter(names).items():
        if count > 1:
            raise SettingsError(
                f'sensors must name every sensor once; got {name} {count} times. Give each wrist '
                'a name of its own.'
            )
        if not _NAME.fullmatch(name):
            raise SettingsError(
                'sensors must be names of letters, digits and underscores that begin with a '
                f'letter, because they become namespaces; got {name!r}. Rename it.'
            )


def _options_of(
    name: str, namespace: str, chosen: dict[str, Any], options: dict[str, Any]
) -> dict[str, Any]:
    """Put one sensor's node into its namespace; the process's settings show on every node."""
    own = f'{namespace.rstrip("/")}/{name}'
    untyped: Any = RosParameter
    shared = [
        untyped(row.name, row.ros_type, list(value) if isinstance(value, tuple) else value)
        for row in PROCESS_PARAMETERS
        for value in [chosen[row.name]]
    ]
    return {
        **options,
        # A node's own arguments go before the command line's, whose __ns would unite all nodes.
        'cli_args': ['--ros-args', '-r', f'__ns:={own}', '--', *(options.get('cli_args') or ())],
        'parameter_overrides': [*(options.get('parameter_overrides') or ()), *shared],
    }


def _make_one(
    make: Callable[..., 'CompensatorNode'], name: str, options: dict[str, Any]
) -> 'CompensatorNode':
    """Make one sensor's node; an error says which sensor's."""
    try:
        return make(sensor=name, **options)
    except WristFtCompError as error:
        raise SettingsError(f'Sensor {name}: {error}') from error


def _check_topics(nodes: Mapping[str, 'CompensatorNode']) -> None:
    """Refuse remaps that make two sensors read one wrench, or publish on one topic."""
    users: dict[str, str] = {}
    for name, node in nodes.items():
        for topic in node.own_topics:
            other = users.setdefault(topic, name)
            if other != name:
                raise SettingsError(
                    f'Sensors {other} and {name} would share the topic {topic}. Remap by full '
                    f'names, such as -r /{other}/wrench_raw:=TOPIC, which mean one sensor only.'
                )
