"""Options that several commands share, and how their values become settings."""

import argparse
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import get_args

from tqdm import tqdm

from wrist_ft_comp.core.problem import Reference
from wrist_ft_comp.files.recordings import Topics

RECORDING_HELP = (
    'a rosbag2 folder, a bare .mcap or .db3, a CSV file, or a chamber table '
    '(see the README for their columns)'
)


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
        When one is not a number.

    """
    return tuple(sorted({_number(part) for part in text.split(',')}))


def _number(text: str) -> float:
    """Parse a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'expected a number, got {text!r}')
    return value


def add_topics(parser: argparse.ArgumentParser) -> None:
    """Add the names of topics in bags."""
    defaults = Topics()
    group = parser.add_argument_group('topics in bags')
    group.add_argument('--wrench-topic', default=defaults.wrench, metavar='TOPIC')
    group.add_argument(
        '--temperature-topic',
        action='append',
        metavar='TOPIC',
        help='once per thermometer, the one inside the sensor first '
        f'(default: {", ".join(defaults.temperatures)})',
    )
    group.add_argument('--reference-topic', default=defaults.reference, metavar='TOPIC')


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
        help='what the true wrench was: zero, an unknown constant, or recorded beside the raw one '
        '(default: recorded for chamber tables, else unloaded)',
    )


def add_output_forms(parser: argparse.ArgumentParser) -> None:
    """Add the forms of output."""
    parser.add_argument('--report', type=Path, metavar='REPORT.html', help='write a report, too')
    parser.add_argument('--json', action='store_true', help='print JSON for scripts')


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
