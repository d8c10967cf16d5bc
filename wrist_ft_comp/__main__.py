"""The command ``wrist_ft_comp``, and ``python -m wrist_ft_comp``: what comes before numpy."""

import os
import signal
import sys
from typing import Any

from wrist_ft_comp import ONE_THREAD
from wrist_ft_comp.errors import INTERRUPTED


def main() -> int:
    """Run the command line; returns the exit code."""
    for name, value in ONE_THREAD.items():
        os.environ.setdefault(name, value)
    # A shell's background jobs ignore Ctrl-C, and go on doing so.
    raises = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if raises:
        signal.signal(signal.SIGINT, _end)
    from wrist_ft_comp.cli.main import main as run  # noqa: PLC0415 -- loads numpy

    if raises:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    return run()


def _end(number: int, _: Any) -> None:
    """End at once: what is being loaded might swallow an exception, or break by it."""
    os.write(2, f'wrist_ft_comp: {INTERRUPTED}\n'.encode())
    os._exit(128 + number)


if __name__ == '__main__':
    sys.exit(main())
