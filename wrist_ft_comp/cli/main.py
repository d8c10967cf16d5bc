"""The command ``wrist_ft_comp``: exit code 0 done, 1 refused with one sentence, 2 usage."""

from argparse import RawDescriptionHelpFormatter as Form
from collections.abc import Sequence
import io
import os
import re
import signal
import sys

import wrist_ft_comp
from wrist_ft_comp.cli import calibrate, compensate, demo, evaluate, node, show
from wrist_ft_comp.cli.options import Parser
from wrist_ft_comp.cli.terminal import print_json
from wrist_ft_comp.errors import UsageError, WristFtCompError

_EXIT_CODES = """\
exit code: 0 done, 1 refused or failed, in one sentence on standard error,
2 wrong usage, 130 interrupted.
"""


def build_parser() -> Parser:
    """Build the parser of all commands."""
    parser = Parser(
        prog='wrist_ft_comp',
        description='Remove the temperature drift of a wrist force/torque sensor.',
        epilog=f'Run "wrist_ft_comp COMMAND --help" for its options.\n\n{_EXIT_CODES}',
        formatter_class=Form)  # fmt: skip
    parser.add_argument('--version', action='version', version=wrist_ft_comp.__version__)
    commands = parser.add_subparsers(title='commands', metavar='COMMAND', required=True)
    for command in (calibrate, evaluate, compensate, show, node, demo):
        subparser = commands.add_parser(
            command.__name__.rpartition('.')[2], help=command.HELP,
            description=command.DESCRIPTION,
            epilog=_EXIT_CODES, formatter_class=Form)  # fmt: skip
        subparser.set_defaults(run=command.run)
        command.add_arguments(subparser)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command, with the process's arguments by default; returns the exit code."""
    words = sys.argv[1:] if argv is None else argv
    try:
        if isinstance(sys.stdout, io.TextIOWrapper):  # any character in a narrow locale, too
            sys.stdout.reconfigure(errors='backslashreplace')
        try:
            arguments = build_parser().parse_args(words)
        except SystemExit:  # --help and --version have printed
            sys.stdout.flush()
            raise
        code = int(arguments.run(arguments))
        sys.stdout.flush()  # or an error says why what was printed has not left the process
    except WristFtCompError as error:
        kind, sentence, code = error.kind(), str(error), 2 if isinstance(error, UsageError) else 1
    except KeyboardInterrupt as error:
        kind, sentence = 'interrupted', str(error) or 'interrupted; nothing was left half-written.'
        code = 128 + signal.SIGINT
    except BrokenPipeError:  # the reader of our output has gone, such as "head"
        _abandon_output()
        return 0
    except OSError as error:
        where = f'{error.filename}: ' if error.filename is not None else 'Reading or writing: '
        sentence = f'{where}{error.strerror or error}. Check the path, rights and free space.'
        kind, code = 'operating_system', 1
    else:
        return code
    # One line of standard error; what others say may end in a full stop of its own.
    sentence = re.sub(r'(?<=\w)\.\.(?= |$)', '.', ' '.join(sentence.split()))
    print(f'wrist_ft_comp: {sentence}', file=sys.stderr)
    try:
        if '--json' in words:
            print_json({'error': {'kind': kind, 'message': sentence}})
        sys.stdout.flush()
    except OSError:
        _abandon_output()
    return code


def _abandon_output() -> None:
    """Let Python's own flush at exit succeed although nobody takes our output."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
