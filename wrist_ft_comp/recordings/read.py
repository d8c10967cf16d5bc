"""What a path is, and the recording behind it opened: a bag, by whatever reads it, or a table."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, ExitStack
from dataclasses import replace
import hashlib
from importlib import import_module
from itertools import islice
import math
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from wrist_ft_comp.channels import AXES, SensorNames, temperature_channel
from wrist_ft_comp.drift.drift_model import DriftModel, order_problem
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recording import PERIODS_S, Recording, Samples, Topics
from wrist_ft_comp.recordings import column_map, column_proposal, read_options
from wrist_ft_comp.recordings.bag import Bag, read_bag, sensor_of, SUFFIXES, translated
from wrist_ft_comp.recordings.column_map import lacking_kinds, listed, place_columns, Placed
from wrist_ft_comp.recordings.column_proposal import Proposal, propose
from wrist_ft_comp.recordings.read_options import ReadOptions
from wrist_ft_comp.recordings.sample_checks import grid_samples
from wrist_ft_comp.recordings.table import Rows, samples_of, STAMP_NS, Table, TableInMemory
from wrist_ft_comp.series import FloatArray, NANOSECONDS, Progress
from wrist_ft_comp.stored.recording_writer import sensor_in
from wrist_ft_comp.stream.drift_of_recordings import correct_many, track_drift
from wrist_ft_comp.stream.tare import initial_tare
from wrist_ft_comp.units import STAMP, to_celsius

BAG, TABLE = 'rosbag2', 'table'
#: Rows of a table that are farther apart are those of a log in another unit, s.
LONGEST_SPACING_S = 86_400.0
#: Cells of slow logs in all: a million takes a gigabyte.
_MOST_SLOW_CELLS = 250_000
#: Readings of a thermometer without a unit that may be °C, and are as usual in °F.
MAYBE_F = 55.0, 120.0


def kind_of(path: Path) -> str:
    """Find the kind of a recording from its name; a table if in doubt."""
    if len(files_of(path)) > 1:
        return TABLE
    if not path.exists():
        raise RecordingError(
            f'{path} does not exist; expected a bag folder, an .mcap, .db3 or CSV file. To make '
            f'one, run "ros2 bag record -s mcap -o warm_up {Topics.wrench} '
            f'{Topics.temperatures[0]}" with the names of your driver\'s topics.'
        )
    if not path.is_file() and not path.is_dir():
        raise RecordingError(
            f'{path} is no file and no folder, and may never end. Write what it gives into a file.'
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
                f'A bag needs rosbags ({no_rosbags}) or rosbag2_py ({no_rosbag2}). Run '
                "'pip install rosbags', or install ros-jazzy-rosbag2-py and source ROS 2."
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
        files = sorted(f for f in path.iterdir() if f.suffix in {*SUFFIXES, '.zstd'})
        if len(files) > 1:
            raise RecordingError(
                f'{path} holds {len(files)} storage files and no metadata.yaml. Unpack any .zstd '
                f"by 'unzstd --rm' and run 'ros2 bag reindex {path}', or name the first one: the "
                'others begin on a warm robot.'
            )
        if not files:
            raise RecordingError(
                f'{path} is no bag: expected a folder with metadata.yaml, an .mcap or a .db3 file.'
            )
        chosen = files[0]
    if chosen.is_file() and not chosen.stat().st_size:
        raise RecordingError(f'{chosen} is empty (0 bytes); nothing was recorded. Record again.')
    for journal in chosen.glob('*.db3-wal') if chosen.is_dir() else [Path(f'{chosen}-wal')]:
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
        self.bag, self.name, self.options, self.warnings = bag, bag.name, options, bag.warnings

    @property
    def sensor(self) -> SensorNames:
        """What the sensor is called: by topics, and the frame of the first wrench."""
        return sensor_of(self.bag, self.options.topics)

    def samples(self, progress: Progress | None = None) -> Iterator[Samples]:
        """Read by batch."""
        return read_bag(self.bag, self.options.topics, progress)


class OpenTable:
    """A table, or several with one clock, and which of their columns are read."""

    def __init__(
        self, tables: Sequence[Table | TableInMemory], options: ReadOptions, name: str = ''
    ) -> None:
        self.tables, self.options = tables, options
        self.name = name or '+'.join(table.name for table in tables)
        self.names = names = [name for table in tables for name in table.header.names]
        self.columns: list[Placed] = []
        for table in tables:
            placed = place_columns((), '', table.name, table.header)
            # A map beside a recording of our own, such as a compensated copy, is of others.
            if lacking_kinds([placed.columns]) or options.source == '--columns':
                placed = place_columns(options.columns, options.time, table.name, table.header)
            self.columns.append(placed)
        for column in options.columns:
            if all(column in placed.missing for placed in self.columns):
                raise RecordingError(
                    f'{self.name} has no column {column.name!r}, which {options.source} names; it '
                    f'has {listed(names)}. Write it so, or its number, from 1 on. If the map is '
                    'of other tables, give this one its own by --columns.'
                )
        channels = Counter(column.channel for p in self.columns for column in p.channels)
        if twice := [channel for channel, count in channels.items() if count > 1]:
            raise RecordingError(f'{self.name} has {listed(twice)} in two tables; leave one out.')
        #: Once samples were read: whether all were, how many by channel, and the outermost stamps.
        self.is_read, self.counts = False, Counter[str]()
        self.span_ns: tuple[int, ...] = ()
        #: What the sensor is called: by the name of a column.
        self.sensor = sensor_in(names)
        #: Says that drift was removed from it; empty where it was not.
        is_raw = not any(name.startswith(column_map.COMPENSATED) for name in names)
        already = f'{self.name} was compensated already. Name the raw recording.'
        self.compensated = '' if is_raw else already

    def lacks(self) -> list[str]:
        """List the kinds of columns that it does not have."""
        return lacking_kinds([placed.columns for placed in self.columns])

    def propose(self) -> Proposal:
        """Propose what the columns are that are not understood."""
        found = list[tuple[dict[str, str], str]]()
        taken = [column.channel for placed in self.columns for column in placed.channels]
        for placed, table in zip(self.columns, self.tables, strict=True):
            # Thermometers of all tables are numbered together.
            hot = {c: column_map.Column('', c) for c in taken if c.startswith('temperature')}
            known = replace(placed, columns=hot | {**placed.columns})
            found.append(propose(known, table.shown_rows(), self.names))
            taken += found[-1][0]
        return Proposal.of(found, self.lacks())

    def require(self, *kinds: str) -> None:
        """Refuse a table without columns of some kinds, all by default, and propose a map."""
        if lacking := [kind for kind in self.lacks() if not kinds or kind in kinds]:
            raise RecordingError(self.propose().refusal(self.name, self.names, lacking))

    def rows(self, progress: Progress | None = None) -> Iterator[Rows]:
        """Read all rows of the columns that are used, one table after the other, as they begin."""
        self.require(STAMP)
        pairs = [*zip(self.tables, self.columns, strict=True)]
        if len(pairs) > 1:
            pairs.sort(key=lambda pair: next(pair[0].rows(pair[1]))[STAMP_NS].tolist()[:1])
        for table, placed in pairs:
            yield from table.rows(placed, progress)

    def samples(self, progress: Progress | None = None) -> Iterator[Samples]:
        """Read by block; a group that some rows fill in part comes channel by channel."""
        for rows in self.rows(progress):
            self.counts.update(dict.fromkeys(rows.drop(columns=STAMP_NS), 0))
            for block in samples_of(rows):
                self.counts.update(dict.fromkeys(block.channels, len(block.stamps_ns)))
                ends = *self.span_ns, *block.stamps_ns[:1].tolist(), *block.stamps_ns[-1:].tolist()
                self.span_ns = (min(ends), max(ends)) if ends else ()
                yield block
        self.is_read = True

    @property
    def slowness_s(self) -> tuple[float, float]:
        """How far samples of a slow log are apart, and how long it lasts, s; else 1 and 0."""
        self.require()
        spacings_s = [
            float(np.median(np.diff(stamps_ns))) / NANOSECONDS
            for table, placed in zip(self.tables, self.columns, strict=True)
            for rows in islice(table.rows(placed), 1)
            for block in samples_of(rows)
            if len(stamps_ns := np.unique(block.stamps_ns)) > 1
        ]
        spacing_s = min((s for s in spacings_s if s <= LONGEST_SPACING_S), default=1.0)
        if spacing_s <= 1.0:
            return 1.0, 0.0
        ends = [rows[STAMP_NS].iloc[[0, -1]] for rows in self.rows()]
        return spacing_s, float(np.ptp(ends)) / NANOSECONDS

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is not used, and was left out; complete when the samples were read."""
        found = [self.compensated] if self.compensated else []
        for table, placed in zip(self.tables, self.columns, strict=True):
            unused = column_proposal.warn_of_unused(placed)
            clocks = column_proposal.warn_of_clocks(placed, table)
            found += [*placed.warnings, *unused, *clocks, *table.warnings]
        return tuple(found)


