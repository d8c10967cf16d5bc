"""
How columns of a table become channels: names, units, factors, and the form of times.

``--columns`` names ours first: ``stamp=time,force_x=fx:kN,force_z=cell*9.8,temperature_c=temp:F``;
a column that has no name is called by its number, from 1 on. A date beside a time of day is
``stamp_date=date,stamp=time``; rows without a time, a hundred a second, are ``stamp=#*0.01``.
``--time`` says what stamps are: s, ms, us, ns, min, h, d, iso (ISO 8601), excel (days since
1899-12-30), datenum (days of MATLAB), timedelta (of pandas), or a form of strptime. The same may
stand in ``recording.yaml`` beside the recordings.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
import math
from pathlib import Path
import re

import numpy as np
import yaml

from wrist_ft_comp.channels import (
    AXES,
    FORCE_CHANNELS,
    REFERENCE_CHANNELS,
    ROTATION_CHANNEL,
)
from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.recording import clock_time, Samples, Topics
from wrist_ft_comp.recordings.table_form import Header
from wrist_ft_comp.series import CLOCK_NS, FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.stored.own_file import beginning
from wrist_ft_comp.stream.clock import NO_TIME
from wrist_ft_comp.wire.temperature_source import to_celsius
from wrist_ft_comp.wire.units import (
    DAYS_TO_1970,
    known_unit,
    plain_unit,
    said_units,
    STAMP,
    STAMPS,
    TIME_UNITS_NS,
    TIMEDELTA,
    units_of,
)

#: What stands for a channel where a column holds the nanoseconds beyond whole seconds, or the date
#: of times of day.
STAMP_NANOSEC, STAMP_DATE = 'stamp_nanosec', 'stamp_date'
STAMP_COLUMNS = STAMP, STAMP_NANOSEC, STAMP_DATE
#: Stands in a map for the number of the row, from 0 on, where no column has this name.
ROW_NUMBER = '#'
#: The place of that column.
ROW = -2
#: Channels with one name; thermometers have a number and a unit.
CHANNELS = (*AXES, *REFERENCE_CHANNELS, *FORCE_CHANNELS, ROTATION_CHANNEL)
#: What a recording has to have: channels of which one is enough.
KINDS = {'stamp': (STAMP,), 'raw wrench': AXES, 'temperature': ('temperature_c',)}
_THERMOMETER = re.compile(r'(temperature_(?:(?:[2-9]|[1-9]\d+)_)?)([ckf])')
#: Name of the empty column of a recording from which drift was removed.
COMPENSATED = 'compensated_by_wrist_ft_comp'
#: A word beside times of a clock that is no unit.
_CLOCK_WORD = re.compile(r'TS|UTC|GMT|local|iso\W*\d*|[dhmsyf:./ -]+', re.IGNORECASE)
#: A name of ours, a column of theirs, a factor, and a unit.
_ENTRY = re.compile(
    r'(?P<ours>\w+)=(?P<theirs>.+?)(\*(?P<factor>[-+\d.eE]+))?(:(?P<unit>[A-Za-z/²°0-9µ·*-]+))?'
)
_FORM = (
    'expected NAME=COLUMN, NAME=COLUMN:UNIT or NAME=COLUMN*FACTOR, separated by commas, such as '
    'stamp=time,force_z=fz:kN,temperature_c=temp:F'
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

    def to_channel(self, values: FloatArray) -> FloatArray:
        """Convert numbers of the column to the unit of the channel."""
        values = values if self.factor is None else values * self.factor
        if self.channel.startswith('temperature'):
            return to_celsius(values, self.unit or 'C')
        units = units_of(self.channel)
        factor = units[self.unit] if self.unit else 1.0
        return values if factor == 1.0 else values * factor


def own_column(name: str) -> Column | None:
    """Tell what a column with one of our names is; None where it is none of ours."""
    if name in STAMPS:
        return Column(name, STAMP, name.removeprefix('stamp_'))
    if thermometer := _THERMOMETER.fullmatch(name):
        return Column(name, f'{thermometer[1]}c', thermometer[2].upper())
    return Column(name, name) if name in {*CHANNELS, STAMP_NANOSEC, STAMP_DATE} else None


@dataclass(frozen=True)
class ColumnMap:
    """What was said of a table's columns, by ``--columns`` and ``--time`` or by a file."""

    columns: tuple[Column, ...] = ()
    #: A unit, iso, a form of strptime; empty where nothing was said.
    time: str = ''
    #: Who said so.
    source: str = '--columns'

    def place(self, table: str, header: Header) -> 'Placed':
        """Find the columns of a table; RecordingError where two hold the same."""
        names, units = header.names, header.units
        mapped: dict[int, Column] = {}
        missing: list[Column] = []
        for named in self.columns:
            if named.name in names:
                mapped[names.index(named.name)] = named
            elif named.name.isdecimal() and 0 < int(named.name) <= len(names):
                mapped[int(named.name) - 1] = named
            elif named.name == ROW_NUMBER and named.channel == STAMP:
                mapped[ROW] = named
            else:
                missing.append(named)
        said = {column.channel for column in mapped.values()}
        own = {place: column for place, name in enumerate(names) if (column := own_column(name))}
        own = {place: column for place, column in own.items() if column.channel not in said}
        found: dict[str, Column] = {}
        warnings: list[str] = []
        for place, column in sorted({**own, **mapped}.items()):
            name, channel = ROW_NUMBER if place == ROW else names[place], column.channel
            if other := found.get(channel):
                raise RecordingError(
                    f'{table} has {channel} twice, in the columns {other.name} and {name}; '
                    'remove or rename one.'
                )
            # A word of the person counts most, then that of the name, then that beside it.
            unit = self.time if channel == STAMP and self.time else column.unit
            if not unit and column.factor is None and channel not in STAMP_COLUMNS[1:]:
                beside = units[place] if 0 <= place < len(units) else ''
                unit = known_unit(channel, name, beside)
                word = next(iter(said_units(name, beside)[-1:]), '')
                is_clock = channel == STAMP and _CLOCK_WORD.fullmatch(word)
                if word and not unit and not is_clock:
                    taken = next(iter(units_of(channel)))
                    warnings.append(
                        f'{name} of {table} is in {word}, a unit that is not understood, and is '
                        f'read in {taken}. Put the right one, or a factor, behind the column, '
                        f"such as '{channel}={name}:{taken}' or '{channel}={name}*0.001'."
                    )
            found[channel] = replace(column, name=name, unit=unit, place=place)
        stamp = found.get(STAMP)
        if STAMP_NANOSEC in found and stamp and stamp.unit not in {'', 's'}:
            raise RecordingError(
                f'{table} has nanoseconds beside stamps that are not in seconds; leave '
                f'{STAMP_NANOSEC} out, or give the seconds as stamp.'
            )
        return Placed(table, header, found, missing, tuple(warnings))


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

    def lacks(self, kinds: Sequence[str]) -> list[str]:
        """List those of some KINDS that no column is of."""
        return [kind for kind in kinds if self.columns.keys().isdisjoint(KINDS[kind])]

    @property
    def stamps(self) -> list[Column]:
        """List the columns of stamps: one, or also that of the nanoseconds or of the date."""
        return [c for c in self.columns.values() if c.channel in STAMP_COLUMNS]

    @property
    def channels(self) -> list[Column]:
        """List the other columns."""
        return [c for c in self.columns.values() if c.channel not in STAMP_COLUMNS]


