"""
The days of a node that learns: their recordings, the diary that has an entry for each, the memory.

Recordings are ``days/day_00001.csv`` …; a day ends by its stamps alone: after DAY_NS, a silence of
SILENCE_NS, or where time runs back. The diary, ``days/diary.json``, decides which days may be
learnt from, and which recordings are kept: only the learning job writes it, and a broken or
missing one is made anew. The memory, ``learning.json``, is what the newest job said; the node
writes it.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from decimal import Decimal
from math import isnan
import os
from pathlib import Path
import re
from typing import Any, Literal, NamedTuple

import numpy as np

from wrist_ft_comp.channels import AXES, LARGEST, REFERENCE_CHANNELS, SensorNames
from wrist_ft_comp.drift.drift_model import differences
from wrist_ft_comp.errors import ModelFileError, RecordingError, StateFileError
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stored.node_folder import HistoryEntry, NodeFolder
from wrist_ft_comp.stored.recording_writer import CsvRecordingWriter, origin_column, sensor_in
from wrist_ft_comp.stored.safe_file import beginning, Kind, MAKE_ROOM, to_plain, writing

#: Length of a day, ns.
DAY_NS = 86_400 * NANOSECONDS
#: A longer silence ends a day, ns.
SILENCE_NS = 7200 * NANOSECONDS
#: A shorter day is not kept, and how large the folder is is measured once in this time, ns.
SHORTEST_NS = 600 * NANOSECONDS
#: Largest day, bytes: ten times what 24 h of cells of 1 s and a dozen thermometers take. A larger
#: file is no day.
LARGEST_BYTES = 200_000_000
#: Every header and every row is shorter than this, bytes.
_LONGEST_ROW_BYTES = 8192
DIARY = Kind(
    name='diary', says='wrist_ft_comp diary', version=2,
    max_bytes=20_000_000, error=RecordingError, made_by='A node that learns makes one.',
    renewed_by='Remove it',
    remedy=f'{MAKE_ROOM} until then nothing is learnt.')  # fmt: skip
MEMORY = Kind(
    name='learning state', says='wrist_ft_comp learning', version=2,
    max_bytes=1_000_000, error=StateFileError,
    made_by='A node that learns makes one.', renewed_by='Remove it',
    remedy=f'{MAKE_ROOM} until then a restart may forget an offered model.')  # fmt: skip

#: Key of the drift without any model, in ``DayEntry.left``.
NONE = 'none'
#: Key of what a new model leaves: a fit to the other days that it was learnt from.
CHALLENGER = 'challenger'

#: What happened on a day: nothing; what only that day cannot be learnt from; another tool, whose
#: drift is learnt all the same; or what changed the sensor, its zero, or its gain or mounting.
IncidentKind = Literal['', 'unreadable', 'contacts', 'thermometer', 'tool', 'zero', 'sensor']
#: Days of these kinds are learnt from.
LEARNT_FROM: tuple[IncidentKind, ...] = ('', 'tool')


class _DayWriter(CsvRecordingWriter):
    """Writes the file of a day: few digits, and no wrench waits for the disk."""

    stamp = 'stamp_s'
    waits = False

    def _cells(self, stamp_ns: int, values: Sequence[float]) -> tuple[object, ...]:
        seconds, rest = divmod(stamp_ns, NANOSECONDS)
        stamp = f'{seconds}.{rest:09d}'.rstrip('0').rstrip('.')
        # NaN is written as nothing.
        short = ['' if isnan(v) else f'{v:.5g}' if abs(v) < 100 else f'{v:.3f}' for v in values]
        return (stamp, *short)


class Span(NamedTuple):
    """The beginning and the end of a day's file."""

    header: str
    #: First and last stamp, ns.
    first_ns: int
    last_ns: int
    #: Bytes up to the end of the last whole row.
    size: int


