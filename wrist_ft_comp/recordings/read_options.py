"""How a recording is read: topics of a bag, columns of a table, and which part of it counts."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import yaml

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.recordings.column_map import ColumnMap, parse_map
from wrist_ft_comp.recordings.excerpt import Excerpt, parse_excerpt
from wrist_ft_comp.stored.own_file import beginning

#: File beside recordings that says how they are read.
MAP_FILE = 'recording.yaml'
_KEYS = 'columns', 'time', 'from', 'until', 'exclude'


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