def parse_map(columns: str, time: str, source: str = '--columns') -> ColumnMap:
    """Understand ``--columns`` and ``--time``; SettingsError where they can't be meant so."""
    time = time if '%' in time else plain_unit(time)
    understood, times = [], [time]
    for entry in filter(None, map(str.strip, re.split(r',(?=\s*\w+=)', columns))):
        match = _ENTRY.fullmatch(entry)
        if match is None:
            raise SettingsError(f'A map of columns cannot be read: {_FORM}; got {entry!r}.')
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
            raise SettingsError(f'{match["ours"]} may be in {allowed}; got {entry!r}.')
        try:
            factor = float(match['factor']) if match['factor'] else None
        except ValueError:
            factor = math.nan
        if factor is not None and not math.isfinite(factor):
            raise SettingsError(f'A factor is a number, such as *9.81; got {entry!r}.')
        # temperature_c says what is wanted; temperature_k and stamp_ms, what stands there.
        said = '' if ours.unit == 'C' else ours.unit
        understood.append(Column(match['theirs'].strip(), ours.channel, unit or said, factor))
    for word in filter(None, times):
        if word not in {*TIME_UNITS_NS, *DAYS_TO_1970, TIMEDELTA, 'iso'} and '%' not in word:
            raise SettingsError(
                f'A time is {", ".join(TIME_UNITS_NS)}, iso, excel, datenum, timedelta, or a '
                f'form such as %d.%m.%Y %H:%M:%S.%f; got {word!r}.'
            )
    return ColumnMap(tuple(understood), time, source)


