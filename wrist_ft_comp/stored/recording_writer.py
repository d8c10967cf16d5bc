"""A recording of our own, written row by row: what the node records survives a crash."""

from collections.abc import Sequence
from contextlib import suppress
import csv
import errno
from math import isnan, nan
import os
from pathlib import Path
from urllib.parse import parse_qs, urlencode

from wrist_ft_comp.channels import SensorNames
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.stored.safe_file import writing

#: Beginning of the name of an empty column, followed by the names of the sensor.
ORIGIN = 'recorded_from?'


def origin_column(sensor: SensorNames) -> str:
    """Name the column that says what the sensor is called."""
    return ORIGIN + urlencode(sensor, doseq=True, safe='/:[]')


def sensor_in(columns: Sequence[str]) -> SensorNames:
    """Read what the sensor is called from the names of columns."""
    return parse_qs(''.join(c.removeprefix(ORIGIN) for c in columns if c.startswith(ORIGIN)))


class CsvRecordingWriter:
    """Writes a CSV recording of channels, which survives a crash; RecordingError if it cannot."""

    #: Column of the stamps.
    stamp = 'stamp_ns'
    #: Whether closing waits for the disk, so that a power failure takes nothing.
    waits = True

    def __init__(self, path: Path, channels: Sequence[str], *, go_on: bool = False) -> None:
        self._path, self._width = path, len(channels)
        with writing(self._path):
            self._file = path.open('a' if go_on else 'x', encoding='utf-8', newline='')
        self._rows = csv.writer(self._file, lineterminator='\n')
        if go_on:
            return
        try:
            self._write((self.stamp, *channels))
        except RecordingError:
            with suppress(OSError):
                self._file.close()
            raise

    def append(self, stamp_ns: int, values: Sequence[float]) -> None:
        """Write a row, ns and a value per channel, to the operating system; NaN is no sample."""
        self._write(self._cells(stamp_ns, [*values, *[nan] * (self._width - len(values))]))

    def _cells(self, stamp_ns: int, values: Sequence[float]) -> tuple[object, ...]:
        return (int(stamp_ns), *('' if isnan(value) else float(value) for value in values))

    def close(self) -> None:
        """Close, on the disk where it ``waits``; a second call does nothing."""
        if not self._file.closed:
            with writing(self._path), self._file:
                if self.waits:
                    os.fsync(self._file.fileno())
                    self._require_name()

    def _write(self, row: Sequence[object]) -> None:
        """Write a row through to the operating system."""
        with writing(self._path):
            self._rows.writerow(row)
            self._file.flush()
            self._require_name()

    def _require_name(self) -> None:
        """Refuse to go on with a file that was deleted; nobody would find what is written."""
        if not os.fstat(self._file.fileno()).st_nlink:
            raise FileNotFoundError(errno.ENOENT, 'it was deleted in the meantime')
