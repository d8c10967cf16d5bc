"""
Tables of named columns: which channels they hold, and a recording made of ones in memory.

A table has ``keys`` and columns by name, a stamp and channels (``signals``): a dict of arrays, or
a pandas DataFrame. Where a column may be in several units, its name holds the unit.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
import difflib
from itertools import islice
import re
from typing import Any, Protocol

import numpy as np

from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.signals import (
    AXES,
    axis_unit,
    BoolArray,
    FloatArray,
    FORCE_CHANNELS,
    IntArray,
    NANOSECONDS,
    Recording,
    REFERENCE_CHANNELS,
    ROTATION_CHANNEL,
    Samples,
    temperature_channel,
)
from wrist_ft_comp.stream.batch_grid import grid_samples
from wrist_ft_comp.stream.offline import correct_many, initial_tare, track_drift
from wrist_ft_comp.wire.temperature_source import may_be_temperature
from wrist_ft_comp.wire.units import to_celsius

#: Columns of stamps, and how many nanoseconds their unit has.
STAMPS = {
    'stamp_ns': 1, 'stamp_us': 1_000, 'stamp_ms': 1_000_000, 'stamp_s': NANOSECONDS,
    'stamp_min': 60 * NANOSECONDS, 'stamp_h': 3600 * NANOSECONDS,
}  # fmt: skip
#: Column of the nanoseconds beyond stamps of whole seconds, as ROS writes times.
STAMP_NANOSEC = 'stamp_nanosec'
_NANOSEC = re.compile('.*?(nano|n)sec(s|onds)?')
#: Channels with one name; thermometers have a number and a unit.
_CHANNELS = (*AXES, *REFERENCE_CHANNELS, *FORCE_CHANNELS, ROTATION_CHANNEL)
_THERMOMETER = re.compile(r'(temperature_(?:(?:[2-9]|[1-9]\d+)_)?)([ckf])')
#: Names of columns by other loggers, in small letters, without signs and a unit in brackets.
_ALIASES = {
    **dict.fromkeys(('t', 'time', 'timestamp', 'date', 'datetime', 'sec', 'secs'), 'stamp_s'),
    **{
        stamp.replace('stamp', time): 'stamp_s'
        for stamp in STAMPS
        for time in ('t', 'time', 'timestamp')
    },
    **{f'{short}{axis}': f'force_{axis}' for short in ('f', 'f_') for axis in 'xyz'},
    **{f'{short}{axis}': f'torque_{axis}' for short in ('t', 't_', 'm', 'm_') for axis in 'xyz'},
    **{
        f'{short}{axis}': f'linear_acceleration_{axis}'
        for short in ('a', 'acc_')
        for axis in 'xyz'
    },
}
#: T, T1, T_sensor or T [°C] is a temperature; t is a time, and T_x a torque.
_SHORT_TEMPERATURE = re.compile(r'T(\d+|_(?![xyzXYZ]\b)\w+)?\s*([\[(]\W*(deg)?\W*[CKF]\w*\W*)?')
#: What names the true wrench among columns of a log.
_TRUE = re.compile('reference|ref|truth|true')
#: Signs of a map: a column with one of them in its name cannot stand in one. N*m has no factor.
MAP_SIGNS = re.compile(r'[,:=]|\*[-+.\deE]')
#: A column is probably meant where its name is as similar as this, 0 to 1.
_LEAST_SIMILARITY = 0.7
#: Most columns that a sentence lists.
_LISTED = 30
#: Most letters of a name in a sentence.
_SHOWN = 40
#: Beginning of the name of an empty column, followed by the names of the sensor.
ORIGIN = 'recorded_from?'
#: Name of the empty column of a recording from which drift was removed.
COMPENSATED = 'compensated_by_wrist_ft_comp'


class Columns(Protocol):
    """Columns of equal length by name; NaN where a channel has no sample at a stamp."""

    def keys(self) -> Iterable[Any]:
        """Give the names."""

    def __getitem__(self, name: str, /) -> Any:
        """Give what numpy makes an array of."""


def channel_of(column: str) -> str:
    """Name the channel that a column holds, in whatever unit; empty where it is none."""
    thermometer = _THERMOMETER.fullmatch(column)
    return f'{thermometer[1]}c' if thermometer else column if column in _CHANNELS else ''


def in_channel_unit(column: str, values: FloatArray) -> FloatArray:
    """Convert the values of a channel's column from the unit in its name to the channel's."""
    thermometer = _THERMOMETER.fullmatch(column)
    return to_celsius(values, thermometer[2].upper()) if thermometer else values


def channels_in(source: str, columns: Sequence[str]) -> dict[str, str]:
    """Find the column of every channel; RecordingError where two columns hold the same."""
    found: dict[str, str] = {}
    for column in columns:
        name = channel_of(column) or column
        if name in found and (channel_of(column) or column in STAMPS):
            same = 'twice' if found[name] == column else f'and {found[name]}, which is the same'
            raise RecordingError(f'{source} has the column {column} {same}; remove or rename one.')
        found[name] = column
    return {name: column for name, column in found.items() if channel_of(name)}


def require_column(source: str, columns: Sequence[str], kind: str, names: Iterable[str]) -> None:
    """Refuse columns without any of these names, and guess which one may be meant."""
    names = list(names)
    if {channel_of(column) or column for column in columns} & set(names):
        return
    meant = {column: name for column, name in meant_columns(columns).items() if name in names}
    guesses = [f'Is {c[:_SHOWN]!r} meant to be {n!r}{_unit(n)}?' for c, n in meant.items()]
    example = _example_map(columns)
    remedy = (
        f"Say what the columns of a file are, such as --columns '{example}', or rename them; each "
        'with its values in that unit.'
        if example
        else 'Add the column, or rename it; none of , : * = may be in its name.'
    )
    raise RecordingError(
        f'{source} has no {kind} column; expected {" or ".join(names)}, got '
        f'{_listed(columns)}. {" ".join([*guesses, remedy])}'
    )


def _example_map(columns: Sequence[str]) -> str:
    """Write a map of what is missing, by what columns may be, else by whichever is left."""
    meant = {c: name for c, name in meant_columns(columns).items() if not MAP_SIGNS.search(c)}
    free = [column for column, name in meant.items() if not name]
    found = {name: column for column, name in meant.items() if name}
    known = {channel_of(column) or column for column in columns} | found.keys()
    for name, others in (('stamp_s', STAMPS), ('force_z', AXES), ('temperature_c', ())):
        if known.isdisjoint((name, *others)):
            if not free:
                return ''
            found[name] = free.pop(0)
    entries = (f'{name.replace("stamp_s", "stamp")}={column}' for name, column in found.items())
    return ','.join(islice(entries, _LISTED))


def stamp_column(source: str, columns: Sequence[str], *, whole_times: bool = False) -> str:
    """Find the column of stamps; RecordingError without one, or with nanoseconds of no seconds."""
    require_column(source, columns, 'stamp', STAMPS)
    stamp = next(column for column in STAMPS if column in columns)
    if STAMP_NANOSEC in columns and (stamp != 'stamp_s' or whole_times):
        raise RecordingError(
            f'{source} has nanoseconds beside stamps that are not in seconds; leave '
            f'{STAMP_NANOSEC} out, or give the seconds as stamp.'
        )
    return stamp


def require_channels(source: str, columns: Sequence[str]) -> None:
    """Refuse a table without a raw wrench or a temperature."""
    require_column(source, columns, 'raw wrench', AXES)
    require_column(source, columns, 'temperature', ('temperature_c',))


def unknown_columns(source: str, columns: Sequence[str]) -> list[str]:
    """Warn, in one sentence, of columns that are not understood, and guess what they are."""
    meant = meant_columns(columns)
    if not meant:
        return []
    guesses = [f' Is {c[:_SHOWN]} meant to be {n}{_unit(n)}?' for c, n in meant.items() if n]
    remedy = ' Then name it so, or in --columns, with its values in that unit.' if guesses else ''
    sentence = f'{source} has columns that are not understood and not used: {_listed([*meant])}.'
    return [f'{sentence}{"".join(guesses[:_LISTED])}{remedy}']


def meant_columns(columns: Sequence[str]) -> dict[str, str]:
    """Find the columns that are not understood, and which missing one they may be, or ''."""
    used = {channel_of(column) or column for column in columns}
    absent = [name for name in _CHANNELS if name not in used]
    absent += [] if used & set(STAMPS) else ['stamp_s', STAMP_NANOSEC]
    thermometers = (name for j in range(100) if (name := temperature_channel(j)) not in used)
    meant: dict[str, str] = {}
    for column in columns:
        known = column in {*STAMPS, STAMP_NANOSEC} or column.startswith((ORIGIN, COMPENSATED))
        if known or channel_of(column):
            continue
        plain = re.sub(r'[\[(].*|\W', '', column.lower())
        name = _meant(plain, absent)
        if may_be_temperature((plain,)) or _SHORT_TEMPERATURE.fullmatch(column.strip()):
            name = next(thermometers, '')
        elif name not in absent or plain.startswith('external_'):
            name = ''
        else:
            absent.remove(name)
        meant[column] = name
    return meant


def _meant(plain: str, absent: Sequence[str]) -> str:
    """Find the missing channel that a column may be, or ''; a reference only if it says so."""
    if _NANOSEC.fullmatch(plain):
        return STAMP_NANOSEC
    prefix = 'reference_' if _TRUE.search(plain) else ''
    plain = _TRUE.sub('', plain).strip('_')[-_SHOWN:]
    names = [n.removeprefix(prefix) for n in absent if n.startswith('reference_') == bool(prefix)]
    # Such as /ft/wrench/force/x, whatever stands before.
    ends = [name for name in names if plain.replace('_', '').endswith(name.replace('_', ''))]
    ends += ['stamp_s'] * plain.endswith(('timestamp', 'stampsec', 'stampsecs'))
    # A second force_z is like force_y, but of another axis.
    axis = plain.rstrip('0123456789')[-1:]
    alike = [n for n in names if axis not in 'xyz' or n[-2:-1] != '_' or n.endswith(axis)]
    near = difflib.get_close_matches(plain, alike, 1, _LEAST_SIMILARITY)
    name = _ALIASES.get(plain) or next(iter((*ends, *near)), '')
    return f'{prefix}{name}' if name else ''


def _listed(names: Sequence[str]) -> str:
    """Enumerate names for people, the first of many."""
    more = f' and {len(names) - _LISTED} more' if len(names) > _LISTED else ''
    return f'{", ".join(name[:_SHOWN] for name in names[:_LISTED])}{more}'


def _unit(name: str) -> str:
    """Say in which unit a column is, and how it is named in others."""
    if name in STAMPS:
        return f' (or {", ".join(STAMPS)})'
    thermometer = _THERMOMETER.fullmatch(name)
    if thermometer:
        return f' (or {thermometer[1]}k, {thermometer[1]}f)'
    return f' ({axis_unit(name.removeprefix("reference_"))})'


def channel_groups(channels: Iterable[str]) -> list[tuple[str, ...]]:
    """List channels that share samples: raw wrench, thermometers, reference, specific force."""
    channels = list(channels)
    groups = (
        tuple(axis for axis in AXES if axis in channels),
        *((channel,) for channel in channels if _THERMOMETER.fullmatch(channel)),
        tuple(channel for channel in REFERENCE_CHANNELS if channel in channels),
        tuple(channel for channel in FORCE_CHANNELS if channel in channels),
        (ROTATION_CHANNEL,) if ROTATION_CHANNEL in channels else (),
    )
    return [group for group in groups if group]


def samples_of(
    stamps_ns: IntArray, values: Mapping[str, FloatArray], filled: Mapping[str, BoolArray]
) -> Iterator[Samples]:
    """Make blocks of samples; a group of channels is split where a row holds a part of it."""
    for group in channel_groups(values):
        rows = np.stack([filled[channel] for channel in group])
        together = (rows == rows[0]).all()
        for channels in [group] if together else [(channel,) for channel in group]:
            at = filled[channels[0]]
            block = np.stack([values[channel][at] for channel in channels], 1)
            yield Samples(channels, stamps_ns[at], block)


def recording_from_columns(
    *tables: Columns, name: str = 'table', period_s: float = 1.0, max_bad_share: float = 0.01
) -> Recording:
    """
    Make a recording of columns in memory, as read_recording does of a CSV file.

    A table is a mapping of names to arrays, or a DataFrame. It has a column ``stamp_s``,
    ``stamp_ms``, ``stamp_us`` or ``stamp_ns`` (whole ns, or datetime64), ascending, and any
    channels (N, N m, °C, or as ``temperature_k`` says); NaN is no sample. Channels of different
    rates may come in several tables. Messages and reports use ``name``; cells last ``period_s``.
    The recording's warnings say what was left out. RecordingError when a table cannot be read,
    when more than ``max_bad_share`` of a channel cannot be used, or when a channel is missing.
    """
    blocks: list[Samples] = []
    names: list[str] = []
    for table in tables:
        stamps_ns, values = _read(table, name)
        filled = {channel: ~np.isnan(column) for channel, column in values.items()}
        blocks += samples_of(stamps_ns, values, filled)
        names += [column for column in map(str, table.keys()) if column not in STAMPS]
    require_channels(name, names)
    channels_in(name, names)
    recording = grid_samples(blocks, name=name, period_s=period_s, max_bad_share=max_bad_share)
    unknown = unknown_columns(name, [*STAMPS, *names])
    return replace(recording, warnings=(*recording.warnings, *unknown))


def compensate(
    model: DriftModel, table: Columns, *others: Columns, tare_s: float = 0.0
) -> dict[str, FloatArray]:
    """
    Remove the drift from the wrench of a table, as the command ``compensate`` does from a file.

    Tables are as for recording_from_columns. Gives the compensated axes of the first one, N and
    N m, tared on its first ``tare_s`` seconds, which must be unloaded; 0 gives no tare.
    RecordingError as there, or when the thermometers are not those of the model.
    """
    recording = recording_from_columns(table, *others, period_s=model.period_ns / NANOSECONDS)
    stamps_ns, values = _read(table, recording.name)
    absent = np.full(len(stamps_ns), np.nan)
    raw = np.stack([values.get(axis, absent) for axis in AXES], axis=1)
    tare = initial_tare(model, recording, tare_s)
    corrected = correct_many(track_drift(model, recording), stamps_ns, raw, tare)
    return {axis: corrected[:, i] for i, axis in enumerate(AXES) if axis in values}


def _read(table: Columns, name: str) -> tuple[IntArray, dict[str, FloatArray]]:
    """Take stamps, ns, and the channels out of a table, all of shape (n,)."""
    columns = list(map(str, table.keys()))
    stamp = stamp_column(name, columns)
    stamps = np.asarray(table[stamp])
    is_date = stamps.dtype.kind == 'M'
    if not is_date and (stamp != 'stamp_ns' or stamps.dtype.kind not in 'iu'):
        stamps = np.rint(_numbers(stamps, stamp, name, (stamps.size,)) * STAMPS[stamp])
    if stamps.ndim != 1 or not np.isfinite(stamps).all():
        raise RecordingError(
            f'{stamp} of {name} must be one time per row; leave out rows without it.'
        )
    if STAMP_NANOSEC in columns:
        stamps = stamps + _numbers(table[STAMP_NANOSEC], STAMP_NANOSEC, name, stamps.shape)
    stamps = stamps.astype('datetime64[ns]') if is_date else stamps
    return stamps.astype(np.int64), {
        channel: in_channel_unit(column, _numbers(table[column], column, name, stamps.shape))
        for channel, column in channels_in(name, columns).items()
    }


def _numbers(column: Any, channel: str, name: str, shape: tuple[int, ...]) -> FloatArray:
    """Turn a column into numbers of a given shape."""
    try:
        values = np.asarray(column, dtype=float)
    except (TypeError, ValueError) as error:
        raise RecordingError(f'{channel} of {name} must hold numbers: {error}.') from error
    if values.shape != shape:
        raise RecordingError(
            f'{channel} of {name} must have shape {shape}, as its stamps; got {values.shape}.'
        )
    return values
