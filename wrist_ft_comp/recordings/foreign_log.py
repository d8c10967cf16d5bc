"""
How the columns of somebody else's log become ours: names, units, times.

``--columns`` names ours first: ``stamp=time,force_x=fx:kN,force_z=cell*9.8,temperature_c=temp:F``.
``--time`` says what stamps are: s, ms, us, ns, min, h, iso (ISO 8601), or a form of strptime. The
same may stand in a file ``recording.yaml`` beside the recordings: keys ``columns`` and ``time``.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from functools import partial
import math
from pathlib import Path
import re

import numpy as np
import yaml

from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.recordings.columns import (
    channel_of,
    MAP_SIGNS,
    meant_columns,
    STAMP_NANOSEC,
    STAMPS,
)
from wrist_ft_comp.signals import AXES, axis_unit, GRAVITY, NANOSECONDS, Samples
from wrist_ft_comp.stored.own_file import beginning

#: File beside recordings that says how they are read.
MAP_FILE = 'recording.yaml'
#: What one of a unit is in N, N m, m/s² or rad/s.
_FACTORS = {
    'N': {
        'N': 1.0, 'kN': 1e3, 'mN': 1e-3, 'cN': 1e-2, 'lbf': 4.4482216152605, 'kgf': GRAVITY,
        'gf': GRAVITY / 1e3,
    },
    'N m': {
        'Nm': 1.0, 'kNm': 1e3, 'mNm': 1e-3, 'Nmm': 1e-3, 'Ncm': 1e-2, 'lbfin': 0.1129848290276,
        'lbfft': 1.3558179483314, 'kgfm': GRAVITY, 'kgfcm': GRAVITY / 1e2,
    },
    'm/s²': {'m/s2': 1.0, 'g': GRAVITY},
    'rad/s': {'rad/s': 1.0, 'deg/s': 0.017453292519943},
}  # fmt: skip
_TEMPERATURE_UNITS = 'C', 'K', 'F'
#: Other names of units, without the signs that _plain_unit leaves out.
_OTHER_UNITS = {
    'lb': 'lbf', 'lbs': 'lbf', 'kg': 'kgf', 'lbin': 'lbfin', 'inlb': 'lbfin', 'inlbf': 'lbfin',
    'lbft': 'lbfft', 'ftlb': 'lbfft', 'ftlbf': 'lbfft', 'm/s²': 'm/s2', 'degC': 'C', 'degF': 'F',
    'Celsius': 'C', 'celsius': 'C', 'sec': 's', 'secs': 's', 'seconds': 's', 'msec': 'ms',
    '\u00b5s': 'us', 'hours': 'h', 'minutes': 'min',
}  # fmt: skip
_TIMES = {name.removeprefix('stamp_'): name for name in STAMPS}
#: Names of ours that say in which unit the column is.
_NAMES_UNIT = re.compile(r'stamp_\w+|temperature_\w*[kf]')
#: A name of ours, a column of theirs, a factor, and a unit.
_ENTRY = re.compile(
    r'(?P<ours>\w+)=(?P<theirs>.+?)(\*(?P<factor>[-+\d.eE]+))?(:(?P<unit>[A-Za-z/²°0-9µ·*-]+))?'
)
_FORM = (
    'expected NAME=COLUMN, NAME=COLUMN:UNIT or NAME=COLUMN*FACTOR, separated by commas, such as '
    'stamp=time,force_z=fz:kN,temperature_c=temp:F'
)
_ISO = re.compile(r'(\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d)(?:[.,](\d{1,9})\d*)?(Z|[+-]\d\d:?\d\d)?')
#: Between which readings a day may begin in a unit, and hardly in °C.
_COLD_STARTS = {'F': (55.0, 120.0), 'K': (230.0, 330.0)}
#: Stamps from 2001 on, in seconds, have at least this size; in other units it is that much larger.
_EPOCH_S = 1e9
_EPOCH_SIZES = {'ns': 1e9, 'us': 1e6, 'ms': 1e3, 's': 1.0}
#: Stamps in nanoseconds have at most this size, because they are integers of 64 bits.
_LARGEST_EPOCH = 9.2e9
#: Forces that move by less than this over a whole recording, less than any sensor's noise, are in
#: no newtons.
_NEVER_NEWTONS = 0.02
#: Nor are those that move by less than this, and by less than the torques: a lever arm of a metre.
_PERHAPS_NEWTONS = 0.5


@dataclass(frozen=True)
class LogMap:
    """What a log's columns are called here, and how their cells are read."""

    #: By column of the log: our column. What is not named keeps its name.
    names: Mapping[str, str] = field(default_factory=dict)
    #: By our column: what its numbers are multiplied with.
    factors: Mapping[str, float] = field(default_factory=dict)
    #: Reads a stamp, ns; None where its column's name says how.
    stamp: Callable[[str], int] | None = None
    #: By column of the log whose unit is not understood: our column.
    unclear: Mapping[str, str] = field(default_factory=dict)
    #: Whether it is that of the file beside the recordings.
    is_beside: bool = False