def span_of(path: Path) -> Span | None:
    """Read the beginning and the end of a file; None where there is no whole row in it."""
    with path.open('rb') as file:
        head = file.read(_LONGEST_ROW_BYTES).split(b'\n')
        start = max(file.seek(0, os.SEEK_END) - _LONGEST_ROW_BYTES, 0)
        file.seek(start)
        tail = file.read()
    whole = tail[: tail.rfind(b'\n') + 1]
    rows = whole.split(b'\n')
    try:
        stamps = (Decimal(row.split(b',')[0].decode()) for row in (head[1], rows[-2]))
        first, last = (round(stamp * NANOSECONDS) for stamp in stamps)
        return Span(head[0].decode(), first, last, start + len(whole))
    except (ArithmeticError, IndexError, ValueError):
        return None


def go_on(kind: Any, path: Path, span: Span, channels: Sequence[str], sensor: SensorNames) -> Any:
    """Make a writer that goes on after the last whole row; None: other columns, or sensor."""
    stamp, *columns = span.header.split(',')
    other_sensor = differences({'before': sensor_in(columns), 'now': sensor})
    if other_sensor or [stamp, *columns[:-1]] != [kind.stamp, *channels]:
        return None
    os.truncate(path, span.size)
    return kind(path, columns, go_on=True)


def day_number(name: str) -> int:
    """Read the number in the name of a day's file; 0 for other names."""
    found = re.fullmatch(r'day_(\d{5})\.csv', name)
    return int(found[1]) if found else 0


def day_files(directory: Path) -> list[Path]:
    """List the days in a node's folder, oldest first, readable or not."""
    return sorted(p for p in (directory / 'days').glob('day_*.csv') if day_number(p.name))


def size_of(path: Path) -> int:
    """Size of a file in a node's folder, bytes; 0 where it is missing or too large for a day."""
    with suppress(OSError):
        size = path.stat().st_size if path.is_file() else 0
        return size if size <= LARGEST_BYTES else 0
    return 0


def goes_on(path: Path, day: Path) -> bool:
    """Tell whether a day begins where the one at ``path`` was ended by its length alone."""
    first, last = (span_of(file) if size_of(file) else None for file in (path, day))
    return bool(first and last and 0 < last.first_ns - first.last_ns <= SILENCE_NS)


class DayFiles:
    """
    Writes rows into the file of their day, below a node's directory, without reference channels.

    RecordingError when the disk refuses, or when all days together take ``max_bytes``. The name of
    the day ``newest_before``, the newest one that there ever was, and older names are not used
    again. ``sensor`` gives the names of the sensor.
    """

    def __init__(
        self,
        directory: Path,
        channels: Sequence[str],
        max_bytes: float,
        newest_before: str = '',
        sensor: Callable[[], SensorNames] = dict,
    ) -> None:
        self._directory, self._folder = directory, directory / 'days'
        self._columns = [j for j, name in enumerate(channels) if name not in REFERENCE_CHANNELS]
        self._channels = [channels[j] for j in self._columns]
        self._wrench = [j for j, name in enumerate(channels) if name in AXES]
        self._max_bytes, self._sensor = max_bytes, sensor
        files = day_files(directory)
        self._number = max(map(day_number, [newest_before, *(file.name for file in files)]))
        #: File of the day that goes on; None between days.
        self.path = next((f for f in files[-1:] if f.name > newest_before and size_of(f)), None)
        #: Whether the newest row found no room.
        self.full = False
        self._writer: _DayWriter | None = None
        #: First and last stamp of the day, and that of the last measurement, ns.
        self._first_ns = self._last_ns = 0
        self._measured_ns = -SHORTEST_NS
        #: Whether the newest row was not later than the one before it.
        self._ran_back = False

    def ended(self) -> list[Path]:
        """List the days that have ended, oldest first."""
        return [path for path in day_files(self._directory) if path != self.path]

    def used(self) -> int:
        """Size of all files, bytes."""
        return sum(map(size_of, self._folder.glob('*')))

    def append(self, stamp_ns: int, values: Sequence[float]) -> None:
        """Write a row into the day it belongs to."""
        if self.full or abs(stamp_ns - self._measured_ns) >= SHORTEST_NS:
            self.full = self.used() > self._max_bytes
            if self.full:
                raise RecordingError(
                    f'{self._folder} holds as much as learning.max_mb allows '
                    f'({self._max_bytes / 1e6:.0f} MB).'
                )
            self._measured_ns = stamp_ns
        if self._writer is None and self.path and self.path.is_file():
            # The day of before a restart or a full disk goes on after its last whole row.
            with writing(self._folder):
                if span := span_of(self.path):
                    channels, sensor = self._channels, self._sensor()
                    self._writer = go_on(_DayWriter, self.path, span, channels, sensor)
                    self._first_ns, self._last_ns = span.first_ns, span.last_ns
        writer, since_ns = self._writer, stamp_ns - self._last_ns
        ran_back, self._ran_back = self._ran_back, bool(writer) and since_ns <= 0
        late = all(isnan(values[j]) for j in self._wrench)  # temperatures from before a silence
        if self._ran_back and (late or not ran_back):
            return  # one stray row ends no day; time did run back where the next row says so, too
        if not writer or not 0 < since_ns <= SILENCE_NS or stamp_ns - self._first_ns >= DAY_NS:
            self.leave()
            with writing(self._folder):
                self._folder.mkdir(parents=True, exist_ok=True)
            self._number += 1
            self.path, self._first_ns = self._folder / f'day_{self._number:05d}.csv', stamp_ns
            columns = *self._channels, origin_column(self._sensor())
            writer = self._writer = _DayWriter(self.path, columns)
        writer.append(stamp_ns, [values[j] for j in self._columns])
        self._last_ns = stamp_ns

    def leave(self) -> None:
        """End the day; remove its file where it is too short and has this writer's columns."""
        self.close()
        path, self.path = self.path, None
        if path is None or not path.is_file():
            return
        with writing(path):
            header = ','.join((_DayWriter.stamp, *self._channels))
            if not header.startswith(beginning(path)[: len(header)]):
                return
            span, size = span_of(path), path.stat().st_size
            # A damaged last stamp makes no day short.
            lasted_ns = abs(span.last_ns - span.first_ns) if span else 0
            if lasted_ns < SHORTEST_NS if span else size < _LONGEST_ROW_BYTES:
                path.unlink()
                self._number -= 1

    def close(self) -> None:
        """Close the file; the day goes on with the next row."""
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()


