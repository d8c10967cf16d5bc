"""
The diary of a node that learns by itself: ``days/diary.json``, and which recordings are kept.

    <directory>/days/day_*.csv     thermal cells of a day, an ordinary recording
    <directory>/days/diary.json    one entry per day, also of days whose recording is gone

Only the learning job writes the diary, in one step. One that is broken or missing is made anew.
"""

from dataclasses import asdict, replace
import json
from pathlib import Path
from typing import Any

import numpy as np

from wrist_ft_comp.calibration.learning.entry import DayEntry, Decision, Diary
from wrist_ft_comp.errors import ModelFileError, RecordingError
from wrist_ft_comp.files.documents import Document, Kind

__all__ = ['DayEntry', 'Decision', 'Diary', 'days', 'diary_path', 'load_diary', 'save_diary']

KIND = Kind(
    name='diary', says='wrist_ft_comp diary', version=1, schema='diary.schema.json',
    max_bytes=20_000_000, error=RecordingError, made_by='A node that learns makes one.',
    renewed_by='Remove it',
    unwritable='{path} cannot be written: {reason}. Make room, or choose another '
    'data_directory; until then nothing is learnt.')  # fmt: skip
#: Days and decisions that are remembered.
_MOST_DAYS, _MOST_DECISIONS = 1000, 100


def days(directory: Path) -> list[Path]:
    """List the recordings of days below a node's folder, oldest first."""
    return sorted((directory / 'days').glob('day_*.csv'))


def diary_path(directory: Path) -> Path:
    """Tell where the diary of a node's folder lies."""
    return directory / 'days' / 'diary.json'


def load_diary(directory: Path) -> Diary:
    """Read a diary; an empty one where there is none that can be read."""
    try:
        document = KIND.load_json(diary_path(directory))
        return Diary() if document is None else _diary(document)
    except (RecordingError, ModelFileError, OSError):
        return Diary()


def save_diary(directory: Path, diary: Diary) -> None:
    """Write a diary in one step; the oldest days are forgotten."""
    document = {
        'format': KIND.says,
        'version': KIND.version,
        'days': [_entry_values(entry) for entry in diary.days[-_MOST_DAYS:]],
        'decisions': [each._asdict() for each in diary.decisions[-_MOST_DECISIONS:]],
        'paused': diary.paused,
    }
    KIND.write(diary_path(directory), json.dumps(document, indent=1, allow_nan=False))


def _entry_values(entry: DayEntry) -> Document:
    """Turn an entry into plain values; NaN is null."""
    left = {
        model: [None if np.isnan(each) else float(f'{each:.5g}') for each in axes]
        for model, axes in entry.left.items()
    }
    return {**asdict(entry), 'known': sorted(entry.known), 'left': left}


def _diary(document: Document) -> Diary:
    """Build a diary from a document that was checked."""
    entries = tuple(_entry(values) for values in document['days'])
    decisions = tuple(Decision(**each) for each in document['decisions'])
    return Diary(entries, decisions, document['paused'])


def _entry(values: Document) -> DayEntry:
    """Build an entry from values that were checked."""
    known = frozenset(_tuples(values['known']))
    left = {
        model: tuple(np.nan if each is None else float(each) for each in axes)
        for model, axes in values['left'].items()
    }
    entry = DayEntry(**{key: _tuples(value) for key, value in values.items() if key != 'left'})
    return replace(entry, known=known, left=left)


def _tuples(value: Any) -> Any:
    """Turn the lists of a JSON value back into the tuples they were."""
    return tuple(_tuples(each) for each in value) if isinstance(value, list) else value
