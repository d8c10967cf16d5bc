"""Days being written, ``days/day_00001.csv`` …, ended by stamps alone (docs/learning.md)."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from math import isnan
import os
from pathlib import Path
import re
from typing import NamedTuple

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.files.csv_file import CsvRecordingWriter, nanoseconds, origin_column, sensor_in
from wrist_ft_comp.files.documents import beginning, writing
from wrist_ft_comp.model.drift_model import differences
from wrist_ft_comp.model.signals import AXES, NANOSECONDS, REFERENCE_CHANNELS, SensorNames

#: Length of a day, silence that ends one, and what is too short to be one, ns.
DAY_NS, SILENCE_NS, SHORTEST_NS = 86_400 * NANOSECONDS, 7200 * NANOSECONDS, 600 * NANOSECONDS
#: So many rows are written before the folder is measured again; they take less than the margin.
_ROWS, _MARGIN = 600, 200_000
#: A header and a row are shorter.
_PIECE = 8192


class DayWriter(CsvRecordingWriter):
    """Writes the file of a day."""

    stamp = 'stamp_s'

    def _cells(self, stamp_ns: int, values: Sequence[float]) -> tuple[object, ...]:
        """Lay out a row with short numbers."""
        seconds, rest = divmod(stamp_ns, NANOSECONDS)
        return (f'{seconds}.{rest:09d}'.rstrip('0').rstrip('.'), *map(_short, values))

    def sync(self) -> None:
        """Leave it to the operating system: no wrench waits for a disk."""


def _short(value: float) -> str:
    """Write a number."""
    if isnan(value):
        return ''
    return f'{value:.5g}' if abs(value) < 100.0 else f'{value:.3f}'


class Span(NamedTuple):
    """What a day's file holds: its header, its first and last stamp, ns, and its whole rows."""

    header: str
    first_ns: int
    last_ns: int
    size: int


def span_of(path: Path) -> Span | None:
    """Look at the beginning and the end of a file; None where there is no whole row in it."""
    with path.open('rb') as file:
        head = file.read(_PIECE).split(b'\n')
        start = max(file.seek(0, os.SEEK_END) - _PIECE, 0)
        file.seek(start)
        tail = file.read()
    whole = tail[: tail.rfind(b'\n') + 1]
    rows = whole.split(b'\n')
    try:
        first, last = (nanoseconds(row.split(b',')[0].decode()) for row in (head[1], rows[-2]))
        return Span(head[0].decode(), first, last, start + len(whole))
    except (ArithmeticError, IndexError, ValueError):
        return None


class DayFiles:
    """What rows of the diary are written to; RecordingError when it can take no more."""

    # Below a node's directory; of the rows' channels those of a reference are left out, and no
    # more is written when all days take max_bytes. ``known`` is the newest day that was known
    # before: its name and older ones are not given again.

    def __init__(
        self, directory: Path, channels: Sequence[str], max_bytes: float, known: str = ''
    ) -> None:
        self._folder = directory / 'days'
        self._columns = [j for j, each in enumerate(channels) if each not in REFERENCE_CHANNELS]
        self._channels = [channels[j] for j in self._columns]
        self._wrench = [j for j, each in enumerate(channels) if each in AXES]
        self._max_bytes = max_bytes
        #: Tells what the sensor is called.
        self.sensor: Callable[[], SensorNames] = dict
        days = self._all()
        self._number = max(map(_number, [known, *(each.name for each in days)]))
        #: The day that goes on, if one does.
        self.path = days[-1] if days and days[-1].name > known else None
        self._writer: DayWriter | None = None
        self._first_ns = self._last_ns = self._rows = 0

    def _all(self) -> list[Path]:
        """List all days, oldest first."""
        return sorted(each for each in self._folder.glob('day_*.csv') if _number(each.name))

    def ended(self) -> list[Path]:
        """List the days that have ended, oldest first."""
        return [each for each in self._all() if each != self.path]

    def used(self) -> int:
        """Tell what is used of the disk, bytes; what just went is none."""
        total = 0
        for each in self._folder.glob('*'):
            with suppress(OSError):
                total += each.stat().st_size
        return total

    def append(self, stamp_ns: int, values: Sequence[float]) -> None:
        """Write a row into the day it belongs to."""
        if self._rows % _ROWS == 0 and self.used() > self._max_bytes - _MARGIN:
            raise RecordingError(
                f'{self._folder} holds as much as learning.max_mb allows '
                f'({self._max_bytes / 1e6:.0f} MB).'
            )
        writer, since = self._writer or self._resumed(), stamp_ns - self._last_ns
        if writer and since <= 0 and all(isnan(values[j]) for j in self._wrench):
            return  # only temperatures, which come late after a silence
        if not writer or not 0 < since <= SILENCE_NS or stamp_ns - self._first_ns >= DAY_NS:
            self.leave()
            writer = self._begin(stamp_ns)
        writer.append(stamp_ns, [values[j] for j in self._columns])
        self._last_ns, self._rows = stamp_ns, self._rows + 1

    def _begin(self, stamp_ns: int) -> DayWriter:
        """Begin a day."""
        with writing(self._folder):
            self._folder.mkdir(parents=True, exist_ok=True)
        self._number += 1
        self.path = self._folder / f'day_{self._number:05d}.csv'
        self._first_ns = self._last_ns = stamp_ns
        columns = *self._channels, origin_column(self.sensor())
        self._writer = DayWriter(self.path, columns)
        return self._writer

    def _resumed(self) -> DayWriter | None:
        """Go on with the day from before a restart or a full disk, behind its last whole row."""
        path = self.path
        with writing(self._folder):
            span = span_of(path) if path and path.exists() else None
            columns = span.header.split(',') if span else []
            same = columns[:-1] == [DayWriter.stamp, *self._channels] and not differences(
                {'before': sensor_in(columns), 'now': self.sensor()}
            )
            if not path or not span or not same:
                return None
            os.truncate(path, span.size)
            self._first_ns, self._last_ns = span.first_ns, span.last_ns
            self._writer = DayWriter(path, columns[1:], go_on=True)
        return self._writer

    def leave(self) -> None:
        """End the day; one of a few minutes was none, if it was begun here."""
        self.close()
        path, self.path = self.path, None
        if path is None:
            return
        with writing(path):
            header = ','.join((DayWriter.stamp, *self._channels))
            own = header.startswith(beginning(path)[: len(header)])
            if not path.exists() or not own:
                return
            span, size = span_of(path), path.stat().st_size
            if span.last_ns - span.first_ns < SHORTEST_NS if span else size < _PIECE:
                path.unlink()
                self._number -= 1

    def close(self) -> None:
        """Close the file; the day goes on with the next row."""
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()


def _number(name: str) -> int:
    """Read the number of a day; 0 where there is none."""
    found = re.fullmatch(r'day_(\d+)\.csv', name)
    return int(found[1]) if found else 0