@dataclass(frozen=True)
class DayEntry:
    """What is kept of a day at work, also after its recording was deleted."""

    #: Name of its file.
    name: str
    #: Stamp of its first cell, ns.
    first_ns: int = 0
    #: Duration of all its cells.
    hours: float = 0.0
    #: Lowest and highest temperature of every thermometer, °C.
    temperature_c: tuple[tuple[float, float], ...] = ()
    #: Coarse temperatures of the day, of the first thermometer and of the others relative to it:
    #: rare ones make it worth keeping.
    known: tuple[tuple[int, ...], ...] = ()
    #: RMS of the drift that a model left, tared in the first minute, N and N m, axis order AXES;
    #: NaN on axes without a figure. Keys are the first twelve digits of a model's SHA-256, NONE
    #: and CHALLENGER.
    left: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    #: Key of the live model in ``left``; empty when none was live.
    live: str = ''
    #: Why there is a new model, or none, in a sentence or two.
    verdict: str = ''
    #: What happened to the sensor, with size and time; empty when nothing did.
    incident: str = ''
    kind: IncidentKind = ''
    #: Whether a model was learnt.
    challenged: bool = False
    #: File of the better model that was found after this day; empty where none was.
    better: str = ''
    #: Mass, kg, and centre of mass, m, of every payload.
    payloads: tuple[tuple[float, ...], ...] = ()
    #: Rotation from the specific force's frame to the wrench's, row by row; empty where unknown.
    rotation: tuple[float, ...] = ()
    #: Standard deviation of a cell, N and N m, axis order AXES; empty where unknown.
    noise: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        axes = len(AXES)
        sizes = {len(left) - axes for left in self.left.values()} | {len(self.noise) % axes}
        sizes |= {len(payload) - 4 for payload in self.payloads} | {len(self.rotation) % 9}
        if sizes - {0}:
            raise RecordingError(f'The entry of {self.name} has too few or too many figures.')

    def rms_left(self, model: str) -> float:
        """Compute the RMS that a model left of a force's drift, N, or NaN."""
        values = np.array(self.left.get(model, ())[: AXES.index('torque_x')])
        present = values[np.abs(values) < LARGEST]
        return float(np.sqrt(np.mean(present**2))) if len(present) else np.nan