def files_of(path: Path) -> list[Path]:
    """Find the files that a path names: ``force.csv+heat.csv`` are two with one clock."""
    if path.exists():
        return [path]
    first, *others = map(Path, str(path).split('+'))
    # Beside the first one, where only their names are given.
    files = [first, *(f if f.exists() else first.parent / f.name for f in others)]
    return files if all(file.is_file() for file in files) else [path]


@contextmanager
def open_recording(path: Path, topics: Topics) -> Iterator[OpenBag | OpenTable]:
    """Open a recording of any kind for as long as the context lasts."""
    if kind_of(path) == BAG:
        with open_bag(path) as bag:
            yield OpenBag(bag, read_options.parse_options(topics))
    else:
        files = files_of(path)
        options, tables = read_options.options_beside(files[0], topics), list[Table]()
        for file in files:
            tables.append(Table(file, sum(len(table.header.names) for table in tables)))
        yield OpenTable(tables, options)


def read_recording(
    path: Path | str,
    *,
    period_s: float = 1.0,
    topics: Topics | None = None,
    max_bad_share: float = 0.01,
    progress: Progress | None = None,
) -> Recording:
    """
    Read a recording of any kind onto thermal cells of ``period_s``.

    Memory grows with the number of cells only. Topics of a bag are the node's own names by
    default. The recording's warnings say what was left out. RecordingError when it cannot be read,
    when more than ``max_bad_share`` of a channel cannot be used, when a channel is missing, or
    when it was compensated already.
    """
    with open_recording(Path(path), topics or Topics()) as source:
        if isinstance(source, OpenTable) and source.compensated:
            raise RecordingError(source.compensated)
        return read_opened(source, period_s, max_bad_share, progress)