def log_map(columns: str, time: str) -> LogMap:
    """
    Understand ``--columns`` and ``--time``; SettingsError where they can't be meant so.

    Where neither a unit nor a factor is given, the unit in the column's name counts.
    """
    reader = _stamp_reader(time)
    names: dict[str, str] = {}
    factors: dict[str, float] = {}
    unclear: dict[str, str] = {}
    for entry in filter(None, re.split(r',(?=\s*\w+=)', columns)):
        match = _ENTRY.fullmatch(entry.strip())
        if match is None:
            raise SettingsError(f'The columns {columns!r} cannot be read: {_FORM}; got {entry!r}.')
        ours, theirs = match['ours'], match['theirs'].strip()
        unit, factor = _plain_unit(match['unit'] or ''), _finite(match['factor'] or '1', entry)
        is_stamp = ours in {'stamp', STAMP_NANOSEC, *STAMPS}
        if not is_stamp and channel_of(ours) == '':
            raise SettingsError(
                f'{ours} is no name of a column; names are stamp, stamp_nanosec, force_x … '
                'torque_z, temperature_c, temperature_2_c …, reference_force_x … and '
                f'linear_acceleration_x …; got {entry!r}.'
            )
        said = match['unit'] or match['factor'] or (ours == 'stamp' and time)
        if not said and not _NAMES_UNIT.fullmatch(ours):
            unit = unit_in(theirs, ours)
            if unit not in {'', *_units_of(ours)}:
                unclear[theirs], unit = ours, ''
        if is_stamp:
            ours = _stamp_in(unit or time or 's', entry) if ours == 'stamp' else ours
        elif ours.startswith('temperature'):
            ours = _in_unit(ours, unit, entry)
        else:
            factor *= _factor(ours, unit, entry)
        names[theirs] = ours
        if factor != 1:
            factors[ours] = factor
    return LogMap(names, factors, reader, unclear)


def _finite(text: str, entry: str) -> float:
    """Read a factor."""
    with suppress(ValueError):
        if math.isfinite(factor := float(text)):
            return factor
    raise SettingsError(f'A factor is a number, such as *9.81; got {entry!r}.')


def _units_of(ours: str) -> Iterable[str]:
    """List the units in which a column of ours may be; the first is the one without a word."""
    if ours.startswith('stamp'):
        return ('s', *_TIMES)
    if ours.startswith('temperature'):
        return _TEMPERATURE_UNITS
    return _FACTORS[axis_unit(ours.removeprefix('reference_'))]


def _plain_unit(text: str) -> str:
    """Write a unit as the tables have it: N m for N*m, lbfin for lb-in, C for °C."""
    plain = re.sub(r'[\s*·.^°_-]', '', text)
    return _OTHER_UNITS.get(plain, plain)


