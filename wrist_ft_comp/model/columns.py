"""
Tables of named columns: which channels they hold, and a recording made of ones in memory.

A table is what has ``keys`` and columns by name, a stamp and channels (``signals``): a dict of
arrays, or a pandas DataFrame.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
import difflib
import re
from typing import Any, Protocol

import numpy as np

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.model.batch_grid import grid_samples
from wrist_ft_comp.model.drift_model import DriftModel
from wrist_ft_comp.model.offline import correct_many, initial_tare, track_drift
from wrist_ft_comp.model.signals import (
    AXES,
    BoolArray,
    FloatArray,
    FORCE_CHANNELS,
    IntArray,
    NANOSECONDS,
    Recording,
    REFERENCE_CHANNELS,
    ROTATION_CHANNEL,
    Samples,
)

STAMPS = ('stamp_ns', 'stamp_s')
#: Beginning of the name of an empty column, which goes on with what the sensor is called.
ORIGIN = 'recorded_from?'
_THERMOMETER = re.compile(r'temperature(_([2-9]|[1-9]\d+))?_c')


class Columns(Protocol):
    """Columns of equal length by name; NaN where a channel has no sample at a stamp."""

    def keys(self) -> Iterable[Any]:
        """Give the names."""

    def __getitem__(self, name: str, /) -> Any:
        """Give what numpy makes an array of."""


def channel_groups(columns: Iterable[str]) -> list[tuple[str, ...]]:
    """List channels that share samples: raw wrench, thermometers, reference, specific force."""
    columns = list(columns)
    groups = (
        tuple(axis for axis in AXES if axis in columns),
        *((column,) for column in columns if _THERMOMETER.fullmatch(column)),
        tuple(channel for channel in REFERENCE_CHANNELS if channel in columns),
        tuple(channel for channel in FORCE_CHANNELS if channel in columns),
        (ROTATION_CHANNEL,) if ROTATION_CHANNEL in columns else (),
    )
    return [group for group in groups if group]


def require_column(source: str, columns: Sequence[str], kind: str, names: Sequence[str]) -> None:
    """Refuse when none of the named columns is there, suggesting one that looks like it."""
    if set(names) & set(columns):
        return
    near = [(c, difflib.get_close_matches(c.lower(), names, 1)) for c in columns]
    remedy = next((f'Is {c!r} meant to be {m[0]!r}? Rename it.' for c, m in near if m), '')
    raise RecordingError(
        f'{source} has no {kind} column; expected {" or ".join(names)}, got '
        f'{", ".join(columns)}. {remedy or "Rename or add the column."}'
    )


def require_channels(source: str, columns: Sequence[str]) -> None:
    """Refuse a table without a raw wrench or a temperature."""
    require_column(source, columns, 'raw wrench', AXES)
    require_column(source, columns, 'temperature', ('temperature_c',))


def mistyped_columns(source: str, columns: Iterable[str], used: Iterable[str]) -> list[str]:
    """Warn of columns that are not used but named almost like ones that would be."""
    used = set(used)
    known = {*AXES, *REFERENCE_CHANNELS, *FORCE_CHANNELS, ROTATION_CHANNEL}
    known = {*known, 'temperature_c', 'temperature_2_c'} - used
    return [
        f'The column {column} of {source} is not used; if it is {near}, rename it.'
        for column in columns
        if column not in used
        for near in difflib.get_close_matches(column.lower(), known, 1, 0.85)
    ]


def samples_of(
    groups: Iterable[tuple[str, ...]],
    stamps_ns: IntArray,
    values: Mapping[str, FloatArray],
    filled: Mapping[str, BoolArray],
) -> Iterator[Samples]:
    """Make blocks of a table's rows; a group that some rows fill in part comes one by one."""
    for group in groups:
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

    Parameters
    ----------
    *tables : mapping of str to array, or DataFrame
        Each with a column ``stamp_s`` (s) or ``stamp_ns`` (whole ns, or datetime64), ascending,
        and any channels (N, N m, °C); NaN is no sample. Channels of different rates may come in
        tables of their own.
    name : str
        What messages and reports call it.
    period_s : float
        Length of a thermal cell, s.
    max_bad_share : float
        Largest share of unusable samples per channel, 0 to 1.

    Returns
    -------
    Recording
        Its warnings say what was left out.

    Raises
    ------
    RecordingError
        When a table cannot be read, or they do not hold what a recording must.

    """
    blocks: list[Samples] = []
    names: list[str] = []
    for table in tables:
        stamps_ns, values = _read(table, name)
        filled = {channel: ~np.isnan(column) for channel, column in values.items()}
        blocks += samples_of(channel_groups(values), stamps_ns, values, filled)
        names += [each for each in map(str, table.keys()) if each not in STAMPS]
    require_channels(name, names)
    if twice := sorted({each for each in names if names.count(each) > 1}):
        raise RecordingError(f'{name} has the column {twice[0]} twice; remove or rename one.')
    recording = grid_samples(blocks, name=name, period_s=period_s, max_bad_share=max_bad_share)
    used = {channel for group in channel_groups(names) for channel in group}
    warnings = mistyped_columns(name, names, used)
    return replace(recording, warnings=(*recording.warnings, *warnings))


def compensate(
    model: DriftModel, table: Columns, *others: Columns, tare_s: float = 0.0
) -> dict[str, FloatArray]:
    """
    Remove the drift from the wrench of a table, as the command ``compensate`` does from a file.

    Parameters
    ----------
    model : DriftModel
        The model.
    table, *others : mapping of str to array, or DataFrame
        As for recording_from_columns; the wrench of the first one is compensated.
    tare_s : float
        Tare on the first seconds, which must be unloaded, s; 0 gives no tare.

    Returns
    -------
    dict of str to ndarray
        Compensated columns, N and N m, by axis; those that the first table holds.

    Raises
    ------
    RecordingError
        As recording_from_columns, or when the thermometers are not those of the model.

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
    require_column(name, columns, 'stamp', STAMPS)
    stamp = next(column for column in STAMPS if column in columns)
    stamps = np.asarray(table[stamp])
    is_date = stamps.dtype.kind == 'M'
    if not is_date and (stamp == 'stamp_s' or stamps.dtype.kind not in 'iu'):
        scale = NANOSECONDS if stamp == 'stamp_s' else 1
        stamps = np.rint(_numbers(stamps, stamp, name, (stamps.size,)) * scale)
    if stamps.ndim != 1 or not np.isfinite(stamps).all():
        raise RecordingError(
            f'{stamp} of {name} must be one time per row; leave out rows without it.'
        )
    stamps = stamps.astype('datetime64[ns]') if is_date else stamps
    channels = [channel for group in channel_groups(columns) for channel in group]
    return stamps.astype(np.int64), {
        channel: _numbers(table[channel], channel, name, stamps.shape) for channel in channels
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
