"""What a careful engineer would fit to means of ten seconds: from days to a predictor."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import NamedTuple

from judging import block_means, BLOCK_S, tared
import numpy as np
from scipy.signal import lfilter

from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray, IntArray

#: Time constants of the bank, s.
BANK_S = (0.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)
#: Strengths of a ridge that are tried, and that of least squares, of the normal matrix's diagonal.
STRENGTHS = tuple(10.0**power for power in np.arange(-8.0, 0.5, 0.5).tolist())
LEAST_STRENGTH = 1e-12


@dataclass(frozen=True, eq=False)
class Day:
    """Means of ten seconds: temperature (M, J) in °C, drift and load (M, 6), every period_s."""

    temperature_c: FloatArray
    drift: FloatArray
    load: FloatArray
    period_s: float


#: Predicts the drift of a day's six axes, shape (M, 6), from other days.
Peer = Callable[[Sequence[Day], Day], FloatArray]
#: Columns (M, p) that describe a day, and the degree of each.
Features = Callable[[Day], tuple[FloatArray, IntArray]]


def day_of(recording: Recording) -> Day:
    """Average a recording."""
    cells, load = max(1, round(BLOCK_S / recording.period_s)), recording.reference
    parts = recording.temperature_c, recording.wrench - load, load
    temperature_c, drift, load = (block_means(part, cells) for part in parts)
    return Day(temperature_c, drift, load, cells * recording.period_s)


def bank(
    degree: int, taus_s: Sequence[float], day: Day, thermometers: int | None = None
) -> tuple[FloatArray, IntArray]:
    """Powers of all temperatures, each behind relaxations that start from rest."""
    theta = (day.temperature_c[:, :thermometers] - 25.0) / 10.0
    powers = np.concatenate([theta**power for power in range(1, degree + 1)], axis=1)
    columns = []
    for tau_s in taus_s:
        pole = np.exp(-day.period_s / tau_s) if tau_s else 0.0
        columns.append(lfilter([1 - pole], [1, -pole], powers, axis=0, zi=pole * powers[:1])[0])
    degrees = np.repeat(np.arange(1, degree + 1), theta.shape[1])
    return np.concatenate(columns, axis=1), np.tile(degrees, len(taus_s))


def design(features: Features, day: Day, axis: int) -> FloatArray:
    """Columns for zero drift and, where there are loads, for gain drift."""
    columns, degrees = features(day)
    load = day.load[:, axis]
    if not np.nanstd(load) > 0:
        return columns
    first = columns[:, degrees == 1]
    times = load[:, None] * np.concatenate((np.ones((len(load), 1)), first), axis=1)
    return np.concatenate((columns, times), axis=1)


def parts(days: Sequence[Day]) -> list[Day]:
    """Leave days out, or thirds of a single one."""
    if len(days) > 1:
        return list(days)
    (day,) = days
    edges = np.linspace(0, len(day.drift), 4).astype(int)
    return [
        Day(day.temperature_c[a:b], day.drift[a:b], day.load[a:b], day.period_s)
        for a, b in pairwise(edges)
    ]


class Piece(NamedTuple):
    """Columns (M, p) and drift (M,) of an axis in one part of the days, where it was measured."""

    columns: FloatArray
    drift: FloatArray
    period_s: float


def pieces_of(features: Features, days: Sequence[Day], axis: int) -> list[Piece]:
    """Describe an axis of days."""
    measured = [np.isfinite(day.drift[:, axis]) for day in days]
    return [
        Piece(design(features, day, axis)[rows], day.drift[rows, axis], day.period_s)
        for day, rows in zip(days, measured, strict=True)
    ]


def solved(pieces: Sequence[Piece], strength: float) -> FloatArray:
    """Solve ridge with an offset per piece, its strength relative to the normal matrix."""
    x = np.concatenate([piece.columns - piece.columns.mean(axis=0) for piece in pieces])
    y = np.concatenate([piece.drift - piece.drift.mean() for piece in pieces])
    normal = x.T @ x
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(size, size) + strength * np.eye(len(size))
    return np.asarray(np.linalg.solve(scaled, x.T @ y / size) / size)


def held_out(pieces: Sequence[Piece], strength: float) -> float:
    """Tared error of parts that were left out."""
    errors = []
    for out in pieces:
        gains = solved([other for other in pieces if other is not out], strength)
        errors.append(tared((out.drift - out.columns @ gains)[:, None], out.period_s))
    return float(np.std(np.concatenate(errors)))


def axes_of(days: Sequence[Day]) -> list[int]:
    """List the numbers of the axes that were recorded."""
    return [axis for axis in range(6) if np.isfinite(days[0].drift[:, axis]).any()]


def ridge(
    candidates: Sequence[Features], strengths: Sequence[float], days: Sequence[Day], judged: Day
) -> FloatArray:
    """Fit by ridge; leaving recordings out chooses features and strength where there are some."""
    result = np.zeros_like(judged.drift)
    for axis in axes_of(days):
        best, least = (candidates[0], strengths[0]), np.inf
        for features in candidates if len(strengths) > 1 else ():
            pieces = pieces_of(features, parts(days), axis)
            for strength in strengths:
                if (error := held_out(pieces, strength)) < least:
                    best, least = (features, strength), error
        gains = solved(pieces_of(best[0], days, axis), best[1])
        result[:, axis] = design(best[0], judged, axis) @ gains
    return result


PEERS: dict[str, Peer] = {
    **{
        name: partial(ridge, [partial(bank, degree, (0.0,), thermometers=1)], (LEAST_STRENGTH,))
        for name, degree in (('line', 1), ('cubic', 3))
    },
    'ridge bank': partial(ridge, [partial(bank, degree, BANK_S) for degree in (1, 2)], STRENGTHS),
}
