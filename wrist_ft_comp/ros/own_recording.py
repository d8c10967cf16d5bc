"""The node's own recording: one row per thermal cell, on disk as it comes."""

from pathlib import Path

from wrist_ft_comp.core.reduction import StreamReducer, row_channels
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
            When the disk refuses.

        """
        try:
            self.write(final=True)
        finally:
            self._writer.close()
