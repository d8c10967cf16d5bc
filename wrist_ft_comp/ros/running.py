"""How nodes run: until a signal or an error, on one executor, one node for each sensor."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack
import gc
import re
import signal
import sys
from typing import Any, TypeVar

from rclpy.context import Context
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos_overriding_options import InvalidQosOverridesError

from wrist_ft_comp.errors import SettingsError, WristFtCompError
from wrist_ft_comp.ros.arguments import HELP
from wrist_ft_comp.ros.parameters import (
    declare,
    NODE_NAME,
    PROCESS_PARAMETERS,
    ros_parameter,
    values,
)

NodesFactory = Callable[..., Sequence[Node]]
SensorNode = TypeVar('SensorNode', bound=Any)
#: Longest time between a signal and the look at its flag, seconds.
POLL_PERIOD_S = 0.1
#: A sensor's name becomes a namespace.
_NAME = re.compile(r'(?!.*__)[A-Za-z][A-Za-z0-9_]*')
#: What a user can cause and mend; anything else is a fault of ours and keeps its traceback.
USER_ERRORS = (
    WristFtCompError,
    ParameterException,
    NameValidationException,
    InvalidQosOverridesError,
)


def run_nodes(factory: NodesFactory, argv: Sequence[str] | None = None, usage: str = '') -> int:
    """
    Run the nodes of ``factory(context=…)`` on one executor until a signal or an error.

    The first node's parameter ``executor`` chooses it. Returns the exit code: 0 after a signal,
    or when ``--help`` showed the usage; 1 after an error of this package, which was logged as one
    sentence.
    """
    words = list(sys.argv if argv is None else argv)
    if usage and not set(HELP).isdisjoint(words[1:]):
        sys.stdout.write(usage)
        return 0
    context = Context()
    try:
        with _stop_flag() as stop:
            _initialise(context, words)
            _create_and_spin(factory, context, stop)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except USER_ERRORS as error:
        logger: Any = get_logger('wrist_ft_comp')
        logger.fatal(str(error))
        return 1
    finally:
        context.try_shutdown()
    return 0


def make_executor(choice: str, context: Context) -> Executor:
    """Make the executor of a choice that EXECUTOR_PARAMETER describes, for a context's nodes."""
    if choice != 'default':
        try:
            # Inside the function because older rclpy lack it.
            from rclpy.experimental.events_executor import EventsExecutor  # noqa: PLC0415
        except ImportError:
            if choice == 'events':
                raise SettingsError(
                    'executor is events, but this rclpy has no EventsExecutor (it came with '
                    '7.1). Set executor to auto or default.'
                ) from None
        else:
            return EventsExecutor(context=context)
    return SingleThreadedExecutor(context=context)


class Stop:
    """
    A flag that ends ``spin``: what an executor is told to wait for, in the place of a Future.

    It has no lock, because signal handlers set it, and it keeps the newest callback only.
    """

    def __init__(self) -> None:
        self._set = False
        self._callback: Callable[[Stop], object] = lambda _: None

    def set(self) -> None:  # noqa: A003 -- as threading.Event calls it
        """Set the flag, for ever."""
        self._set = True
        self._callback(self)

    def done(self) -> bool:
        """Tell whether the flag is set."""
        return self._set

    def cancelled(self) -> bool:
        """Nobody cancels it."""
        return False

    def add_done_callback(self, callback: Callable[['Stop'], object]) -> None:
        """Call this when the flag is set, or is set already."""
        self._callback = callback
        if self._set:
            callback(self)

    def remove_done_callback(self, _: object) -> bool:
        """Call nothing any more."""
        self._callback = lambda _: None
        return True


def spin(executor: Any, context: Context, stop: Stop) -> None:
    """
    Run callbacks until a flag is set or the context is shut down.

    An executor that waits is left now and then, because Python runs signal handlers only then. An
    EventsExecutor with callbacks due looks neither at the time nor at a flag: it is ended by the
    callback of the flag.
    """
    while context.ok() and not stop.done():
        # Not spin_once: leaving and entering the executor costs as much as a callback.
        executor.spin_until_future_complete(stop, timeout_sec=POLL_PERIOD_S)


