"""
How columns of a table become channels: names, units, factors, and the form of times.

``--columns`` names ours first: ``stamp=time,force_x=fx:kN,force_z=cell*9.8,temperature_c=temp:F``;
a column that has no name is called by its number, from 1 on. ``--time`` says what stamps are: s,
ms, us, ns, min, h, iso (ISO 8601), or a form of strptime. The same may stand in ``recording.yaml``
beside the recordings.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
import math
import re

import numpy as np

from wrist_ft_comp.channels import (
    AXES,
    axis_unit,
    FORCE_CHANNELS,
    GRAVITY,
    REFERENCE_CHANNELS,
    ROTATION_CHANNEL,
)
from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.recording import Samples
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.wire.temperature_source import to_celsius

#: Columns of stamps, and how many nanoseconds their unit has.
STAMPS = {
    'stamp_ns': 1, 'stamp_us': 1_000, 'stamp_ms': 1_000_000, 'stamp_s': NANOSECONDS,
    'stamp_min': 60 * NANOSECONDS, 'stamp_h': 3600 * NANOSECONDS,
}  # fmt: skip
#: What stands for a channel where a column holds stamps, or the nanoseconds beyond whole seconds.
STAMP, STAMP_NANOSEC = 'stamp', 'stamp_nanosec'
#: Channels with one name; thermometers have a number and a unit.
CHANNELS = (*AXES, *REFERENCE_CHANNELS, *FORCE_CHANNELS, ROTATION_CHANNEL)
#: What a recording has to have: channels of which one is enough.
KINDS = {'stamp': (STAMP,), 'raw wrench': AXES, 'temperature': ('temperature_c',)}
_THERMOMETER = re.compile(r'(temperature_(?:(?:[2-9]|[1-9]\d+)_)?)([ckf])')
#: Beginning of the name of an empty column, followed by the names of the sensor.
ORIGIN = 'recorded_from?'
#: Name of the empty column of a recording from which drift was removed.
COMPENSATED = 'compensated_by_wrist_ft_comp'
#: Units of times, the first of which is taken where none is named.
TIME_UNITS_NS = {
    's': NANOSECONDS, **{name.removeprefix('stamp_'): ns for name, ns in STAMPS.items()},
    'd': 86_400 * NANOSECONDS,
}  # fmt: skip
#: By quantity: what one of a unit is in the channel's. The first is taken where none is named.
_UNITS: Mapping[str, Mapping[str, float]] = {
    's': TIME_UNITS_NS,
    '°C': dict.fromkeys('CKF', 1.0),
    'N': {
        'N': 1.0, 'kN': 1e3, 'mN': 1e-3, 'cN': 1e-2, 'lbf': 4.4482216152605, 'kgf': GRAVITY,
        'gf': GRAVITY / 1e3, 'g': GRAVITY / 1e3,
    },
    'N m': {
        'Nm': 1.0, 'kNm': 1e3, 'mNm': 1e-3, 'Nmm': 1e-3, 'Ncm': 1e-2, 'lbfin': 0.1129848290276,
        'lbfft': 1.3558179483314, 'kgfm': GRAVITY, 'kgfcm': GRAVITY / 1e2,
    },
    'm/s²': {'m/s2': 1.0, 'g': GRAVITY},
    'rad/s': {'rad/s': 1.0, 'deg/s': 0.017453292519943},
}  # fmt: skip
#: All names of units.
UNIT_WORDS = {unit for units in _UNITS.values() for unit in units}
#: Other names of units, without the signs that plain_unit leaves out.
_OTHER_UNITS = {
    'lb': 'lbf', 'lbs': 'lbf', 'kg': 'kgf', 'lbin': 'lbfin', 'inlb': 'lbfin', 'inlbf': 'lbfin',
    'lbft': 'lbfft', 'ftlb': 'lbfft', 'ftlbf': 'lbfft', 'm/s²': 'm/s2', 'degC': 'C', 'degF': 'F',
    'DegC': 'C', 'DegF': 'F', 'Celsius': 'C', 'celsius': 'C', 'sec': 's', 'secs': 's',
    'seconds': 's', 'msec': 'ms', '\u00b5s': 'us', 'hours': 'h', 'minutes': 'min', 'days': 'd',
    **{unit.lower(): unit for unit in ('N', 'kN', 'Nm', 'kNm', 'Nmm', 'Ncm', 'C', 'K', 'F')},
    'degc': 'C', 'degf': 'F',
}  # fmt: skip
#: A word in brackets in a column's name.
_IN_BRACKETS = re.compile(r'[\[(]([^\[\]()]*[^\W\d][^\[\]()]*)[\])]')
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
    return Column(name, name) if name in {*CHANNELS, STAMP_NANOSEC} else None


def units_of(channel: str) -> Mapping[str, float]:
    """List the units that a channel, or a stamp, may be in."""
    if channel == STAMP:
        return _UNITS['s']
    if channel.startswith('temperature'):
        return _UNITS['°C']
    return _UNITS[axis_unit(channel.removeprefix('reference_'))]


def plain_unit(text: str) -> str:
    """Write a unit as the tables have it: N m for N*m, lbfin for lb-in, C for °C."""
    plain = re.sub(r'[\s*·.^°_-]', '', text)
    return _OTHER_UNITS.get(plain, plain)


def known_unit(channel: str, name: str, unit: str = '') -> str:
    """Find the unit of a channel in the name of its column, or beside it; empty where unknown."""
    # In brackets, or behind a slash, an underscore or a blank at the end.
    behind = re.findall(r'(?<=[^\s/_])(?:\s*/\s*|_|\s)([^\W\d][^\W\d_/]*|°\w)$', name.strip())
    words = map(plain_unit, (*_IN_BRACKETS.findall(name), *behind, unit))
    return next((word for word in words if word in units_of(channel)), '')


@dataclass(frozen=True)
class ColumnMap:
    """What was said of a table's columns, by ``--columns`` and ``--time`` or by a file."""

    columns: tuple[Column, ...] = ()
    #: A unit, iso, a form of strptime; empty where nothing was said.
    time: str = ''
    #: Who said so.
    source: str = '--columns'

    def place(self, table: str, names: Sequence[str], units: Sequence[str] = ()) -> 'Placed':
        """
        Find the columns of a table of given names, and units where it has a row or column of them.

        RecordingError where a column is not there, or two hold the same.
        """
        found: dict[str, Column] = {}
        warnings: list[str] = []
        mapped = {self._place_of(column, table, names): column for column in self.columns}
        said = {column.channel for column in self.columns}
        for place, name in enumerate(names):
            column = mapped.get(place) or own_column(name)
            if column is None or (place not in mapped and column.channel in said):
                continue
            if column.channel in found:
                raise RecordingError(
                    f'{table} has the column {name} and {found[column.channel].name}, which is '
                    'the same; remove or rename one.'
                    if name != found[column.channel].name
                    else f'{table} has the column {name} twice; remove or rename one.'
                )
            # A word of the person counts most, then that of the name, then that beside it.
            unit = self.time if column.channel == STAMP and self.time else column.unit
            if not unit and column.factor is None and column.channel != STAMP_NANOSEC:
                beside = units[place] if place < len(units) else ''
                unit = known_unit(column.channel, name, beside)
                word = beside or ''.join(_IN_BRACKETS.findall(name)[-1:])
                is_clock = column.channel == STAMP and _CLOCK_WORD.fullmatch(word)
                if word and not unit and not is_clock:
                    taken = next(iter(units_of(column.channel)))
                    warnings.append(
                        f'{name} of {table} is in {word}, a unit that is not understood, and is '
                        f'read in {taken}. Put the right one, or a factor, behind the column, '
                        f"such as '{column.channel}={name}:{taken}' or "
                        f"'{column.channel}={name}*0.001'."
                    )
            found[column.channel] = replace(column, name=name, unit=unit, place=place)
        stamp = found.get(STAMP)
        if STAMP_NANOSEC in found and stamp and stamp.unit not in {'', 's'}:
            raise RecordingError(
                f'{table} has nanoseconds beside stamps that are not in seconds; leave '
                f'{STAMP_NANOSEC} out, or give the seconds as stamp.'
            )
        return Placed(table, names, units, found, tuple(warnings))

    def _place_of(self, column: Column, table: str, names: Sequence[str]) -> int:
        """Find a column by its name, or else by its number."""
        if column.name in names:
            return list(names).index(column.name)
        if column.name.isdecimal() and 0 < int(column.name) <= len(names):
            return int(column.name) - 1
        remedy = 'Write it as the header does, or give its number, from 1 on.'
        if self.source != '--columns':
            remedy = (
                'Move one of them into another folder, or say by --columns what the columns of '
                f'{table} are.'
            )
        raise RecordingError(
            f'{table} has no column {column.name!r}, which {self.source} names; it has '
            f'{listed(names)}. {remedy}'
        )


