"""
The diary of a node that learns by itself, ``days/diary.json``: what is kept of every day.

Only the learning job writes it, in one step. One that is broken or missing is made anew. By it is
decided which days may be learnt from and whose recordings are kept.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
import fcntl
import os
from pathlib import Path
import tempfile
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.errors import ModelFileError, RecordingError
from wrist_ft_comp.learning.day_files import day_number, days, size_of, span_of
from wrist_ft_comp.signals import AXES, FloatArray, NANOSECONDS
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
#: Files that are nowhere but in a node's folder.
_MARKS = ('active.json', 'learning.json', 'state.json')

#: Coarse temperatures: of the first thermometer, and the differences of the others from it.
Cell = tuple[int, ...]
#: Names for what was left of a day's drift: without any model, and by a challenger.
NONE, CHALLENGER = 'none', 'challenger'

#: Kinds of incidents: a day that cannot be read, or that tells of the sensor only …
UNREADABLE, CONTACTS, THERMOMETER = 'unreadable', 'contacts', 'thermometer'
#: … another tool, whose drift can be learnt as well …
TOOL = 'tool'
#: … and what changes the sensor.
ZERO, GAIN, NOISE, MOUNTING = 'zero', 'gain', 'noise', 'mounting'
LEARNT_FROM = ('', TOOL)
PAUSING = (ZERO, GAIN, NOISE, MOUNTING)
#: Before these, the sensor was another one.
FORGETTING = (GAIN, MOUNTING)


@dataclass(frozen=True)
class DayEntry:
    """What is kept of a day at work, also when its recording is gone."""

    #: Name of its file.
    name: str
    #: Stamp of its first cell, and how long its cells last together.
    first_ns: int = 0
    hours: float = 0.0
    #: Lowest and highest temperature of each thermometer, °C, and for how long it stood still, s.
    temperature_c: tuple[tuple[float, float], ...] = ()
    still_s: tuple[float, ...] = ()
    #: Coarse temperatures that it saw.
    known: frozenset[Cell] = frozenset()
    #: By the first twelve digits of a model's SHA-256, NONE or CHALLENGER: RMS of the drift that
    #: it left, tared in the first minute, in the order AXES, N and N m; NaN where an axis says
    #: nothing.
    left: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    #: Which of these was live; empty when none was.
    live: str = ''
    #: Why there is a new model, or none, in a sentence or two.
    verdict: str = ''
    #: What happened to the sensor, with size and time, and its kind; empty when nothing did.
    incident: str = ''
    kind: str = ''
    #: Whether a challenger was learnt.
    challenged: bool = False
    #: Processor time that the day took, s.
    seconds: float = 0.0
    #: Mass, kg, and centre of mass, m, of each payload; the rotation of the specific force's frame
    #: into the wrench's, row by row; noise of a cell, N and N m. Empty where they are not known.
    payloads: tuple[tuple[float, ...], ...] = ()
    rotation: tuple[float, ...] = ()
    noise: tuple[float, ...] = ()


class Decision(NamedTuple):
    """A change of the live model, or of whether there is learning: after which day, and why."""

    day: str
    sentence: str


@dataclass(frozen=True)
class Diary:
    """All days, oldest first, also those whose recordings are gone."""

    days: tuple[DayEntry, ...] = ()
    decisions: tuple[Decision, ...] = ()
    #: Why learning has stopped on its own; empty when it has not.
    paused: str = ''


def forces_left(entry: DayEntry) -> FloatArray:
    """Give RMS of a force, N, without a model, with the live one and the challenger; or NaN."""
    found = []
    for model in (NONE, entry.live, CHALLENGER):
        forces = [value for value in entry.left.get(model, ())[:3] if not np.isnan(value)]
        found.append(np.sqrt(np.mean(np.square(forces))) if forces else np.nan)
    return np.array(found)


def share_left(entry: DayEntry, model: str) -> FloatArray:
    """Share of a day's drift that a model left, (6,); NaN where it is not known."""
    unknown = (np.nan,) * len(AXES)
    drift = np.maximum(entry.left.get(NONE, unknown), 1e-12)
    return np.asarray(np.array(entry.left.get(model, unknown)) / drift)