def _initialise(context: Context, words: list[str]) -> None:
    """Initialise a context; bad ROS arguments become a sentence."""
    try:
        context.init(words)
    except RuntimeError as error:
        # rcl ends its message with ", at FILE:LINE" of its own sources, once per call level.
        reason = str(error).split(', at /')[0].rstrip('.')
        raise SettingsError(
            f'The arguments behind --ros-args cannot be read: {reason}. Write '
            '-p NAME:=VALUE, -r FROM:=TO or --params-file FILE. In an array, all numbers must be '
            'written with or all without a decimal point, and texts with a colon or brackets need '
            'quotes: \'["/state:data[0]"]\'.'
        ) from error


def _create_and_spin(factory: NodesFactory, context: Context, stop: Stop) -> None:
    """Create nodes and executor, spin, and take them down in the order that does not abort."""
    with ExitStack() as stack:
        nodes: Sequence[Any] = factory(context=context)
        for node in nodes:
            stack.callback(node.destroy_node)
        executor = make_executor(nodes[0].get_parameter('executor').value, context)
        stack.callback(executor.shutdown)
        for node in nodes:
            executor.add_node(node)
        # What start-up made lives as long as the nodes: the garbage collector need not walk it,
        # which takes tens of milliseconds and delays messages.
        gc.freeze()
        gc.enable()
        spin(executor, context, stop)


@contextmanager
def _stop_flag() -> Iterator[Stop]:
    """Yield a flag that SIGINT and SIGTERM set, however often."""
    stop = Stop()
    before: dict[int, Any] = {
        number: signal.signal(number, lambda *_: stop.set())
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def node_per_sensor(make: Callable[..., SensorNode], **options: Any) -> list[SensorNode]:
    """
    Make a node for each sensor that the parameter ``sensors`` lists, or one for none.

    ``make`` is called as a node class that also takes ``sensor=NAME``. WristFtCompError when a
    name is unusable, or when two nodes have one of their ``own_topics`` in common.
    """
    asking: Any = Node(NODE_NAME, enable_rosout=False, start_parameter_services=False, **options)
    try:
        declare(asking, PROCESS_PARAMETERS)
        chosen = values(asking, PROCESS_PARAMETERS)
        # While it is there: DDS may hang where the only node ends as soon as it began.
        return _make_nodes(make, asking.get_namespace(), chosen, options)
    finally:
        asking.destroy_node()


def _make_nodes(
    make: Callable[..., SensorNode],
    namespace: str,
    chosen: dict[str, Any],
    options: dict[str, Any],
) -> list[SensorNode]:
    """Make one node, or one for each of the sensors that were chosen."""
    names: Sequence[str] = chosen['sensors']
    if not names:
        return [make(**options)]
    _check_names(names)
    nodes: dict[str, SensorNode] = {}
    with ExitStack() as made:
        for name in names:
            try:
                nodes[name] = make(sensor=name, **_options_of(name, namespace, chosen, options))
            except WristFtCompError as error:
                raise SettingsError(f'Sensor {name}: {error}') from error
            made.callback(nodes[name].destroy_node)
        _check_topics(nodes)
        made.pop_all()
    return list(nodes.values())


def _check_names(names: Sequence[str]) -> None:
    """Refuse what cannot be a namespace of its own."""
    for name in names:
        if (count := names.count(name)) > 1:
            raise SettingsError(
                f'sensors must name every sensor once; got {name} {count} times. Give each wrist '
                'a name of its own.'
            )
        if not _NAME.fullmatch(name):
            raise SettingsError(
                'sensors must be names of letters, digits and single underscores that begin with '
                f'a letter, because they become namespaces; got {name!r}. Rename it.'
            )


def _options_of(
    name: str, namespace: str, chosen: dict[str, Any], options: dict[str, Any]
) -> dict[str, Any]:
    """Put one sensor's node into its namespace; the process's settings show on every node."""
    full = f'{namespace.rstrip("/")}/{name}'
    shared = [ros_parameter(row, chosen[row.name]) for row in PROCESS_PARAMETERS]
    return {
        **options,
        # A node's own arguments go before the command line's, whose __ns would unite all nodes.
        'cli_args': ['--ros-args', '-r', f'__ns:={full}', '--', *(options.get('cli_args') or ())],
        'parameter_overrides': [*(options.get('parameter_overrides') or ()), *shared],
    }


def _check_topics(nodes: Mapping[str, Any]) -> None:
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
