"""
How a recording is read: topics of a bag, columns of a table, and which part of it counts.

A part is from, until, and without some stretches, in seconds since the first stamp of the file.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
import math
from pathlib import Path
import re

import numpy as np
import yaml

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.recording import Samples, Topics
from wrist_ft_comp.recordings.column_map import ColumnMap, parse_map
from wrist_ft_comp.series import CLOCK_NS, NANOSECONDS
from wrist_ft_comp.stored.own_file import beginning
from wrist_ft_comp.stream.clock import NO_TIME

#: File beside recordings that says how they are read.
MAP_FILE = 'recording.yaml'
_KEYS = 'columns', 'time', 'from', 'until', 'exclude'
_UNITS_S = {'': 1.0, 's': 1.0, 'min': 60.0, 'h': 3600.0}


@dataclass(frozen=True)
class Excerpt:
    """What of a recording counts."""

    #: Seconds since the first stamp of the file.
    begin_s: float = 0.0
    end_s: float = math.inf
    #: Beginning and end of stretches whose wrenches are left out; temperatures go on.
    excluded_s: tuple[tuple[float, float], ...] = ()

    def select(self, blocks: Iterable[Samples], name: str) -> Iterator[Samples]:
        """Leave out what does not count of a recording; SettingsError where nothing is left."""
        first_ns, lasts_s = None, 0.0
        came: set[str] = set()
        left: set[str] = set()
        for block in blocks:
            timed = block.stamps_ns != NO_TIME  # the first messages may have no stamp yet
            if first_ns is None and timed.any():
                first_ns = int(block.stamps_ns[timed][0])
            since_s = np.where(timed, block.stamps_ns - (first_ns or 0), 0) / NANOSECONDS
            kind = 'wrench' if set(block.channels) & set(AXES) else block.channels[0].split('_')[0]
            counts = (since_s >= self.begin_s) & (since_s <= self.end_s)
            for begin_s, end_s in self.excluded_s if kind == 'wrench' else ():
                counts &= (since_s < begin_s) | (since_s > end_s)
            lasts_s = max(lasts_s, float(since_s.max(initial=0.0)))
            came |= {kind} if timed.any() else set()
            left |= {kind} if counts.any() else set()
            yield Samples(block.channels, block.stamps_ns[counts], block.values[counts])
        if first_ns is None:
            return
        begins = ''
        if first_ns >= CLOCK_NS:  # stamps are of a clock
            clock = str(np.datetime64(first_ns // NANOSECONDS, 's')).replace('T', ' ')
            begins = f'begins at {clock} UTC and '
        lasts = f'{name}, which {begins}lasts {lasts_s:.0f} s'
        if not left:
            raise SettingsError(
                f'Nothing is left of {lasts}: what counts begins at {self.begin_s:.0f} s. Give an '
                'earlier --from.'
            )
        if gone := {'wrench', 'temperature'} & (came - left):
            raise SettingsError(
                f'Every {min(gone)} of {lasts}, is left out by --from, --until and --exclude. '
                'Leave some in.'
            )


@dataclass(frozen=True)
class ReadOptions:
    """What was said of a recording, understood."""

    #: As it was said; of a table with what ``recording.yaml`` beside it says.
    topics: Topics = field(default_factory=Topics)
    columns: ColumnMap = field(default_factory=ColumnMap)
    excerpt: Excerpt = field(default_factory=Excerpt)


def parse_options(topics: Topics, source: str = '--columns') -> ReadOptions:
    """Understand what was said; SettingsError where it can't be meant so."""
    columns = parse_map(topics.columns, topics.time, source)
    return ReadOptions(topics, columns, parse_excerpt(topics.begin, topics.end, topics.exclude))


def options_beside(table: Path, topics: Topics) -> ReadOptions:
    """Understand what was said of a table, and what ``recording.yaml`` beside it says more."""
    beside = table.with_name(MAP_FILE)
    if topics.columns or not beside.is_file():
        return parse_options(topics)
    try:
        content = yaml.safe_load(beginning(beside))
    except yaml.YAMLError as error:
        raise RecordingError(f'{beside} cannot be read: {error}.') from error
    if not isinstance(content, dict) or not content.keys() <= {*_KEYS}:
        raise RecordingError(
            f'{beside} must have the keys columns and time, perhaps from, until and exclude, and '
            'no others. If it is of another program, move it, or give --columns.'
        )
    entries, exclude = content.get('columns', ''), content.get('exclude', ())
    if isinstance(entries, dict):
        entries = ','.join(f'{ours}={theirs}' for ours, theirs in entries.items())
    said = replace(
        topics,
        columns=str(entries),
        time=topics.time or str(content.get('time', '')),
        begin=topics.begin or str(content.get('from', '')),
        end=topics.end or str(content.get('until', '')),
        exclude=topics.exclude or tuple([exclude] if isinstance(exclude, str) else exclude),
    )
    return parse_options(said, f'{MAP_FILE} beside it')


def recipe(columns: str, time: str) -> Iterable[str]:
    """Write a map as the lines of ``recording.yaml``."""
    yield f'columns: {yaml.safe_dump(columns, width=1000, allow_unicode=True).splitlines()[0]}'
    if time:
        yield f'time: {yaml.safe_dump(time).splitlines()[0]}'


def parse_excerpt(begin: str, end: str, exclude: Iterable[str]) -> Excerpt:
    """Understand ``--from``, ``--until`` and ``--exclude``, or refuse them by a SettingsError."""
    stretches = []
    for text in exclude:
        first, dots, last = text.partition('..')
        if not dots:
            raise SettingsError(
                f'A stretch is A..B, such as 4790..4830 or 79min..81min; got {text!r}.'
            )
        stretches.append((_seconds(first), _seconds(last)))
    excerpt = Excerpt(_seconds(begin or '0'), _seconds(end or 'inf'), tuple(stretches))
    for begin_s, end_s in (*excerpt.excluded_s, (excerpt.begin_s, excerpt.end_s)):
        if not begin_s < end_s:
            raise SettingsError(
                f'A part must end after it begins; got {begin_s:g} to {end_s:g} s.'
            )
    return excerpt


def _seconds(text: str) -> float:
    """Read a time since the beginning: 4800, 80min, 1.5h or 1:20:00."""
    if match := re.fullmatch(r'(inf|\d+\.?\d*|\.\d+)(s|min|h|)', text.strip()):
        return float(match[1]) * _UNITS_S[match[2]]
    if re.fullmatch(r'\d+(:\d\d){1,2}(\.\d+)?', text.strip()):
        hours, minutes, seconds = (*map(float, text.strip().split(':')), 0.0)[:3]
        return 3600 * hours + 60 * minutes + seconds
    raise SettingsError(f'A time is written 4800, 80min, 1.5h or 1:20:00; got {text!r}.')
