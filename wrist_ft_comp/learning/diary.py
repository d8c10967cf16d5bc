"""
The diary of a node that learns by itself: ``days/diary.json``, and which recordings are kept.

Only the learning job writes it, in one step. One that is broken or missing is made anew.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import fcntl
import os
from pathlib import Path
import tempfile

import numpy as np

from wrist_ft_comp.errors import ModelFileError, RecordingError
from wrist_ft_comp.learning.challenge import worthiest
from wrist_ft_comp.learning.day_files import day_number, days, size_of
from wrist_ft_comp.learning.entry import DayEntry, Decision, Diary
from wrist_ft_comp.stored.documents import Document, Kind, plain, tuples, writing

KIND = Kind(
    name='diary', says='wrist_ft_comp diary', version=1, schema='diary.schema.json', keeps=True,
    max_bytes=20_000_000, error=RecordingError, made_by='A node that learns makes one.',
    renewed_by='Remove it',
    unwritable='{path} cannot be written: {reason}. Make room, or choose another '
    'data_directory; until then nothing is learnt.')  # fmt: skip
#: Days and decisions that are remembered.
_MOST_DAYS, _MOST_DECISIONS = 1000, 100
#: Room for the diary itself, and for the rows between two looks at the folder, MB.
_SPARE_MB = 10.0


def diary_path(directory: Path) -> Path:
    """Tell where the diary of a node's folder lies."""
    return directory / 'days' / 'diary.json'


def load_diary(directory: Path) -> Diary:
    """Read a diary; an empty one where there is none that can be read."""
    with suppress(RecordingError, ModelFileError, OSError):
        if document := KIND.load_json(diary_path(directory)):
            entries = tuple(
                _entry(values) for values in document['days'] if day_number(values['name'])
            )
            decisions = tuple(Decision(**each) for each in document['decisions'])
            return Diary(entries, decisions, document['paused'])
    return Diary()


def save_diary(directory: Path, diary: Diary) -> None:
    """Write a diary in one step; the oldest days are forgotten."""
    document = {
        'days': [_entry_values(entry) for entry in diary.days[-_MOST_DAYS:]],
        'decisions': [each._asdict() for each in diary.decisions[-_MOST_DECISIONS:]],
        'paused': diary.paused,
    }
    KIND.write_json(diary_path(directory), document)


def prune(directory: Path, diary: Diary, keep_days: int, max_mb: float) -> list[str]:
    """Remove recordings until both bounds hold; names what is left. RecordingError if it can't."""
    there = {path.name: path for path in days(directory)}
    kept = [entry for entry in diary.days if entry.name in there]
    room = 1e6 * (max_mb - _SPARE_MB)
    while kept and (
        len(kept) > keep_days or sum(size_of(there[each.name]) for each in kept) > room
    ):
        before, kept = kept, worthiest(kept, len(kept) - 1) if len(kept) > 1 else []
        (name,) = {each.name for each in before} - {each.name for each in kept}
        with writing(there[name]):
            there.pop(name).unlink(missing_ok=True)
    return list(there)


@contextmanager
def alone() -> Iterator[bool]:
    """Tell whether nobody else of this user learns on this computer, and keep it so."""
    # In the folder for temporary files, because the folders of two sensors may have nothing in
    # common. The system releases it where the process is killed.
    path = Path(tempfile.gettempdir()) / f'wrist_ft_comp_learning_{os.getuid()}.lock'
    handle = os.open(path, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield True
    except BlockingIOError:
        yield False
    finally:
        os.close(handle)


def _entry_values(entry: DayEntry) -> Document:
    """Turn an entry into plain values; NaN is null."""
    rounded = {
        model: [float(f'{each:.5g}') for each in axes] for model, axes in entry.left.items()
    }
    values: Document = plain({**vars(entry), 'known': sorted(entry.known), 'left': rounded})
    return values


def _entry(values: Document) -> DayEntry:
    """Build an entry from values that were checked."""
    entry = tuples(values)
    entry['known'] = frozenset(entry['known'])
    for model, axes in entry['left'].items():
        entry['left'][model] = tuple(np.nan if each is None else float(each) for each in axes)
    return DayEntry(**entry)
