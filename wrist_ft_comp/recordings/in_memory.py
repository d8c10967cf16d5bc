"""Tables in memory: a recording made of arrays or data frames, and their drift removed."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recording import Recording, Samples
from wrist_ft_comp.recordings.column_map import (
    Column,
    ColumnMap,
    KINDS,
    Placed,
    samples_of,
    STAMP,
    STAMP_NANOSEC,
    TIME_UNITS_NS,
)
from wrist_ft_comp.recordings.log_proposal import refuse_missing, warn_of_unused
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.stream.batch_grid import grid_samples
from wrist_ft_comp.stream.offline import correct_many, initial_tare, track_drift


class Columns(Protocol):
    """Columns of equal length by name; NaN where a channel has no sample at a stamp."""

    def keys(self) -> Iterable[Any]:
        """Give the names."""

    def __getitem__(self, name: str, /) -> Any:
        """Give what numpy makes an array of."""


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
        placed, stamps_ns, values = _read(table, name)
        blocks += samples_of(stamps_ns, values)
        stamps = {column.name for column in placed.stamps} if names else ()
        names += [column for column in placed.names if column not in stamps]
    placed = ColumnMap().place(name, names)
    if lacking := placed.lacks(list(KINDS)):
        refuse_missing(placed, lacking)
    recording = grid_samples(blocks, name=name, period_s=period_s, max_bad_share=max_bad_share)
    return replace(recording, warnings=(*recording.warnings, *warn_of_unused(placed)))


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
    _, stamps_ns, values = _read(table, recording.name)
    absent = np.full(len(stamps_ns), np.nan)
    raw = np.stack([values.get(axis, absent) for axis in AXES], axis=1)
    tare = initial_tare(model, recording, tare_s)
    corrected = correct_many(track_drift(model, recording), stamps_ns, raw, tare)
    return {axis: corrected[:, i] for i, axis in enumerate(AXES) if axis in values}


def _read(table: Columns, name: str) -> tuple[Placed, IntArray, dict[str, FloatArray]]:
    """Take stamps, ns, and the channels out of a table, all of shape (n,)."""
    placed = ColumnMap().place(name, list(map(str, table.keys())))
    if lacking := placed.lacks(['stamp']):
        refuse_missing(placed, lacking)
    stamp = placed.columns[STAMP]
    stamps = np.asarray(table[stamp.name])
    is_date = stamps.dtype.kind == 'M'
    if not is_date and (stamp.unit != 'ns' or stamps.dtype.kind not in 'iu'):
        stamps = np.rint(_numbers(table, stamp, name, (stamps.size,)) * TIME_UNITS_NS[stamp.unit])
    if stamps.ndim != 1 or not np.isfinite(stamps).all():
        raise RecordingError(
            f'{stamp.name} of {name} must be one time per row; leave out rows without it.'
        )
    stamps_ns = (stamps.astype('datetime64[ns]') if is_date else stamps).astype(np.int64)
    if STAMP_NANOSEC in placed.columns:
        more = _numbers(table, placed.columns[STAMP_NANOSEC], name, stamps.shape)
        stamps_ns = stamps_ns + more.astype(np.int64)
    return (
        placed,
        stamps_ns,
        {
            column.channel: column.to_channel(_numbers(table, column, name, stamps.shape))
            for column in placed.channels
        },
    )


def _numbers(table: Columns, column: Column, name: str, shape: tuple[int, ...]) -> FloatArray:
    """Turn a column into numbers of a given shape."""
    try:
        values = np.asarray(table[column.name], dtype=float)
    except (TypeError, ValueError) as error:
        raise RecordingError(f'{column.name} of {name} must hold numbers: {error}.') from error
    if values.shape != shape:
        raise RecordingError(
            f'{column.name} of {name} must have shape {shape}, as its stamps; got {values.shape}.'
        )
    return values
