"""What a path is, and the recording behind it opened: a bag, or a table."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import re
import shlex

from wrist_ft_comp.channels import SensorNames
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recording import Samples, Topics
from wrist_ft_comp.recordings.bag import Bag, SUFFIXES
from wrist_ft_comp.recordings.bag_opening import open_bag
from wrist_ft_comp.recordings.bag_recording import read_bag, sensor_of
from wrist_ft_comp.recordings.column_map import ColumnMap, COMPENSATED, KINDS, samples_of
from wrist_ft_comp.recordings.csv_writer import sensor_in
from wrist_ft_comp.recordings.log_proposal import refuse_missing, warn_of_unused
from wrist_ft_comp.recordings.read_options import options_beside, parse_options, ReadOptions
from wrist_ft_comp.recordings.table import Rows, Table
from wrist_ft_comp.series import Progress
from wrist_ft_comp.wire.temperature_source import parse_sources, TemperatureSource

#: Turns a table of a chamber test into a recording.
_CONVERTER = 'examples/paper/chamber_table.py'
BAG, TABLE = 'rosbag2', 'table'


def kind_of(path: Path) -> str:
    """Find the kind of a recording from its name; a table if in doubt."""
    if not path.exists():
        raise RecordingError(
            f'{path} does not exist; expected a bag folder, an .mcap, .db3 or CSV file.'
        )
    if path.is_char_device() or path.is_block_device():
        raise RecordingError(
            f'{path} is a device, which may never end; expected a file or a folder. Write what '
            'it gives into a file first.'
        )
    if path.is_dir() or path.suffix in SUFFIXES:
        return BAG
    if path.suffix in {'.bag', '.zstd', '.zst'}:
        raise RecordingError(
            f'{path.name} cannot be read alone. Of a compressed bag, name the folder; convert a '
            "ROS 1 bag with 'rosbags-convert'."
        )
    return TABLE


class OpenBag:
    """A bag, and which of its topics are read."""

    def __init__(self, bag: Bag, options: ReadOptions) -> None:
        self.bag, self.name, self.options = bag, bag.name, options
        self.sources: tuple[TemperatureSource, ...] = parse_sources(options.topics.temperatures)

    def samples(self, progress: Progress | None = None) -> Iterator[Samples]:
        """Read by batch."""
        return read_bag(self.bag, self.options.topics, progress)

    @property
    def sensor(self) -> SensorNames:
        """What the sensor is called: by topics, and the frame of the first wrench."""
        return sensor_of(self.bag, self.options.topics)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was lost."""
        return self.bag.warnings


class OpenTable:
    """A table, and which of its columns are read."""

    def __init__(self, table: Table, options: ReadOptions) -> None:
        self.table, self.name, self.options = table, table.name, options
        self.sources = ()
        header = ' '.join(table.names)
        if re.search(r'\bload_\w+', header) and re.search(r'\boutput_at_\S+_c\b', header):
            words = 'python', _CONVERTER, str(table.path), '-o', f'{table.path.stem}_recording.csv'
            raise RecordingError(
                f'{table.name} is a table of a chamber test, which has no times. Make a recording '
                f'of it: {shlex.join(words)}'
            )
        self.columns = ColumnMap().place(table.name, table.names, table.units)
        # A map beside a recording of our own, such as a compensated copy, is of others.
        if options.columns.source == '--columns' or self.columns.lacks(list(KINDS)):
            self.columns = options.columns.place(table.name, table.names, table.units)
        #: What the sensor is called: by the name of a column.
        self.sensor = sensor_in(table.names)
        #: Says that drift was removed from it; empty where it was not.
        self.compensated = ''
        if any(name.startswith(COMPENSATED) for name in table.names):
            self.compensated = f'{table.name} was compensated already. Name the raw recording.'

    def require(self, *kinds: str) -> None:
        """Refuse a table without columns of some kinds, all by default, and propose a map."""
        if lacking := self.columns.lacks(kinds or tuple(KINDS)):
            refuse_missing(self.columns, lacking, self.table.shown_rows())

    def rows(self, progress: Progress | None = None) -> Iterator[Rows]:
        """Read all rows of the columns that are used."""
        self.require('stamp')
        return self.table.rows(self.columns, progress)

    def samples(self, progress: Progress | None = None) -> Iterator[Samples]:
        """Read by block; a group that some rows fill in part comes channel by channel."""
        for rows in self.rows(progress):
            yield from samples_of(rows.stamps_ns, rows.values)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is not used, and was left out; complete when the samples were read."""
        done, columns = filter(None, [self.compensated]), self.columns
        return *done, *columns.warnings, *warn_of_unused(columns), *self.table.warnings


@contextmanager
def open_recording(path: Path, topics: Topics) -> Iterator[OpenBag | OpenTable]:
    """Open a recording of any kind for as long as the context lasts."""
    if kind_of(path) == BAG:
        with open_bag(path) as bag:
            yield OpenBag(bag, parse_options(topics))
    else:
        yield OpenTable(Table(path), options_beside(path, topics))
