"""Options that several commands share, and the forms of their output."""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
import json
import math
from pathlib import Path
from typing import get_args

from tqdm import tqdm

from wrist_ft_comp.cli.suggestions import one_of
from wrist_ft_comp.core.problem import Reference
from wrist_ft_comp.files.recordings import Topics

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