@dataclass(frozen=True)
class Diary:
    """All days, oldest first, also those whose recordings were deleted."""

    days: tuple[DayEntry, ...] = ()
    #: Models that were live, newest last: from active.json, and not in the diary's own file.
    history: tuple[HistoryEntry, ...] = ()
    #: Why learning has stopped on its own; empty when it has not.
    paused: str = ''
    #: Why its file cannot be read; empty where it can, or where there is none.
    problem: str = ''


def diary_path(directory: Path) -> Path:
    """Path of the diary in a node's folder."""
    return directory / 'days' / 'diary.json'


def load_diary(directory: Path) -> Diary:
    """Read a diary; an empty one where none can be read."""
    try:
        return DIARY.load(Diary, diary_path(directory)) or Diary()
    except (RecordingError, OSError) as error:
        return Diary(problem=str(error))


def save_diary(directory: Path, diary: Diary) -> None:
    """Write a diary in one step; one that cannot be read is kept beside it, once."""
    content = {'days': to_plain(diary.days), 'paused': diary.paused}
    DIARY.save(diary_path(directory), content, record=Diary)


def survey(directory: Path) -> Diary:
    """Read a folder's diary, and add changes of the live model; RecordingError without days."""
    diary = load_diary(directory)
    if not diary.days:
        raise RecordingError(
            diary.problem
            or f'{directory} holds no days that were judged. A node with the parameter '
            'learning.mode set to propose or auto judges each day after its end.'
        )
    with suppress(ModelFileError):  # the days can be shown without it
        return replace(diary, history=tuple(NodeFolder(directory).history()))
    return diary


@dataclass(frozen=True)
class Memory:
    """What the newest job said, and which model is offered; days are empty without one."""

    #: SHA-256 of the live model that all this is about; None when none was live.
    champion: str | None = None
    #: Newest day that a job has judged, or that a person's decision ended.
    judged: str = ''
    #: The verdict on that day.
    verdict: str = ''
    #: What happened to the sensor on that day.
    incident: str = ''
    #: Why learning has stopped by itself; empty when it has not.
    paused: str = ''
    #: File of the offered model below models/; empty where none is offered.
    offered: str = ''
    #: SHA-256 of the offered model.
    sha256: str = ''
    #: Why it is better.
    why: str = ''


def load_memory(directory: Path) -> Memory | None:
    """Read a memory; None where there is none."""
    return MEMORY.load(Memory, directory / 'learning.json')


def save_memory(directory: Path, memory: Memory) -> None:
    """Write a memory in one step; one that cannot be read is kept beside it, once."""
    MEMORY.save(directory / 'learning.json', asdict(memory), record=Memory)


def last_change(history: Sequence[HistoryEntry]) -> str:
    """Say when and why the live model changed last; empty where it never did."""
    return f'{history[-1].since[:10]}: {history[-1].why}' if history and history[-1].since else ''


def good_days(entries: Sequence[DayEntry]) -> list[DayEntry]:
    """Choose days without an incident that have as many thermometers as the newest."""
    good = [entry for entry in entries if entry.kind in LEARNT_FROM]
    return [day for day in good if len(day.temperature_c) == len(good[-1].temperature_c)]


def worthiest(entries: Sequence[DayEntry], most: int) -> list[DayEntry]:
    """Choose at most ``most`` days, in order: the newer half, and those with rare temperatures."""
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


def prune(directory: Path, diary: Diary, max_mb: float) -> None:
    """Remove the least worthy recordings until the rest fits; RecordingError where one stays."""
    paths = {path.name: path for path in day_files(directory)}
    kept = [entry for entry in diary.days if entry.name in paths]
    while kept and sum(size_of(paths[entry.name]) for entry in kept) > 1e6 * max_mb:
        before, kept = kept, worthiest(kept, len(kept) - 1) if len(kept) > 1 else []
        (name,) = {entry.name for entry in before} - {entry.name for entry in kept}
        with writing(paths[name]):
            paths[name].unlink(missing_ok=True)
