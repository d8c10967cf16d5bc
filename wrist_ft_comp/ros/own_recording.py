"""The node's own recording: one row per thermal cell, on disk as it comes."""

from contextlib import suppress
from pathlib import Path

from wrist_ft_comp import RecordingError
from wrist_ft_comp.core.reduction import row_channels, StreamReducer
from wrist_ft_comp.files.csv_writer import CsvRecordingWriter


class OwnRecording:
    """
    A recording in progress.

    Parameters
    ----------
    path : Path
        A new CSV file.
    period_ns : int
        Cell length h, ns.
    thermometers : int
        Number of thermometers J.

    Raises
    ------
    RecordingError
        When the file cannot be made.

    """

    def __init__(self, path: Path, period_ns: int, thermometers: int) -> None:
        self.path = path
        self.period_ns = period_ns
        self.rows = 0
        self.reducer = StreamReducer(period_ns, thermometers)
        self._writer = CsvRecordingWriter(path, row_channels(thermometers))

    def write(self, *, final: bool = False) -> None:
        """
        Append the rows that are complete.

        Parameters
        ----------
        final : bool
            Whether nothing more will come.

        Raises
        ------
        RecordingError
            When the disk refuses.

        """
        for stamp_ns, values in self.reducer.rows(final=final):
            self._writer.append(stamp_ns, values)
            self.rows += 1

    def close(self) -> None:
        """
        Write what is left, and close.

        Raises
        ------
        RecordingError
            When the disk refuses; the file is closed nevertheless.

        """
        try:
            self.write(final=True)
        except RecordingError:
            self.abandon()
            raise
        try:
            self._writer.close()
        except OSError as error:
            raise RecordingError(f'{self.path} cannot be written: {error.strerror}.') from error

    def abandon(self) -> None:
        """Close after the disk refused: what it took stays, the rest is lost."""
        with suppress(RecordingError, OSError):
            self._writer.close()