@dataclass(frozen=True)
class Placed:
    """Where a table has what."""

    table: str
    names: Sequence[str]
    units: Sequence[str]
    #: By channel, STAMP and STAMP_NANOSEC.
    columns: Mapping[str, Column]
    #: Units that are not understood, in sentences.
    warnings: tuple[str, ...] = ()

    def lacks(self, kinds: Sequence[str]) -> list[str]:
        """List those of some KINDS that no column is of."""
        return [kind for kind in kinds if self.columns.keys().isdisjoint(KINDS[kind])]

    @property
    def stamps(self) -> list[Column]:
        """List the columns of stamps: one, or also that of the nanoseconds."""
        return [c for c in self.columns.values() if c.channel in {STAMP, STAMP_NANOSEC}]

    @property
    def channels(self) -> list[Column]:
        """List the other columns."""
        return [c for c in self.columns.values() if c.channel not in {STAMP, STAMP_NANOSEC}]


def parse_map(columns: str, time: str, source: str = '--columns') -> ColumnMap:
    """Understand ``--columns`` and ``--time``; SettingsError where they can't be meant so."""
    time = time if '%' in time else plain_unit(time)
    check_time(time)
    entries = filter(None, re.split(r',(?=\s*\w+=)', columns))
    return ColumnMap(
        tuple(_parse_entry(entry.strip(), columns) for entry in entries), time, source
    )


