"""What a node that learns has kept: its diary, together with days that nobody judged."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.learning.day_files import days, size_of, span_of
from wrist_ft_comp.learning.diary import load_diary
from wrist_ft_comp.learning.entry import DayEntry, Diary
from wrist_ft_comp.signals import NANOSECONDS

#: What is nowhere but in a node's folder.
_MARKS = ('active.json', 'learning.json', 'state.json')


def node_folders(path: Path) -> list[Path]:
    """Find the folders of nodes in what a person named: one, its days, or several sensors'."""
    if path.is_dir() and path.resolve().name == 'days':
        return [path.resolve().parent]
    if (path / 'days').is_dir() or any((path / mark).exists() for mark in _MARKS):
        return [path]
    return sorted(each.parent for each in path.glob('*/days') if each.is_dir())


def survey(directory: Path) -> Diary:
    """Look at the days of a node's folder; RecordingError when none were kept there."""
    diary = load_diary(directory)
    judged = {entry.name for entry in diary.days}
    others = (_unjudged(path) for path in days(directory) if path.name not in judged)
    entries = sorted((*diary.days, *others), key=lambda entry: entry.name)
    if not entries:
        raise RecordingError(
            f'{directory} holds no days. A node keeps them with the parameter learning set to '
            'propose or auto.'
        )
    return replace(diary, days=tuple(entries))


def _unjudged(path: Path) -> DayEntry:
    """Say when a day was, by its file."""
    span = None
    with suppress(OSError):
        span = span_of(path) if size_of(path) else None
    if span is None:
        return DayEntry(path.name, verdict='it is no file with rows of a day')
    hours = (span.last_ns - span.first_ns) / NANOSECONDS / 3600
    return DayEntry(path.name, span.first_ns, hours, verdict='not judged yet')
