"""The executables that are nodes, as setup.py names them; no rclpy is imported to say so."""

import gc
from importlib import import_module
import sys


def compensator() -> int:
    """Run the node that compensates; returns the exit code."""
    return _run('compensator_node')


def simulated_sensor() -> int:
    """Run the simulated sensor; returns the exit code."""
    return _run('simulated_sensor')


def _run(module_name: str) -> int:
    """Run the main function of an executable's module, or say why there can be no node."""
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
