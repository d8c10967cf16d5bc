"""The command ``wrist_ft_comp``: exit code 0 done, 1 refused or failed with one sentence, 2 usage."""

import argparse
import os
import sys
from collections.abc import Sequence

import wrist_ft_comp
from wrist_ft_comp import WristFtCompError
from wrist_ft_comp.cli import calibrate, compensate, demo, evaluate, show

#: What a shell reports for a command that Ctrl-C ended.
_INTERRUPTED = 130


def build_parser() -> argparse.ArgumentParser:
    """Build the parser of all commands."""
    parser = argparse.ArgumentParser(
        prog='wrist_ft_comp',
        description='Remove the temperature drift of a wrist force/torque sensor.',
        epilog='Run "wrist_ft_comp COMMAND --help" for the options of a command.',
    )
    parser.add_argument('--version', action='version', version=wrist_ft_comp.__version__)
    commands = parser.add_subparsers(title='commands', metavar='COMMAND', required=True)
    for command in (calibrate, evaluate, compensate, show, demo):
        command.add_parser(commands)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """
    Run a command.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments behind the program's name; those of the process by default.

    Returns
    -------
    int
        Exit code.

    """
    arguments = build_parser().parse_args(argv)
    try:
        code: int = arguments.run(arguments)
        sys.stdout.flush()
    except WristFtCompError as error:
        print(f'wrist_ft_comp: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('wrist_ft_comp: interrupted; nothing was left half-written.', file=sys.stderr)
        return _INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has gone (such as "head"); Python must not try to flush again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return code


if __name__ == '__main__':
    sys.exit(main())
