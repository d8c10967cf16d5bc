"""
What counts of a recording, and what was said of how to read it.

What is before ``--from``, after ``--until`` or within ``--exclude`` does not count. ``--columns``
and ``--time`` (``column_map``) may stand in ``recording.yaml`` beside the recordings.
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
from wrist_ft_comp.recording import clock_time, Samples, Topics
from wrist_ft_comp.recordings.column_map import Column, parse_map
from wrist_ft_comp.series import CLOCK_NS, NANOSECONDS
from wrist_ft_comp.stored.safe_file import beginning
from wrist_ft_comp.stream.clock import NO_TIME
from wrist_ft_comp.units import TIME_UNITS_NS

#: File beside recordings that says how they are read.
MAP_FILE = 'recording.yaml'


@dataclass(frozen=True)
class ReadOptions:
    """What was said of a recording, understood."""

    #: As it was said; of a table with what ``recording.yaml`` beside it says.
    topics: Topics = field(default_factory=Topics)
    #: What ``--columns`` says; their places are not known yet.
    columns: tuple[Column, ...] = ()
    #: What ``--time`` says: a unit, iso, a form of strptime; empty where nothing was said.
    time: str = ''
    #: Who said so.
    source: str = '--columns'
    #: What counts begins and ends here, s since the first stamp of the file.
    begin_s: float = -math.inf
    end_s: float = math.inf
    #: Beginning and end of stretches whose wrenches are left out; temperatures go on.
    excluded_s: tuple[tuple[float, float], ...] = ()

    def select(
        self, blocks: Iterable[Samples], name: str, first_ns: list[int]
    ) -> Iterator[Samples]:
        """
        Leave out what does not count; SettingsError where nothing is left of a recording.

        Blocks come as they begin, but those of TF last. The first stamp of all, from which times
        count, is put into ``first_ns``.
        """
        lasts_s = 0.0
        #: Whether a sample was left, by what came.
        is_left: dict[str, bool] = {}
        for block in blocks:
            timed = block.stamps_ns != NO_TIME  # the first messages may have no stamp yet
            first_ns += block.stamps_ns[timed][:1].tolist()
            begin_ns = first_ns[0] if first_ns else 0
            since_s = np.where(timed, block.stamps_ns - begin_ns, 0) / NANOSECONDS
            kind = 'wrench' if block.channels[0] in AXES else block.channels[0].split('_')[0]
            counts = (since_s >= self.begin_s) & (since_s <= self.end_s)
            for begin_s, end_s in self.excluded_s if kind == 'wrench' else ():
                counts &= (since_s < begin_s) | (since_s > end_s)
            lasts_s = max(lasts_s, float(since_s.max(initial=0.0)))
            if timed.any():
                is_left[kind] = is_left.get(kind, False) or bool(counts.any())
            yield Samples(block.channels, block.stamps_ns[counts], block.values[counts])
        for kind in ('wrench', 'temperature'):
            if not is_left.get(kind, True):
                is_clock = first_ns[0] >= CLOCK_NS
                begins = f'begins at {clock_time(first_ns[0])} and ' if is_clock else ''
                raise SettingsError(
                    f'Every {kind} of {name}, which {begins}lasts {lasts_s:.0f} s, is left out '
                    'by --from, --until and --exclude. Leave some in.'
                )


def _seconds(text: str) -> float:
    """Read a time since the beginning: 4800, 80min, 1.5h or 1:20:00."""
    if match := re.fullmatch(r'(\d+\.?\d*|\.\d+)(s|min|h|)', text.strip()):
        return float(match[1]) * (TIME_UNITS_NS[match[2] or 's'] // NANOSECONDS)
    if re.fullmatch(r'\d+(:\d\d){1,2}(\.\d+)?', text.strip()):
        hours, minutes, seconds = (*map(float, text.strip().split(':')), 0.0)[:3]
        return 3600 * hours + 60 * minutes + seconds
    raise SettingsError(f'A time is written 4800, 80min, 1.5h or 1:20:00; got {text!r}.')


def parse_options(topics: Topics, source: str = '--columns') -> ReadOptions:
    """Understand what was said; SettingsError where it can't be meant so."""
    columns, time = parse_map(topics.columns, topics.time)
    excluded_s = []
    for text in topics.exclude:
        first, dots, last = text.partition('..')
        if not dots:
            raise SettingsError(f'A stretch is A..B, such as 79min..81min; got {text!r}.')
        excluded_s.append((_seconds(first), _seconds(last)))
    begin_s = _seconds(topics.begin) if topics.begin else -math.inf
    end_s = _seconds(topics.end) if topics.end else math.inf
    for first_s, last_s in (*excluded_s, (begin_s, end_s)):
        if not first_s < last_s:
            raise SettingsError(f'A part ends after it begins; got {first_s:g} to {last_s:g} s.')
    return ReadOptions(topics, columns, time, source, begin_s, end_s, tuple(excluded_s))


def options_beside(table: Path, topics: Topics) -> ReadOptions:
    """Understand what was said of a table; without --columns, what ``recording.yaml`` says."""
    beside = table.with_name(MAP_FILE)
    if topics.columns or not beside.is_file():
        return parse_options(topics)
    try:
        # Texts alone. An empty value is ''.
        content = yaml.load(beginning(beside), yaml.BaseLoader)  # noqa: S506 -- safe, too
    except yaml.YAMLError as error:
        raise RecordingError(f'{beside} cannot be read: {error}.') from error
    if not isinstance(content, dict) or not content.keys() <= {'columns', 'time'}:
        raise RecordingError(
            f'{beside} must have the keys columns and time, and no others. If it is of another '
            'program, move it, or give --columns.'
        )
    columns, time = (str(content.get(key, '')) for key in ('columns', 'time'))
    said = replace(topics, columns=columns, time=topics.time or time)
    return parse_options(said, f'{MAP_FILE} beside it')


def recipe(columns: str, time: str) -> list[str]:
    """Write a map as the lines of ``recording.yaml``."""
    said = {'columns': columns, 'time': time} if time else {'columns': columns}
    return yaml.safe_dump(said, sort_keys=False, width=1000, allow_unicode=True).splitlines()
