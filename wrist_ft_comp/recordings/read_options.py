"""
How a recording is read: how columns of a table become channels, and which part of it counts.

``--columns`` names ours first: ``stamp=time,force_x=fx:kN,force_z=cell*9.8,temperature_c=temp:F``;
a number, from 1 on and through all tables that are joined, stands for a column without a name;
``stamp_date`` for a date beside times of day; ``stamp=#*0.01`` for rows a hundred times a second.
``--time`` says what stamps are: a unit, iso (ISO 8601), excel (days since 1899-12-30), datenum
(days of MATLAB), timedelta (of pandas, or 75:00.5), or a form of strptime. What is before
``--from``, after ``--until`` or within ``--exclude`` does not count. The same may stand in
``recording.yaml`` beside the recordings.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
import math
from pathlib import Path
import re

import numpy as np
import yaml

from wrist_ft_comp import units
from wrist_ft_comp.channels import AXES, CHANNELS
from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.recording import clock_time, Samples, Topics
from wrist_ft_comp.recordings.table_format import Header
from wrist_ft_comp.series import CLOCK_NS, FloatArray, NANOSECONDS
from wrist_ft_comp.stored.safe_file import beginning
from wrist_ft_comp.stream.clock import NO_TIME
from wrist_ft_comp.units import plain_unit, STAMP, TIME_UNITS_NS, to_celsius, units_of

#: What stands for a channel where a column holds the nanoseconds beyond whole seconds, or the date
#: of times of day.
STAMP_NANOSEC, STAMP_DATE = 'stamp_nanosec', 'stamp_date'
STAMP_COLUMNS = STAMP_DATE, STAMP, STAMP_NANOSEC
#: Stands in a map for the number of the row, from 0 on, where no column has this name.
ROW_NUMBER = '#'
#: The place of that column.
ROW = -2
#: What a recording has to have: channels of which one is enough.
KINDS = {'stamp': (STAMP,), 'raw wrench': AXES, 'temperature': ('temperature_c',)}
_THERMOMETER = re.compile(r'(temperature_(?:(?:[2-9]|[1-9]\d+)_)?)([ckf])')
#: Name of the empty column of a recording from which drift was removed.
COMPENSATED = 'compensated_by_wrist_ft_comp'
#: A name of ours, a column of theirs, a factor, and a unit.
_ENTRY = re.compile(
    r'(?P<ours>\w+)=(?P<theirs>.+?)(\*(?P<factor>[-+]?\d*\.?\d+([eE]-?\d\d?)?))?'
    r'(:(?P<unit>[A-Za-z/²°0-9µ·*-]+))?'
)
#: Most columns that a sentence lists, and most letters of each.
_LISTED, _SHOWN = 30, 40


@dataclass(frozen=True)
class Column:
    """What a column of a table is."""

    #: As the table calls it.
    name: str
    #: A channel, STAMP or STAMP_NANOSEC.
    channel: str
    #: As plain_unit writes it; of stamps also iso, or a form of strptime. Empty where unknown.
    unit: str = ''
    #: What its numbers are multiplied with; None where nothing was said.
    factor: float | None = None
    #: Its place in the rows.
    place: int = -1

    def entry(self, columns_before: int) -> str:
        """Write it by its number, as a map has it; that of a stamp without its unit."""
        factor = '' if self.factor is None else f'*{self.factor:g}'
        unit = f':{self.unit}' if self.unit and self.channel != STAMP else ''
        return f'{self.channel}={columns_before + self.place + 1}{factor}{unit}'

    def to_channel(self, values: FloatArray) -> FloatArray:
        """Convert numbers of the column to the unit of the channel."""
        values = values if self.factor is None else values * self.factor
        if self.channel.startswith('temperature'):
            return to_celsius(values, self.unit or 'C')
        factor = units_of(self.channel)[self.unit] if self.unit else 1.0
        return values if factor == 1.0 else values * factor


def own_column(name: str) -> Column | None:
    """Tell what a column with one of our names is; None where it is none of ours."""
    if (unit := name.removeprefix('stamp_')) in TIME_UNITS_NS and unit != name:
        return Column(name, STAMP, unit)
    if thermometer := _THERMOMETER.fullmatch(name):
        return Column(name, f'{thermometer[1]}c', thermometer[2].upper())
    return Column(name, name) if name in {*CHANNELS, STAMP_NANOSEC, STAMP_DATE} else None


@dataclass(frozen=True)
class Placed:
    """Where a table has what."""

    table: str
    header: Header
    #: By channel, STAMP and STAMP_NANOSEC.
    columns: Mapping[str, Column]
    #: What a map names and the table does not have.
    missing: Sequence[Column] = ()
    #: Units that are not understood, in sentences.
    warnings: tuple[str, ...] = ()

    @property
    def channels(self) -> list[Column]:
        """List the columns that hold no stamps."""
        return [c for c in self.columns.values() if c.channel not in STAMP_COLUMNS]

    @property
    def unused(self) -> list[int]:
        """List the places of the columns that are not understood."""
        used = {column.place for column in self.columns.values()}
        return [place for place in range(len(self.header.names)) if place not in used]


def parse_map(columns: str, time: str) -> tuple[tuple[Column, ...], str]:
    """Understand ``--columns`` and ``--time``; SettingsError where they can't be meant so."""
    time = time if '%' in time else plain_unit(time)
    understood, times = [], [time]
    for entry in filter(None, map(str.strip, re.split(r',(?=\s*\w+=)', columns))):
        match = _ENTRY.fullmatch(entry)
        if match is None:
            raise SettingsError(
                'A map of columns cannot be read: expected NAME=COLUMN, NAME=COLUMN:UNIT or '
                f'NAME=COLUMN*FACTOR, such as stamp=time,force_z=fz:kN; got {entry!r}.'
            )
        if match['theirs'].strip() in {'…', '...'}:
            raise SettingsError(
                f'The column of {match["ours"]} is left open: put its name, or its number, in the '
                f'place of … in {entry!r}.'
            )
        ours = Column('', STAMP) if match['ours'] == STAMP else own_column(match['ours'])
        if ours is None:
            raise SettingsError(
                f'{match["ours"]} is no name of a column; names are stamp, stamp_nanosec, force_x '
                '… torque_z, temperature_c, temperature_2_c …, reference_force_x … and '
                f'linear_acceleration_x …; got {entry!r}.'
            )
        unit = plain_unit(match['unit'] or '')
        if ours.channel == STAMP:
            times.append(unit)
        elif unit and unit not in units_of(ours.channel):
            allowed = ', '.join(units_of(ours.channel))
            raise SettingsError(
                f'{match["ours"]} may be in {allowed}, or have a factor such as *0.1 instead of a '
                f'unit; got {entry!r}.'
            )
        factor = float(match['factor']) if match['factor'] else None
        # temperature_c says what is wanted; temperature_k and stamp_ms, what stands there.
        said = '' if ours.unit == 'C' else ours.unit
        understood.append(Column(match['theirs'].strip(), ours.channel, unit or said, factor))
    forms = {*TIME_UNITS_NS, *units.DAYS_TO_1970, units.TIMEDELTA, 'iso', ''}
    for word in times:
        if word not in forms and '%' not in word:
            raise SettingsError(
                f'A time is {", ".join(TIME_UNITS_NS)}, iso, excel, datenum, timedelta, or a '
                f'form such as %d.%m.%Y %H:%M:%S.%f; got {word!r}.'
            )
    return tuple(understood), time


