"""The command's entry: what has to be set before numpy is loaded."""

import os

from wrist_ft_comp import ONE_THREAD


def main() -> int:
    """Run the command line; returns the exit code."""
    for name, value in ONE_THREAD.items():
        os.environ.setdefault(name, value)
    from wrist_ft_comp.cli.main import main as run  # noqa: PLC0415 -- loads numpy

    return run()
