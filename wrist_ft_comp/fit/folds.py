"""Which stretches are held out in turn, what models leave of them, and which is good by that."""

from collections.abc import Sequence

import numpy as np

from wrist_ft_comp.drift.drift_model import DriftModel, LEAST_RANGE_K
from wrist_ft_comp.fit import axis_data
from wrist_ft_comp.fit.axis_data import AxisData, BINS_PER_FOLD, FOLDS
from wrist_ft_comp.fit.chamber_test import find_plateaus, MOST_PLATEAUS
from wrist_ft_comp.fit.result import HeldOut
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS

#: A candidate has to lower the mean square error by this share to be worth its complexity.
WORTHWHILE = 0.15
#: Days are apart that have less than this share of their temperatures in common.
_SHARED = 0.5
#: What is left of a held-out fold is counted from its first minute, as people tare, s.
_TARE_S = 60.0


def assign_folds(recordings: Sequence[Recording]) -> list[IntArray]:
    """Assign each cell, (N_i,), to a fold: recordings, plateaus, or else stretches of one."""
    if len(recordings) > 1:
        return [np.full(len(recording), i) for i, recording in enumerate(recordings)]
    if (plateaus := find_plateaus(recordings)) is not None:
        return [plateaus]
    # Half by time, half by kelvin: by time alone the first third of a warm-up holds nearly all of
    # its drift, and nothing that is learnt without it can tell whether it would hold there.
    temperature_c = recordings[0].temperature_c
    cells = np.arange(len(temperature_c))
    blocks = np.array_split(cells, min(len(cells), FOLDS * BINS_PER_FOLD))
    # Means, because noise would go far, too; and the ends, where most happens.
    parts = [cells[:1], *blocks, cells[-1:]]
    means_c = np.array([temperature_c[part].mean(axis=0) for part in parts])
    travel_k = np.cumsum(np.abs(np.diff(means_c, axis=0, prepend=means_c[:1])).sum(axis=1))
    travelled_k = np.interp(cells, [part.mean() for part in parts], travel_k)
    passed = (cells / len(cells) + travelled_k / (travel_k[-1] or 1.0)) / 2
    # Folds end at whole bins, so that no bin holds samples of two folds.
    width = axis_data.bin_cells(len(cells), recordings[0].period_s)
    return [np.floor(passed[cells // width * width] * FOLDS).astype(int)]


def folds_within(recordings: Sequence[Recording]) -> list[IntArray] | None:
    """
    Assign cells, (N_i,), to stretches of each recording, where all are apart; None elsewhere.

    Days in halls so cold, and hot, that each shares less than _SHARED of its temperatures with any
    other are no measure of each other. Each has to be long enough for stretches, and to warm.
    """
    low_c, high_c = (
        np.array([edge(recording.temperature_c, axis=0) for recording in recordings])
        for edge in (np.min, np.max)
    )
    leading = np.argmax(high_c.max(axis=0) - low_c.min(axis=0))
    low_c, high_c = low_c[:, leading], high_c[:, leading]
    shared_k = np.minimum.outer(high_c, high_c) - np.maximum.outer(low_c, low_c)
    np.fill_diagonal(shared_k, -np.inf)
    is_apart = shared_k.max(axis=0) < _SHARED * (high_c - low_c)
    lengths = list(map(len, recordings))
    is_short = FOLDS * min(lengths) < max(lengths) or (high_c - low_c).min() < LEAST_RANGE_K
    if len(recordings) < 2 or not is_apart.all() or is_short:
        return None
    return [assign_folds([one])[0] + i * MOST_PLATEAUS for i, one in enumerate(recordings)]


def averaged_cells(period_s: float) -> int:
    """Count the thermal cells of the means that limits are stated of, and days are judged by."""
    return max(1, round(axis_data.BIN_S / period_s))


def averaged_s(model: DriftModel) -> float:
    """Compute how long these means last, s."""
    period_s = model.period_ns / NANOSECONDS
    return averaged_cells(period_s) * period_s


def fold_means(
    data: AxisData, recording: int, fold: int, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """
    Average what is left of a recording, (N_i,), over the bins of one of its folds.

    Gives mean numbers of the cells, (n,), and means, (n,), tared, or counted from the other
    plateaus.
    """
    inside, finite = data.folds[recording] == fold, np.isfinite(values)
    numbered = np.stack((np.arange(len(values)), values), axis=1)
    numbered[~(inside & finite)] = np.nan
    both = mean_over(numbered, data.bin_cells)
    cells, means = both[np.isfinite(both[:, 0])].T
    if data.tared:
        segments = np.searchsorted(sorted(data.steps[recording]), cells, 'right')
        return cells, tare(means, segments, data.bin_s)
    return cells, means - values[~inside & finite].mean()


def tare(values: FloatArray, segments: IntArray, period_s: float) -> FloatArray:
    """
    Zero what is left of a held-out fold, (n, …), on the first minute of each segment, (n,).

    So do people at a start, and after each step of the zero.
    """
    tared, first = values.copy(), max(1, round(_TARE_S / period_s))
    for number in np.unique(segments):
        inside = segments == number
        tared[inside] -= values[inside][:first].mean(axis=0)
    return tared


def tared_means(values: FloatArray, cells: int, period_s: float) -> FloatArray:
    """Average a recording, (N,), over bins of cells, where it is finite, and tare it: (n,)."""
    means = mean_over(values, cells)
    means = means[np.isfinite(means)]
    return tare(means, np.zeros(len(means), dtype=int), cells * period_s)


def mean_over(values: FloatArray, cells: int) -> FloatArray:
    """Average values by cell, (N, …), over stretches of cells, the last one may be shorter."""
    starts = np.arange(0, len(values), cells)
    filled = np.isfinite(values)
    sums = np.add.reduceat(np.where(filled, values, 0.0), starts, axis=0)
    counts = np.add.reduceat(filled, starts, axis=0, dtype=np.int64)
    return np.asarray(np.divide(sums, counts, out=np.full(sums.shape, np.nan), where=counts > 0))


def hold_out(data: AxisData, cells: Sequence[FloatArray], errors: FloatArray) -> HeldOut:
    """Say where errors, (n, C), of all folds in order were made: mean numbers of cells by fold."""
    recording, fold = np.repeat(data.folds_by_recording, [*map(len, cells)], axis=0).T
    return HeldOut(recording, fold, np.concatenate(cells), errors, data.bin_s, data.tared)


def simplest_good(squares: Sequence[float]) -> int:
    """Find the simplest candidate within 15 % of the best by mean squares, the simplest first."""
    best = min(squares)
    return next(i for i, square in enumerate(squares) if square - best <= WORTHWHILE * square)