def listed(names: Iterable[str]) -> str:
    """Enumerate names for people, the first of many."""
    names = [name[:_SHOWN] for name in names]
    more = f' and {len(names) - _LISTED} more' if len(names) > _LISTED else ''
    return f'{", ".join(names[:_LISTED])}{more}'


#: File beside recordings that says how they are read.
MAP_FILE = 'recording.yaml'
_KEYS = 'columns', 'time', 'from', 'until', 'exclude'
#: Units of times since the beginning, s.
_UNITS_S = {'': 1.0, 's': 1.0, 'min': 60.0, 'h': 3600.0}


@dataclass(frozen=True)
class Excerpt:
    """What of a recording counts."""

    #: Seconds since the first stamp of the file.
    begin_s: float = -math.inf
    end_s: float = math.inf
    #: Beginning and end of stretches whose wrenches are left out; temperatures go on.
    excluded_s: tuple[tuple[float, float], ...] = ()

    def select(
        self, blocks: Iterable[Samples], name: str, first_ns: list[int]
    ) -> Iterator[Samples]:
        """
        Leave out what does not count; SettingsError where nothing is left of a recording.

        The first stamp of all, from which times count, is put into ``first_ns``.
        """
        lasts_s = 0.0
        #: Whether a sample was left, by what came.
        is_left: dict[str, bool] = {}
        for block in blocks:
            timed = block.stamps_ns != NO_TIME  # the first messages may have no stamp yet
            first_ns += block.stamps_ns[timed][:1].tolist()
            begin_ns = first_ns[0] if first_ns else 0
            since_s = np.where(timed, block.stamps_ns - begin_ns, 0) / NANOSECONDS
            kind = 'wrench' if block.channels[0] in AXES else block.channels[0].split('_')[0]
            counts = (since_s >= self.begin_s) & (since_s <= self.end_s)
            for begin_s, end_s in self.excluded_s if kind == 'wrench' else ():
                counts &= (since_s < begin_s) | (since_s > end_s)
            lasts_s = max(lasts_s, float(since_s.max(initial=0.0)))
            if timed.any():
                is_left[kind] = is_left.get(kind, False) or bool(counts.any())
            yield Samples(block.channels, block.stamps_ns[counts], block.values[counts])
        for kind in ('wrench', 'temperature'):
            if not is_left.get(kind, True):
                is_clock = first_ns[0] >= CLOCK_NS
                begins = f'begins at {clock_time(first_ns[0])} and ' if is_clock else ''
                raise SettingsError(
                    f'Every {kind} of {name}, which {begins}lasts {lasts_s:.0f} s, is left out '
                    'by --from, --until and --exclude. Leave some in.'
                )