def read_opened(
    source: OpenBag | OpenTable,
    period_s: float,
    max_bad_share: float = 0.01,
    progress: Progress | None = None,
) -> Recording:
    """Read what was opened, as read_recording does."""
    if isinstance(source, OpenTable):
        source.require()
    first_ns: list[int] = []
    recording = grid_samples(
        source.options.select(source.samples(progress), source.name, first_ns),
        name=source.name, period_s=period_s, max_bad_share=max_bad_share,
        of_bag=isinstance(source, OpenBag))  # fmt: skip
    sensor, said = source.sensor, {'temperature_topics': source.options.topics.temperatures}
    if problem := order_problem(said, sensor):
        raise RecordingError(f'{source.name} has its thermometers in another order: {problem}')
    warnings = *source.warnings, *_doubt_celsius(source, recording), *recording.warnings
    return replace(recording, warnings=warnings, sensor=sensor, origin_ns=first_ns[0])


def _doubt_celsius(source: OpenBag | OpenTable, recording: Recording) -> Iterator[str]:
    """Doubt readings in °C, if nobody said so, that are usual ones in °F."""
    medians = enumerate(np.nanmedian(recording.temperature_c, axis=0).tolist())
    read_c = {temperature_channel(k): median_c for k, median_c in medians}
    for placed in source.columns if isinstance(source, OpenTable) else ():
        for column in placed.channels:
            value = read_c.get(column.channel, 0.0)
            if column.unit or column.factor or not MAYBE_F[0] < value < MAYBE_F[1]:
                continue
            yield (
                f'{column.name} of {placed.table} says no unit and is read in °C: half of it is '
                f'above {value:.1f} °C. In °F that would be {to_celsius(value, "F"):.1f} °C. Put '
                f"the unit behind it: '{column.channel}={column.name}:F', or :C."
            )