def unit_in(column: str, ours: str) -> str:
    """Find the unit in the name of a log's column: in brackets, or that of a time behind a _."""
    in_brackets = re.findall(r'[\[(]([^\[\]()]*[^\W\d][^\[\]()]*)[\])]', column)
    if words := [_plain_unit(word) for word in in_brackets]:
        return next((word for word in words if word in _units_of(ours)), words[-1])
    ending = column.rpartition('_')[2]
    return ending if ours.startswith('stamp') and ending in _TIMES else ''


def unclear_units(name: str, unclear: Mapping[str, str]) -> Iterator[str]:
    """Warn, in one sentence, of units of a log that are not understood."""
    taken = [(column, ours, next(iter(_units_of(ours)))) for column, ours in unclear.items()]
    if taken:
        column, ours, unit = taken[-1]
        words = ', '.join(f'{column} is read in {unit}' for column, _, unit in taken)
        yield (
            f'{name} names units that are not understood: {words}. Put the right one, or a '
            f"factor, behind the column, such as '{ours}={column}:{unit}' or "
            f"'{ours}={column}*0.001'."
        )


def _stamp_in(unit: str, entry: str) -> str:
    """Name the column of stamps in a unit, or in another form, which is made nanoseconds."""
    if unit in _TIMES or unit == 'iso' or '%' in unit:
        return _TIMES.get(unit, 'stamp_ns')
    raise SettingsError(f'A stamp is in {", ".join(_TIMES)}; got {entry!r}.')


def _in_unit(ours: str, unit: str, entry: str) -> str:
    """Name the column of a thermometer whose numbers are in a unit."""
    if unit not in {'', *_TEMPERATURE_UNITS}:
        raise SettingsError(f'A temperature is in C, K or F; got {entry!r}.')
    return f'{ours[:-1]}{unit.lower()}' if unit else ours


def _factor(ours: str, unit: str, entry: str) -> float:
    units = _FACTORS[axis_unit(ours.removeprefix('reference_'))]
    if unit and unit not in units:
        raise SettingsError(f'{ours} may be in {", ".join(units)}; got {entry!r}.')
    return units[unit] if unit else 1.0


def _stamp_reader(time: str) -> Callable[[str], int] | None:
    """Choose how stamps are read."""
    if time == '' or time in _TIMES:
        return None
    if time == 'iso':
        return iso_nanoseconds
    if '%' in time:
        return partial(_by_form, time)
    raise SettingsError(
        f'--time is {", ".join(_TIMES)}, iso, or a form such as %d.%m.%Y %H:%M:%S.%f; got '
        f'{time!r}.'
    )


def iso_nanoseconds(text: str) -> int:
    """Read a time of ISO 8601, ns since 1970; without a zone it counts as UTC. Else ValueError."""
    match = _ISO.fullmatch(text.strip())
    if match is None:
        raise ValueError(text)
    zone = (match[3] or 'Z').replace('Z', '+0000').replace(':', '')
    moment = datetime.strptime(f'{match[1].replace("T", " ")}{zone}', '%Y-%m-%d %H:%M:%S%z')
    return int(moment.timestamp()) * NANOSECONDS + int((match[2] or '').ljust(9, '0'))


def _by_form(form: str, text: str) -> int:
    """Read a time of a form of strptime, ns; without a zone it counts as UTC. Else ValueError."""
    moment = datetime.strptime(text.strip(), form)
    moment = moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)
    since = moment - datetime(1970, 1, 1, tzinfo=timezone.utc)
    return (since.days * 86400 + since.seconds) * NANOSECONDS + since.microseconds * 1000


def map_beside(path: Path, columns: str, time: str) -> LogMap:
    """Take what was given, or else what ``recording.yaml`` beside a log says; often nothing."""
    beside = path.with_name(MAP_FILE)
    if columns or time or not beside.is_file():
        return log_map(columns, time)
    try:
        content = yaml.safe_load(beginning(beside))
    except yaml.YAMLError as error:
        raise RecordingError(f'{beside} cannot be read: {error}.') from error
    if not isinstance(content, dict) or not content.keys() <= {'columns', 'time'}:
        raise RecordingError(
            f'{beside} must have the keys columns and time and no others. If it is of another '
            'program, move it, or give --columns.'
        )
    entries = content.get('columns', '')
    if isinstance(entries, dict):
        entries = ','.join(f'{ours}={theirs}' for ours, theirs in entries.items())
    names = log_map(str(entries), str(content.get('time', '')))
    return replace(names, is_beside=True)