def parse_excerpt(begin: str, end: str, exclude: Iterable[str]) -> Excerpt:
    """Understand ``--from``, ``--until`` and ``--exclude``, or refuse them by a SettingsError."""
    excluded_s = []
    for text in exclude:
        first, dots, last = text.partition('..')
        if not dots:
            raise SettingsError(
                f'A stretch is A..B, such as 4790..4830 or 79min..81min; got {text!r}.'
            )
        excluded_s.append((_seconds(first), _seconds(last)))
    begin_s = _seconds(begin) if begin else -math.inf
    end_s = _seconds(end) if end else math.inf
    for first_s, last_s in (*excluded_s, (begin_s, end_s)):
        if not first_s < last_s:
            raise SettingsError(
                f'A part must end after it begins; got {first_s:g} to {last_s:g} s.'
            )
    return Excerpt(begin_s, end_s, tuple(excluded_s))


def _seconds(text: str) -> float:
    """Read a time since the beginning: 4800, 80min, 1.5h or 1:20:00."""
    if match := re.fullmatch(r'(\d+\.?\d*|\.\d+)(s|min|h|)', text.strip()):
        return float(match[1]) * _UNITS_S[match[2]]
    if re.fullmatch(r'\d+(:\d\d){1,2}(\.\d+)?', text.strip()):
        hours, minutes, seconds = (*map(float, text.strip().split(':')), 0.0)[:3]
        return 3600 * hours + 60 * minutes + seconds
    raise SettingsError(f'A time is written 4800, 80min, 1.5h or 1:20:00; got {text!r}.')