def period_of(paths: Iterable[Path], topics: Topics, *, filled: bool = False) -> float:
    """Choose the length of thermal cells for recordings, s; where ``filled``, each holds a row."""
    slowness_s = []
    for path in paths:
        if kind_of(path) == TABLE:
            with open_recording(path, topics) as source:
                slowness_s += [source.slowness_s] if isinstance(source, OpenTable) else []
    return fitting_period_s(slowness_s, filled=filled)


def fitting_period_s(slowness_s: Sequence[tuple[float, float]], *, filled: bool = False) -> float:
    """
    Choose the length of thermal cells, s: 1, or more, so that slow logs fit into memory.

    As long as their samples are apart at most: what runs live is one cell behind.
    """
    spacings_s, lengths_s = np.reshape([(1.0, 0.0), *slowness_s], (-1, 2)).T
    fitting_s = math.inf if filled else math.ceil(lengths_s.sum() / _MOST_SLOW_CELLS)
    return float(np.clip(fitting_s, 1, min(round(spacings_s.max()), PERIODS_S[1])))


def hash_recording(path: Path) -> str:
    """
    Hash a file's bytes, or those of a bag's storage files in order: SHA-256, hexadecimal.

    What else lies in the folder may change: metadata.yaml, notes, a database's journal.
    """
    digest = hashlib.sha256()
    files = files_of(path)
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if {*SUFFIXES} & {*file.suffixes})
    for file in filter(Path.is_file, files):
        with file.open('rb') as content:
            while some := content.read(1 << 20):
                digest.update(some)
    return digest.hexdigest()


def recording_from_columns(
    *tables: Any, name: str = 'table', period_s: float = 1.0, max_bad_share: float = 0.01
) -> Recording:
    """
    Make a recording of columns in memory, as read_recording does of a CSV file.

    A table is a mapping of names to arrays, or a DataFrame. It has a column ``stamp_s``,
    ``stamp_ms``, ``stamp_us`` or ``stamp_ns`` (whole ns, or datetime64), ascending, and any
    channels (N, N m, °C, or as ``temperature_k`` says); NaN is no sample. Channels of different
    rates may come in several tables. Messages and reports use ``name``. All else is as there.
    """
    opened = OpenTable([TableInMemory(table, name) for table in tables], ReadOptions(), name)
    return read_opened(opened, period_s, max_bad_share)


def compensate(
    model: DriftModel, table: Any, *others: Any, tare_s: float = 0.0
) -> dict[str, FloatArray]:
    """
    Remove the drift from the wrench of a table, as the command ``compensate`` does from a file.

    Tables are as for recording_from_columns. Gives the compensated axes of the first one, N and
    N m, tared on its first ``tare_s`` seconds, which must be unloaded; 0 gives no tare.
    RecordingError as there, or when the thermometers are not those of the model.
    """
    recording = recording_from_columns(table, *others, period_s=model.period_ns / NANOSECONDS)
    (rows,) = OpenTable([TableInMemory(table, recording.name)], ReadOptions()).rows()
    raw, stamps_ns = rows.reindex(columns=AXES).to_numpy(float), rows[STAMP_NS].to_numpy()
    tare = initial_tare(model, recording, tare_s)
    corrected = correct_many(track_drift(model, recording), stamps_ns, raw, tare)
    return {axis: corrected[:, i] for i, axis in enumerate(AXES) if axis in rows}
