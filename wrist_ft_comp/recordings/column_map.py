"""
How columns of a table become channels: what ``--columns`` and ``--time`` say, and our own names.

``--columns`` names ours first: ``stamp=time,force_x=fx:kN,force_z=cell*9.8,temperature_c=temp:F``;
a number, from 1 on and through all tables that are joined, stands for a column without a name;
``stamp_date`` for a date beside times of day; ``stamp=#*0.01`` for rows a hundred times a second.
``--time`` says what stamps are: a unit, iso (ISO 8601), excel (days since 1899-12-30), datenum
(days of MATLAB), timedelta (of pandas, or 75:00.5), or a form of strptime.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
import re

from wrist_ft_comp import units
from wrist_ft_comp.channels import AXES, CHANNELS
from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.recordings.table_format import Header
from wrist_ft_comp.series import FloatArray
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
    place: int = -1

    def to_channel(self, values: FloatArray) -> FloatArray:
        """Convert numbers of the column to the unit of the channel."""
        values = values if self.factor is None else values * self.factor
        if self.channel.startswith('temperature'):
            return to_celsius(values, self.unit or 'C')
        return values * units_of(self.channel)[self.unit] if self.unit else values


def lacking_kinds(tables: Sequence[Mapping[str, object]]) -> list[str]:
    """List the KINDS that tables with some channels lack; each of them needs its own stamps."""
    lack = {kind: [part.keys().isdisjoint(KINDS[kind]) for part in tables] for kind in KINDS}
    return [kind for kind, of in lack.items() if (any(of) if kind == STAMP else all(of))]


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
    #: By channel, STAMP and STAMP_NANOSEC, from left to right.
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
    understood: list[Column] = []
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
                f'{match["ours"]} is no name of a column, as stamp, force_x, temperature_2_c, '
                f'reference_force_x and linear_acceleration_x are; got {entry!r}.'
            )
        unit = plain_unit(match['unit'] or '')
        if ours.channel != STAMP and unit and unit not in units_of(ours.channel):
            allowed = ', '.join(units_of(ours.channel))
            raise SettingsError(
                f'{match["ours"]} may be in {allowed}, or have a factor: *0.1; got {entry!r}.'
            )
        factor = float(match['factor']) if match['factor'] else None
        # temperature_c says what is wanted; temperature_k and stamp_ms, what stands there.
        said = '' if ours.unit == 'C' else ours.unit
        understood.append(Column(match['theirs'].strip(), ours.channel, unit or said, factor))
    forms = {*TIME_UNITS_NS, *units.DAYS_TO_1970, units.TIMEDELTA, 'iso', ''}
    for word in (time, *(column.unit for column in understood if column.channel == STAMP)):
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


def place_columns(columns: Sequence[Column], time: str, table: str, header: Header) -> Placed:
    """Find the columns of a table by what was said; RecordingError where two are the same."""
    names = header.names
    mapped: dict[int, Column] = {}
    missing: list[Column] = []
    places = {str(header.columns_before + k + 1): k for k in range(len(names))}
    places |= {name: names.index(name) for name in names}
    for named in columns:
        is_row = named.name == ROW_NUMBER and named.channel == STAMP
        place = places.get(named.name, ROW if is_row else None)
        if place is None:
            missing.append(named)
        elif mapped.setdefault(place, named) != named:
            raise RecordingError(
                f'{table} has one column {named.name}, which is named twice: for '
                f'{mapped[place].channel} and for {named.channel}. Name it once; where joined '
                'tables have columns of one name, write the number of each.'
            )
    said = {column.channel for column in mapped.values()}
    own = {place: column for place, name in enumerate(names) if (column := own_column(name))}
    own = {place: column for place, column in own.items() if column.channel not in said}
    found: dict[str, Column] = {}
    warnings, bare = list[str](), list[str]()
    for place, column in sorted({**own, **mapped}.items()):
        name, channel = ROW_NUMBER if place == ROW else names[place], column.channel
        if other := found.get(channel):
            raise RecordingError(
                f'{table} has {channel} twice, in the columns {other.name} and {name}. Drop one.'
            )
        # A word of the person counts most, then that of the name, then that beside it.
        unit = time if channel == STAMP and time else column.unit
        if not unit and column.factor is None and channel not in {STAMP_NANOSEC, STAMP_DATE}:
            beside = header.units.get(place, '')
            unit = units.known_unit(channel, name if place == ROW else header.title(place), beside)
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
