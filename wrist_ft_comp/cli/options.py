"""wrist_ft_comp completion: a script that lets a shell complete commands, options and files."""

import argparse
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
import difflib
from importlib.util import find_spec
import json
import math
from pathlib import Path
import re
from typing import get_args

from tqdm import tqdm

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.files.bag import Topics
from wrist_ft_comp.model.ranges import PERIODS_S
from wrist_ft_comp.model.signals import Reference


def with_negative_values(argv: Sequence[str]) -> list[str]:
    """
    Join options with values that begin with a minus sign, which argparse takes for options.

    Parameters
    ----------
    argv : sequence of str
        As typed, such as ``--hat-temperatures -40,0,20``.

    Returns
    -------
    list of str
        Such as ``--hat-temperatures=-40,0,20``.

    """
    joined: list[str] = []
    for word in argv:
        before = joined[-1] if joined else ''
        if re.match(r'-\.?\d', word) and re.fullmatch(r'--[a-z-]+', before):
            joined[-1] = f'{before}={word}'
        else:
            joined.append(word)
    return joined


def positive(text: str) -> float:
    """
    Parse a positive number.

    Parameters
    ----------
    text : str
        As typed.

    Returns
    -------
    float
        Finite and above 0.

    Raises
    ------
    argparse.ArgumentTypeError
        When it is not.

    """
    value = _number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f'expected a number above 0, got {text}')
    return value


def not_negative(text: str) -> float:
    """
    Parse a number of at least 0.

    Parameters
    ----------
    text : str
        As typed.

    Returns
    -------
    float
        Finite and at least 0.

    Raises
    ------
    argparse.ArgumentTypeError
        When it is not.

    """
    value = _number(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f'expected a number of at least 0, got {text}')
    return value


def period(text: str) -> float:
    """
    Parse a thermal period.

    Parameters
    ----------
    text : str
        As typed.

    Returns
    -------
    float
        Within PERIODS_S.

    Raises
    ------
    argparse.ArgumentTypeError
        When it is not.

    """
    value = _number(text)
    if not PERIODS_S[0] <= value <= PERIODS_S[1]:
        raise argparse.ArgumentTypeError(
            f'expected {PERIODS_S[0]:g} to {PERIODS_S[1]:g} s, got {text}'
        )
    return value


def temperatures(text: str) -> tuple[float, ...]:
    """
    Parse temperatures that are separated by commas.

    Parameters
    ----------
    text : str
        Such as ``-40,0,20,50``.

    Returns
    -------
    tuple of float
        Increasing, without repetitions, °C.

    Raises
    ------
    argparse.ArgumentTypeError
        When one is not a number, or there are fewer than two.

    """
    found = tuple(sorted({_number(part) for part in text.split(',')}))
    if len(found) < 2:
        raise argparse.ArgumentTypeError(f'expected at least two temperatures, got {text!r}')
    return found


def _number(text: str) -> float:
    """Parse a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'expected a number, got {text!r}')
    return value


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """
    Suggest the known word that is most like a mistyped one.

    Parameters
    ----------
    word : str
        As typed.
    known : iterable of str
        What it can have meant.

    Returns
    -------
    str
        A sentence with a space before it, or nothing when none is alike.

    """
    near = difflib.get_close_matches(word, list(known), 1)
    return f' Did you mean {near[0]}?' if near else ''


def one_of(choices: Collection[str]) -> Callable[[str], str]:
    """
    Make a parser of values that names the choice which a mistyped value may have meant.

    Parameters
    ----------
    choices : collection of str
        What is allowed.

    Returns
    -------
    callable
        For ``add_argument(type=…)``, beside its ``choices``.

    """

    def parse(text: str) -> str:
        if text not in choices:
            raise argparse.ArgumentTypeError(
                f'invalid choice: {text!r}; expected one of {", ".join(choices)}.'
                f'{did_you_mean(text, choices)}'
            )
        return text

    return parse


def check_words(
    parser: argparse.ArgumentParser,
    commands: Mapping[str, argparse.ArgumentParser],
    argv: Sequence[str],
) -> None:
    """
    Refuse an unknown command or option before argparse does, which knows no suggestion.

    Argparse would also name the first argument that is missing instead of the option that was
    mistyped. Ends the process with exit code 2, as argparse does.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Of all commands.
    commands : mapping of str to argparse.ArgumentParser
        By name.
    argv : sequence of str
        Arguments behind the program's name.

    """
    at = next((i for i, word in enumerate(argv) if not word.startswith('-')), len(argv))
    _check_options(parser, argv[:at])
    if at == len(argv):
        return
    command = argv[at]
    if command not in commands:
        parser.error(
            f'there is no command {command!r}; expected one of {", ".join(commands)}.'
            f'{did_you_mean(command, commands)}'
        )
    _check_options(commands[command], argv[at + 1 :])


def _check_options(parser: argparse.ArgumentParser, words: Sequence[str]) -> None:
    """Refuse a long option that is none, nor the beginning of one."""
    options = parser._option_string_actions  # noqa: SLF001 -- argparse has no public list of them
    for word in words:
        name = word.partition('=')[0]
        if name == '--':
            return
        if name.startswith('--') and not any(option.startswith(name) for option in options):
            parser.error(f'there is no option {name}.{did_you_mean(name, options)}')


RECORDING_HELP = (
    'a rosbag2 folder, a bare .mcap or .db3, a CSV file, or a chamber table '
    '(see the README for their columns)'
)


def add_topics(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add the names of topics in bags; returns their group."""
    defaults = Topics()
    group = parser.add_argument_group('topics in bags')
    group.add_argument(
        '--wrench-topic', default=defaults.wrench, metavar='TOPIC', help='(default: %(default)s)'
    )
    group.add_argument(
        '--temperature-topic',
        action='append',
        metavar='TOPIC',
        help='once per thermometer, the one inside the sensor first '
        f'(default: {", ".join(defaults.temperatures)})',
    )
    group.add_argument(
        '--reference-topic',
        default=defaults.reference,
        metavar='TOPIC',
        help='(default: %(default)s)',
    )
    return group


