"""How a node runs: until a signal or an error, on one executor."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
import faulthandler
import gc
import signal
import sys
from typing import Any

from rclpy.context import Context
from rclpy.executors import ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from wrist_ft_comp.errors import SettingsError, WristFtCompError
from wrist_ft_comp.ros.rclpy_internals import Stop
from wrist_ft_comp.ros.topics import ROS_REFUSALS

#: A node that has not left DDS after this time is ended, s: Fast DDS was seen to wait for ever.
_LEAVE_S = 30.0


def run_node(
    factory: Callable[..., Node], argv: Sequence[str] | None, usage: Callable[[], str]
) -> int:
    """
    Run the node ``factory(context=…)`` until a signal or an error.

    Returns the exit code: 0 after a signal, or when ``--help`` showed the usage; 1 after an error
    of this package, which was logged as one sentence.
    """
    words = list(sys.argv if argv is None else argv)
    if not {'-h', '--help'}.isdisjoint(words[1:]):
        sys.stdout.write(usage())
        return 0
    context, stop = Context(), Stop()
    logger: Any = get_logger('wrist_ft_comp')
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    try:
        try:
            context.init(words)
        except RuntimeError as error:
            # rcl ends its message with ", at FILE:LINE" of its own sources, once per call level.
            reason = str(error).split(', at /')[0].rstrip('.')
            raise SettingsError(
                f'ROS 2 does not begin: {reason}. Arguments behind --ros-args are -p NAME:=VALUE, '
                '-r FROM:=TO or --params-file FILE. In an array, all numbers must be written with '
                'or all without a decimal point, and texts with a colon or brackets need quotes: '
                '\'["/state:data[0]"]\'. In the environment, ROS_LOG_DIR or ROS_HOME must be a '
                'folder that can be written, and ROS_DOMAIN_ID a number.'
            ) from error
        if strays := remove_ros_args(words)[1:]:
            logger.warning(
                f'{" ".join(strays)} is ignored: what a node is told stands behind --ros-args, '
                'such as --ros-args -p model_file:=model.yaml'
            )
        with ExitStack() as stack:  # taken down in the order that does not abort
            node: Any = factory(context=context)
            stack.callback(node.destroy_node)
            executor = EventsExecutor(context=context)  # of those there are, it costs least
            stack.callback(executor.shutdown)
            executor.add_node(node)
            # What start-up made lives as long as the node: the garbage collector need not walk
            # it, which takes tens of milliseconds and delays messages.
            gc.freeze()
            gc.enable()
            spin(executor, context, stop)
            faulthandler.dump_traceback_later(_LEAVE_S, exit=True, file=2)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except (WristFtCompError, *ROS_REFUSALS) as error:
        # What a user can cause and mend; anything else is a fault of ours and keeps its traceback.
        logger.fatal(str(error))
        return 1
    finally:
        context.try_shutdown()
        faulthandler.cancel_dump_traceback_later()
    return 0


def spin(executor: Any, context: Context, stop: Stop) -> None:
    """
    Run callbacks until a flag is set or the context is shut down.

    An executor is left ten times a second, because Python runs signal handlers only then. An
    EventsExecutor with callbacks due looks neither at the time nor at a flag: it is ended by the
    callback of the flag.
    """
    while context.ok() and not stop.done():
        # Not spin_once: leaving and entering the executor costs as much as a callback.
        executor.spin_until_future_complete(stop, timeout_sec=0.1)
