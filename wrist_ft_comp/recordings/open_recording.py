"""What a path is, and the recording behind it opened: a bag, by whatever reads it, or a table."""

from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
from importlib import import_module
from pathlib import Path
import re
import shlex
from types import ModuleType

from wrist_ft_comp.channels import SensorNames
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recording import Samples, Topics
from wrist_ft_comp.recordings.bag import Bag, SUFFIXES, translated
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


def backend() -> ModuleType:
    """Choose the backend: rosbags where it can be imported, else rosbag2_py."""
    try:
        return import_module('wrist_ft_comp.recordings.rosbags_backend')
    except ImportError as no_rosbags:
        try:
            return import_module('wrist_ft_comp.recordings.rosbag2_backend')
        except ImportError as no_rosbag2:
            raise RecordingError(
                f'A bag needs rosbags ({no_rosbags}) or rosbag2_py ({no_rosbag2}), and neither '
                "can be imported. Run 'pip install rosbags', or install ros-jazzy-rosbag2-py and "
                'source ROS 2.'
            ) from no_rosbag2


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """
    Open a bag for reading, also a cut off one, for as long as the context lasts.

    A folder without ``metadata.yaml``, as a killed recorder leaves it, is read when it holds one
    storage file. Of a cut-off ``.mcap``, rosbags reads everything up to its last complete chunk.
    """
    # The backend gets the folder, or a storage file.
    chosen = path
    if path.is_dir() and not (path / 'metadata.yaml').exists():
        files = sorted(file for file in path.iterdir() if file.suffix in SUFFIXES)
        if len(files) > 1:
            raise RecordingError(
                f'{path} holds {len(files)} storage files and no metadata.yaml. Run '
                f"'ros2 bag reindex {path}', or name one of the files."
            )
        if not files:
            raise RecordingError(
                f'{path} is no bag: expected a folder with metadata.yaml or one .mcap or .db3 '
                'file. Name the folder that ros2 bag record made.'
            )
        chosen = files[0]
    if chosen.is_file() and not chosen.stat().st_size:
        raise RecordingError(f'{chosen} is empty (0 bytes); nothing was recorded. Record again.')
    journals = chosen.glob('*.db3-wal') if chosen.is_dir() else [Path(f'{chosen}-wal')]
    for journal in journals:
        if journal.exists() and journal.stat().st_size:
            database = str(journal).removesuffix('-wal')
            raise RecordingError(
                f'{journal} holds messages which are not in the bag yet: its recorder is running '
                f"or was killed. Stop it, then run: sqlite3 {database} 'PRAGMA wal_checkpoint'"
            )
    with ExitStack() as stack:
        with translated(path.name):
            bag = backend().open_bag(path.name, chosen, stack)
        yield bag


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