def topics_from(arguments: argparse.Namespace) -> Topics:
    """Build the topics that were given."""
    defaults = Topics()
    return Topics(
        wrench=arguments.wrench_topic,
        temperatures=tuple(arguments.temperature_topic or defaults.temperatures),
        reference=arguments.reference_topic,
    )


def add_reference(parser: argparse.ArgumentParser) -> None:
    """Add what the true wrench was."""
    parser.add_argument(
        '--reference',
        choices=get_args(Reference),
        type=one_of(get_args(Reference)),
        help='what the true wrench was: zero, an unknown constant, or recorded beside the raw one '
        '(default: recorded for chamber tables, else unloaded)',
    )


def add_copied_columns(parser: argparse.ArgumentParser) -> None:
    """Add whether to use columns that cannot have been measured."""
    parser.add_argument(
        '--keep-copied-columns',
        action='store_true',
        help='use columns of a chamber table that repeat another one, too',
    )


def add_output_forms(parser: argparse.ArgumentParser) -> None:
    """Add the forms of output."""
    parser.add_argument('--report', type=Path, metavar='REPORT.html', help='write a report, too')
    add_json(parser)


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add the form of output that scripts read."""
    parser.add_argument('--json', action='store_true', help='print JSON for scripts')


def print_json(value: object) -> None:
    """
    Print JSON for scripts: nothing else goes to standard output then.

    Parameters
    ----------
    value : object
        Dictionaries, lists and plain values; numbers that are not finite become null.

    """
    print(json.dumps(_finite(value), indent=1, allow_nan=False, default=str))


def _finite(value: object) -> object:
    """Put None in the place of numbers that JSON does not know."""
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[float], None]]:
    """
    Show progress on standard error; nothing when that is not a terminal.

    Parameters
    ----------
    what : str
        What is going on.

    Yields
    ------
    callable
        To be told the share that is done, 0 to 1.

    """
    form = '{desc} {percentage:3.0f}%|{bar}| {elapsed}'
    with tqdm(total=1.0, desc=what, disable=None, leave=False, bar_format=form) as bar:

        def report(share: float) -> None:
            bar.update(max(share - bar.n, 0.0))

        yield report


SHELLS = ('bash', 'zsh')


EXAMPLES = """\
examples:
  wrist_ft_comp completion bash > \\
      ~/.local/share/bash-completion/completions/wrist_ft_comp
  wrist_ft_comp completion zsh > ~/.zfunc/_wrist_ft_comp

zsh looks into ~/.zfunc when ~/.zshrc says, before compinit: fpath+=~/.zfunc
"""


def add_parser(
    commands: 'argparse._SubParsersAction[argparse.ArgumentParser]',
    parser: argparse.ArgumentParser,
) -> None:
    """Add the command; the parser is the one whose words are completed."""
    own = commands.add_parser(
        'completion',
        help='print a script that completes words in a shell',
        description='Print a script that lets a shell complete commands, options and files.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    own.set_defaults(run=run, whole=parser, commands=commands)
    own.add_argument('shell', choices=SHELLS, type=one_of(SHELLS), metavar='SHELL',
                     help=', '.join(SHELLS))  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    if find_spec('shtab') is None:
        raise SettingsError(
            'Completion needs the package shtab, which this Python does not have. Install it '
            '(pip install shtab), then run this again.'
        )
    import shtab  # noqa: PLC0415 -- optional, and only here

    for parser in arguments.commands.choices.values():
        for action in parser._actions:  # noqa: SLF001 -- argparse has no public list of them
            if action.type is Path:
                vars(action)['complete'] = shtab.FILE
    print(shtab.complete(arguments.whole, arguments.shell))
    return 0
