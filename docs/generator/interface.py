"""
Print docs/interface.md: parameters, topics, services, options and formats, taken from the code.

``make docs`` writes the file; a test compares the two.
"""

import os
import sys
import tempfile

from formats import command_line, file_formats
from nodes import compensator, simulated_sensor

import wrist_ft_comp

HEAD = f"""\
# Interface

Made from the code by `make docs`; a test compares the two. Units are those of REP-103: N, N m, s;
and °C. Relative topic names follow the namespace, `~` is the node's own name, and every name can
be remapped. Version {wrist_ft_comp.__version__}.
"""


def main() -> None:
    """Print the document."""
    os.environ.update(ROS_AUTOMATIC_DISCOVERY_RANGE='OFF', ROS_LOG_DIR=tempfile.gettempdir())
    parts = [HEAD, *compensator(), *simulated_sensor(), *command_line(), *file_formats()]
    sys.stdout.write('\n'.join(parts) + '\n')


if __name__ == '__main__':
    main()
