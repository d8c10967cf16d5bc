"""The node's own recorder: CSV, row by row, each row handed to the operating system at once."""

from collections.abc import Sequence
from contextlib import suppress
from math import isnan
import os
from pathlib import Path
from types import TracebackType

from wrist_ft_comp import RecordingError


class CsvRecordingWriter:
    """
    Writes a new CSV recording row by row; what was appended survives the end of the process.

    Parameters
    ----------
    path : Path
        The file to make; it must not exist yet.
    channels : sequence of str
        Column names behind ``stamp_ns``.

    """

    def __init__(self, path: Path, channels: Sequence[str]) -> None:
        self._path = path
        self._width = len(channels)
        try:
            self._file = path.open('xb')
        except FileExistsError as error:
            raise RecordingError(f'{path} exists already; name a new file.') from error
        except OSError as error:
            raise RecordingError(f'{path} cannot be written: {error.strerror}.') from error
        try:
            self._write(','.join(('stamp_ns', *channels)))
        except RecordingError:
            with suppress(OSError):
                self._file.close()
            raise

    def append(self, stamp_ns: int, values: Sequence[float]) -> None:
        """
        Write one row and hand it to the operating system.

        Parameters
        ----------
        stamp_ns : int
            Time of measurement, ns.
        values : sequence of float, length C
            In the order of the channels; NaN, no sample, becomes an empty cell.

        Raises
        ------
        RecordingError
            When the number of values is wrong, or the disk is full.

        """
        if len(values) != self._width:
            raise RecordingError(
                f'A row of {self._path.name} has {self._width} values; got {len(values)}.'
            )
        cells = ('' if isnan(value) else repr(float(value)) for value in values)
        self._write(','.join((str(int(stamp_ns)), *cells)))

    def _write(self, row: str) -> None:
        """Write a line through to the operating system."""
        try:
            self._file.write(f'{row}\n'.encode())
            self._file.flush()
        except OSError as error:
            raise RecordingError(f'{self._path} cannot be written: {error.strerror}.') from error

    def sync(self) -> None:
        """Wait until the disk holds everything, so that a power failure takes nothing of it."""
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            raise RecordingError(f'{self._path} cannot be written: {error.strerror}.') from error

    def close(self) -> None:
        """Sync and close; a second call does nothing."""
        if not self._file.closed:
            try:
                self.sync()
            finally:
                self._close()

    def _close(self) -> None:
        """Close the file; what it could not write by then is an error of ours."""
        try:
            self._file.close()
        except OSError as error:
            raise RecordingError(f'{self._path} cannot be written: {error.strerror}.') from error

    def __enter__(self) -> 'CsvRecordingWriter':
        """Return the writer itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close."""
        self.close()
