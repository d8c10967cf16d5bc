"""The executables, as setup.py names them: what comes before numpy and rclpy."""

import gc
from importlib import import_module
import os
import sys

from wrist_ft_comp import ONE_THREAD


def main() -> int:
    """Run the command line; returns the exit code."""
    for name, value in ONE_THREAD.items():
        os.environ.setdefault(name, value)
    if sys.stdout is None:  # a shell closed it, by >&-
        sys.stdout = open(os.devnull, 'w')  # noqa: PTH123, SIM115 -- until the process ends
    try:
        from wrist_ft_comp.cli.main import main as run  # noqa: PLC0415 -- loads numpy
    except KeyboardInterrupt:
        sys.stderr.write('wrist_ft_comp: interrupted.\n')
        return 130
    return run()


def compensator() -> int:
    """Run the node that compensates; returns the exit code."""
    return _run('compensator_node')


def simulated_sensor() -> int:
    """Run the simulated sensor; returns the exit code."""
    return _run('simulated_sensor')


def _run(module_name: str) -> int:
    """Run the main function of a node's module, or say why there can be no node."""
    gc.disable()  # what start-up makes lives as long as the node (running.py enables it)
    try:
        module = import_module(f'wrist_ft_comp.node.{module_name}')
    except ModuleNotFoundError as error:
        if (error.name or '').startswith('wrist_ft_comp'):
            raise
        sys.exit(
            f'A node needs ROS 2, but this Python ({sys.executable}) has no {error.name}. Source '
            'a ROS 2 installation, or install the package with its extra "ros". The command '
            'wrist_ft_comp works without.'
        )
    return int(module.main())


if __name__ == '__main__':
    sys.exit(main())