def good_days(entries: Sequence[DayEntry]) -> list[DayEntry]:
    """Choose days that may be learnt from: of the last one's sensor, and without an incident."""
    start = max((n for n, entry in enumerate(entries) if entry.kind in FORGETTING), default=-1)
    good = [entry for entry in entries[start + 1 :] if entry.kind in LEARNT_FROM]
    return [day for day in good if len(day.temperature_c) == len(good[-1].temperature_c)]


def worthiest(entries: Sequence[DayEntry], most: int) -> list[DayEntry]:
    """Choose ``most`` days in their order: the newer half, and those with rare temperatures."""
    chosen, newer = list(entries), max(most // 2, 1)
    while len(chosen) > max(most, 1):
        good = good_days(chosen)
        count = Counter(cell for day in good for cell in day.known)
        worth = [
            sum(1 / count[cell] for cell in day.known) if day in good else -1.0
            for day in chosen[:-newer]
        ]
        del chosen[int(np.argmin(worth))]
    return chosen


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
            decisions = tuple(Decision(**values) for values in document['decisions'])
            return Diary(entries, decisions, document['paused'])
    return Diary()


def save_diary(directory: Path, diary: Diary) -> None:
    """Write a diary in one step; the oldest days are forgotten."""
    document = {
        'days': [_entry_values(entry) for entry in diary.days[-_MOST_DAYS:]],
        'decisions': [decision._asdict() for decision in diary.decisions[-_MOST_DECISIONS:]],
        'paused': diary.paused,
    }
    KIND.write_json(diary_path(directory), document)


def prune(directory: Path, diary: Diary, keep_days: int, max_mb: float) -> list[str]:
    """
    Remove recordings until both bounds hold, but none that nobody judged; names what is left.

    RecordingError where one cannot be removed.
    """
    paths = {path.name: path for path in days(directory)}
    kept = [entry for entry in diary.days if entry.name in paths]
    room = 1e6 * (max_mb - _SPARE_MB)
    while kept and (
        len(kept) > keep_days or sum(size_of(paths[entry.name]) for entry in kept) > room
    ):
        before, kept = kept, worthiest(kept, len(kept) - 1) if len(kept) > 1 else []
        (name,) = {entry.name for entry in before} - {entry.name for entry in kept}
        with writing(paths[name]):
            paths.pop(name).unlink(missing_ok=True)
    return list(paths)


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


def node_folders(path: Path) -> list[Path]:
    """Find the folders of nodes in what a person named: one, its days, or several sensors'."""
    if path.is_dir() and path.resolve().name == 'days':
        return [path.resolve().parent]
    if (path / 'days').is_dir() or any((path / mark).exists() for mark in _MARKS):
        return [path]
    return sorted(folder.parent for folder in path.glob('*/days') if folder.is_dir())


def survey(directory: Path) -> Diary:
    """Add the days that nobody judged to a folder's diary; RecordingError where no day is kept."""
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


def _entry_values(entry: DayEntry) -> Document:
    """Turn an entry into plain values; NaN is null."""
    rounded = {
        model: [float(f'{value:.5g}') for value in axes] for model, axes in entry.left.items()
    }
    values: Document = plain({**vars(entry), 'known': sorted(entry.known), 'left': rounded})
    return values


def _entry(values: Document) -> DayEntry:
    """Build an entry from values that were checked."""
    entry = tuples(values)
    entry['known'] = frozenset(entry['known'])
    for model, axes in entry['left'].items():
        entry['left'][model] = tuple(np.nan if value is None else float(value) for value in axes)
    return DayEntry(**entry)