def listed(names: Iterable[str]) -> str:
    """Enumerate names for people, the first of many."""
    names = [name[:_SHOWN] for name in names]
    more = f' and {len(names) - _LISTED} more' if len(names) > _LISTED else ''
    return f'{", ".join(names[:_LISTED])}{more}'


def samples_of(stamps_ns: IntArray, values: Mapping[str, FloatArray]) -> Iterator[Samples]:
    """
    Make blocks of samples of the values of channels, shape (n,), NaN where there is none.

    A group of channels is split where a row holds a part of it. Rows of one stamp, which the clock
    of a recorder is too coarse to tell apart, are one sample: their mean.
    """
    alone = [(channel,) for channel in values if channel.startswith('temperature')]
    for whole in (AXES, *alone, REFERENCE_CHANNELS, FORCE_CHANNELS, (ROTATION_CHANNEL,)):
        group = tuple(channel for channel in whole if channel in values)
        if not group:
            continue
        filled = np.stack([~np.isnan(values[channel]) for channel in group])
        together = (filled == filled[0]).all()
        for channels in [group] if together else [(channel,) for channel in group]:
            at = ~np.isnan(values[channels[0]])
            block, times_ns = np.stack([values[c][at] for c in channels], 1), stamps_ns[at]
            starts = np.flatnonzero(np.diff(times_ns, prepend=times_ns[:1] - 1))
            if len(starts) < len(times_ns):
                counts = np.diff(starts, append=len(times_ns))
                block = np.add.reduceat(block, starts) / counts[:, np.newaxis]
                times_ns = times_ns[starts]
            yield Samples(channels, times_ns, block)


#: File beside recordings that says how they are read.
MAP_FILE = 'recording.yaml'
_KEYS = 'columns', 'time', 'from', 'until', 'exclude'
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


@dataclass(frozen=True)
class ReadOptions:
    """What was said of a recording, understood."""

    #: As it was said; of a table with what ``recording.yaml`` beside it says.
    topics: Topics = field(default_factory=Topics)
    columns: ColumnMap = field(default_factory=ColumnMap)
    excerpt: Excerpt = field(default_factory=Excerpt)


def parse_options(topics: Topics, source: str = '--columns') -> ReadOptions:
    """Understand what was said; SettingsError where it can't be meant so."""
    columns = parse_map(topics.columns, topics.time, source)
    return ReadOptions(topics, columns, parse_excerpt(topics.begin, topics.end, topics.exclude))


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


def parse_excerpt(begin: str, end: str, exclude: Iterable[str]) -> Excerpt:
    """Understand ``--from``, ``--until`` and ``--exclude``, or refuse them by a SettingsError."""
    stretches = []
    for text in exclude:
        first, dots, last = text.partition('..')
        if not dots:
            raise SettingsError(
                f'A stretch is A..B, such as 4790..4830 or 79min..81min; got {text!r}.'
            )
        stretches.append((_seconds(first), _seconds(last)))
    begin_s = _seconds(begin) if begin else -math.inf
    excerpt = Excerpt(begin_s, _seconds(end or 'inf'), tuple(stretches))
    for begin_s, end_s in (*excerpt.excluded_s, (excerpt.begin_s, excerpt.end_s)):
        if not begin_s < end_s:
            raise SettingsError(
                f'A part must end after it begins; got {begin_s:g} to {end_s:g} s.'
            )
    return excerpt


def _seconds(text: str) -> float:
    """Read a time since the beginning: 4800, 80min, 1.5h or 1:20:00."""
    if match := re.fullmatch(r'(inf|\d+\.?\d*|\.\d+)(s|min|h|)', text.strip()):
        return float(match[1]) * _UNITS_S[match[2]]
    if re.fullmatch(r'\d+(:\d\d){1,2}(\.\d+)?', text.strip()):
        hours, minutes, seconds = (*map(float, text.strip().split(':')), 0.0)[:3]
        return 3600 * hours + 60 * minutes + seconds
    raise SettingsError(f'A time is written 4800, 80min, 1.5h or 1:20:00; got {text!r}.')