def _parse_entry(entry: str, columns: str) -> Column:
    match = _ENTRY.fullmatch(entry)
    if match is None:
        raise SettingsError(f'The columns {columns!r} cannot be read: {_FORM}; got {entry!r}.')
    if match['theirs'].strip() in {'…', '...'}:
        raise SettingsError(
            f'The column of {match["ours"]} is left open: put its name, or its number, in the '
            f'place of … in {entry!r}.'
        )
    ours = Column('', STAMP) if match['ours'] == STAMP else own_column(match['ours'])
    if ours is None:
        raise SettingsError(
            f'{match["ours"]} is no name of a column; names are stamp, stamp_nanosec, force_x … '
            'torque_z, temperature_c, temperature_2_c …, reference_force_x … and '
            f'linear_acceleration_x …; got {entry!r}.'
        )
    unit, factor = plain_unit(match['unit'] or ''), None
    if ours.channel == STAMP and unit:
        check_time(unit)
    elif unit and unit not in units_of(ours.channel):
        allowed = ', '.join(units_of(ours.channel))
        raise SettingsError(f'{match["ours"]} may be in {allowed}; got {entry!r}.')
    if match['factor']:
        try:
            factor = float(match['factor'])
        except ValueError:
            factor = math.nan
        if not math.isfinite(factor):
            raise SettingsError(f'A factor is a number, such as *9.81; got {entry!r}.')
    # temperature_c says what is wanted; temperature_k and stamp_ms, what stands there.
    said = '' if ours.unit == 'C' else ours.unit
    return Column(match['theirs'].strip(), ours.channel, unit or said, factor)


def check_time(time: str) -> None:
    """Refuse a time that is no unit and no form, by a SettingsError."""
    if time and time not in {*TIME_UNITS_NS, 'iso'} and '%' not in time:
        raise SettingsError(
            f'A time is {", ".join(TIME_UNITS_NS)}, iso, or a form such as %d.%m.%Y '
            f'%H:%M:%S.%f; got {time!r}.'
        )


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
    groups = (
        tuple(axis for axis in AXES if axis in values),
        *((channel,) for channel in values if channel.startswith('temperature')),
        tuple(channel for channel in REFERENCE_CHANNELS if channel in values),
        tuple(channel for channel in FORCE_CHANNELS if channel in values),
        tuple(channel for channel in (ROTATION_CHANNEL,) if channel in values),
    )
    for group in filter(None, groups):
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
