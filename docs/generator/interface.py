"""
Print docs/interface.md: parameters, topics, services, options and formats, taken from the code.

``make docs`` writes the file; a test compares the two.
"""

import os
import re
import sys
import tempfile
import textwrap

from formats import command_line, file_formats
from nodes import compensator, simulated_sensor

import wrist_ft_comp

#: Of a paragraph, in characters.
WIDTH = 140
HEAD = f"""\
# Interface

Version {wrist_ft_comp.__version__}. `make docs` makes this page from the code.

- Units are N, N m, s (REP-103) and °C.
- A topic name without a slash at its beginning follows the node's namespace. `~` stands for the
  node's own name, such as `/wrist_ft_comp`. Every name can be remapped.
- A parameter that may change at `start-up` only is read when the node starts.
"""


def main() -> None:
    """Print the document."""
    os.environ.update(ROS_AUTOMATIC_DISCOVERY_RANGE='OFF', ROS_LOG_DIR=tempfile.gettempdir())
    parts = [HEAD, *compensator(), *simulated_sensor(), *command_line(), *file_formats()]
    blocks = ('\n'.join(parts) + '\n').split('\n\n')
    sys.stdout.write('\n\n'.join(map(filled, blocks)))


def filled(block: str) -> str:
    """Fill a paragraph to the width of the other documents; tables, lists and headings stay."""
    text = block.strip('\n')
    if not text or re.search('^(?:[|#-]|    )', text, re.MULTILINE):
        return block
    return block.replace(text, textwrap.fill(text, WIDTH, break_on_hyphens=False))


if __name__ == '__main__':
    main()