@dataclass(frozen=True)
class ReadOptions:
    """What was said of a recording, understood."""

    #: As it was said; of a table with what ``recording.yaml`` beside it says.
    topics: Topics = field(default_factory=Topics)
    #: What ``--columns`` says; their places are not known yet.
    columns: tuple[Column, ...] = ()
    #: What ``--time`` says: a unit, iso, a form of strptime; empty where nothing was said.
    time: str = ''
    #: Who said so.
    source: str = '--columns'
    excerpt: Excerpt = field(default_factory=Excerpt)

    def place(self, table: str, header: Header) -> Placed:
        """Find the columns of a table; RecordingError where two hold the same."""
        names = header.names
        mapped: dict[int, Column] = {}
        missing: list[Column] = []
        for named in self.columns:
            number = int(named.name) - header.columns_before if named.name.isdecimal() else 0
            if named.name in names:
                mapped[names.index(named.name)] = named
            elif 0 < number <= len(names):
                mapped[number - 1] = named
            elif named.name == ROW_NUMBER and named.channel == STAMP:
                mapped[ROW] = named
            else:
                missing.append(named)
        said = {column.channel for column in mapped.values()}
        if lost := {c.channel for c in self.columns} - said - {c.channel for c in missing}:
            raise RecordingError(
                f'{table} has no column for {listed(sorted(lost))}: the one that is named holds '
                'another channel, too. Name each column once.'
            )
        own = {place: column for place, name in enumerate(names) if (column := own_column(name))}
        own = {place: column for place, column in own.items() if column.channel not in said}
        found: dict[str, Column] = {}
        warnings, bare = list[str](), list[str]()
        for place, column in sorted({**own, **mapped}.items()):
            name, channel = ROW_NUMBER if place == ROW else names[place], column.channel
            if other := found.get(channel):
                raise RecordingError(
                    f'{table} has {channel} twice, in the columns {other.name} and {name}; '
                    'remove or rename one.'
                )
            # A word of the person counts most, then that of the name, then that beside it.
            unit = self.time if channel == STAMP and self.time else column.unit
            if not unit and column.factor is None and channel not in {STAMP_NANOSEC, STAMP_DATE}:
                beside = header.units.get(place, '')
                title = name if place == ROW else header.title(place)
                unit = units.known_unit(channel, title, beside)
                word = next(iter(units.said_units(name, beside)[-1:]), '')
                # What stands beside times is often a zone, or their form.
                if word and not unit and channel != STAMP:
                    taken = next(iter(units_of(channel)))
                    warnings.append(
                        f'{name} of {table} is in {word}, a unit that is not understood, and is '
                        f'read in {taken}. Put the right one, or a factor, behind the column, '
                        f"such as '{channel}={name}:{taken}' or '{channel}={name}*0.001'."
                    )
                elif not unit and channel in AXES and name != channel:
                    bare.append(name)
            found[channel] = replace(column, name=name, unit=unit, place=place)
        if bare and header.doubt:
            warnings.append(
                f'No unit is beside {listed(bare)} of {table}, read in N or N m, but a line above '
                f'the rows says {header.doubt.strip()!r}. If it is of them, put the unit or a '
                f'factor behind them, such as {bare[0]}:kN or {bare[0]}*0.001; if not, :N or :Nm.'
            )
        return Placed(table, header, found, missing, tuple(warnings))


def parse_options(topics: Topics, source: str = '--columns') -> ReadOptions:
    """Understand what was said; SettingsError where it can't be meant so."""
    columns, time = parse_map(topics.columns, topics.time)
    excerpt = parse_excerpt(topics.begin, topics.end, topics.exclude)
    return ReadOptions(topics, columns, time, source, excerpt)


def options_beside(table: Path, topics: Topics) -> ReadOptions:
    """Understand what was said of a table, and what ``recording.yaml`` beside it says more."""
    beside = table.with_name(MAP_FILE)
    if topics.columns or not beside.is_file():
        return parse_options(topics)
    try:
        content = yaml.safe_load(beginning(beside))
    except yaml.YAMLError as error:
        raise RecordingError(f'{beside} cannot be read: {error}.') from error
    if not isinstance(content, dict) or not content.keys() <= {*_KEYS}:
        raise RecordingError(
            f'{beside} must have the keys columns and time, perhaps from, until and exclude, and '
            'no others. If it is of another program, move it, or give --columns.'
        )
    entries, exclude = content.get('columns', ''), content.get('exclude', ())
    if isinstance(entries, dict):
        entries = ','.join(f'{ours}={theirs}' for ours, theirs in entries.items())
    said = replace(
        topics,
        columns=str(entries),
        time=topics.time or str(content.get('time', '')),
        begin=topics.begin or str(content.get('from', '')),
        end=topics.end or str(content.get('until', '')),
        exclude=topics.exclude or tuple([exclude] if isinstance(exclude, str) else exclude),
    )
    return parse_options(said, f'{MAP_FILE} beside it')


def recipe(columns: str, time: str) -> Iterable[str]:
    """Write a map as the lines of ``recording.yaml``."""
    yield f'columns: {yaml.safe_dump(columns, width=1000, allow_unicode=True).splitlines()[0]}'
    if time:
        yield f'time: {yaml.safe_dump(time).splitlines()[0]}'