def guessed_map(columns: Sequence[str], row: Sequence[str]) -> tuple[str, str]:
    """
    Guess the map of a log from its header and its first row, as ``--columns`` and ``--time``.

    Units come from brackets behind names; empty where the names are this package's own.
    """
    entries, time = [], ''
    ours = {channel_of(column) or column for column in columns}
    if ours & set(STAMPS) and ours & set(AXES) and 'temperature_c' in ours:
        return '', ''
    meant = meant_columns(columns)
    for column, name in meant.items():
        word = unit_in(column, name) if name else ''
        cell = row[columns.index(column)] if len(row) == len(columns) else ''
        if name == 'stamp_s':
            time = _guessed_time(cell, word)
        if name and not MAP_SIGNS.search(column):
            if name.startswith('temperature') and word not in _TEMPERATURE_UNITS:
                word = _guessed_temperature_unit(cell) or word
            is_unit = name not in {'stamp_s', STAMP_NANOSEC} and word in _units_of(name)
            unit_word = f':{word}' if is_unit else ''
            entries.append(f'{name.replace("stamp_s", "stamp")}={column}{unit_word}')
    # Without a time nothing is read: let the refusal name the log's own columns.
    has_time = 'stamp_s' in meant.values() or ours & set(STAMPS)
    return (','.join(entries), time) if has_time else ('', '')


def _guessed_time(cell: str, unit: str) -> str:
    """Guess what a stamp is from one of them, and a unit in its name; '' where that is unclear."""
    if _ISO.fullmatch(cell.strip()):
        return 'iso'
    return unit if unit in _TIMES else time_unit(cell) or ('s' if not unit else '')


def time_unit(cell: str) -> str:
    """Tell the unit of a time since 1970 by its size; empty before 2001, and of anything else."""
    try:
        size = float(cell.replace(',', '.')) / _EPOCH_S
    except ValueError:
        return ''
    larger = (unit for unit, least in _EPOCH_SIZES.items() if least < size < _LARGEST_EPOCH)
    return next(larger, '')


def _guessed_temperature_unit(cell: str) -> str:
    """Guess the unit of a thermometer from its first reading: robots are rarely begun with hot."""
    try:
        reading = float(cell.replace(',', '.'))
    except ValueError:
        return ''
    return next((unit for unit, (low, high) in _COLD_STARTS.items() if low < reading < high), '')


def with_guessed_force_unit(columns: str, blocks: Iterable[Samples]) -> str:
    """Put kN behind the forces of a guessed map that names no unit, where newtons cannot be."""
    low, high = np.full(len(AXES), np.inf), np.full(len(AXES), -np.inf)
    for block in blocks:
        for axis, values in zip(block.channels, block.values.T, strict=True):
            if axis in AXES and len(values):
                at = AXES.index(axis)
                low[at] = min(low[at], np.nanmin(values, initial=np.inf))
                high[at] = max(high[at], np.nanmax(values, initial=-np.inf))
    spans = np.where(high > low, high - low, 0.0)
    force, torque = spans[:3].max(), spans[3:].max()
    if not 0 < force < max(_NEVER_NEWTONS, min(torque, _PERHAPS_NEWTONS)):
        return columns
    return re.sub(r'(\bforce_[xyz]=[^,:]*)(?=,|$)', r'\1:kN', columns)


def recipe(columns: str, time: str) -> Iterable[str]:
    """Write a map as the lines of ``recording.yaml``."""
    yield f'columns: {yaml.safe_dump(columns, width=1000).splitlines()[0]}'
    if time:
        yield f'time: {yaml.safe_dump(time).splitlines()[0]}'
