"""
Which stretches of recordings are held out in turn, and what a candidate leaves of them.

A candidate is scored on folds that it did not see, in free run, on means over bins.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.fit.axis_data import (
    AxisData,
    bin_cells,
    BINS_PER_FOLD,
    find_plateaus,
    FITTED_BIN_S,
    FOLDS,
)
from wrist_ft_comp.fit.result import HeldOut
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS

#: What is left of a held-out fold is counted from its first minute, as people tare, s.
_TARE_S = 60.0
#: Parts that each held-out fold is scored in: two recordings alone cannot tell chance from merit.
JUDGED_PARTS = 4
#: A candidate has to lower the mean square error by this share to be worth its complexity.
WORTHWHILE = 0.15


def assign_folds(recordings: Sequence[Recording]) -> list[IntArray]:
    """Assign each cell, (N_i,), to a fold: recordings, plateaus, or else stretches of one."""
    if len(recordings) > 1:
        return [np.full(len(recording), i) for i, recording in enumerate(recordings)]
    plateaus = find_plateaus(recordings)
    if plateaus is not None:
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
    # Folds end at whole bins, so that no bin that is judged holds samples of two folds.
    width = bin_cells(len(cells), recordings[0].period_s)[1]
    return [np.floor(passed[cells // width * width] * FOLDS).astype(int)]


def averaged_cells(period_s: float) -> int:
    """Count the thermal cells of the means that limits are stated of, and days are judged by."""
    return max(1, round(FITTED_BIN_S / period_s))


def averaged_s(model: DriftModel) -> float:
    """Compute how long these means last, s."""
    period_s = model.period_ns / NANOSECONDS
    return averaged_cells(period_s) * period_s


class FoldBins(NamedTuple):
    """Errors of a recording in a held-out fold, tared, in bins."""

    recording: int
    fold: int
    #: Mean number of each bin's cells, and the errors that are stated, shapes (n,).
    cells: FloatArray
    errors: FloatArray
    #: Means over the longer bins that candidates compete on, shape (m,).
    judged: FloatArray


#: A model, None for "no compensation", and what had to be mended, in sentences.
Fitted = tuple[AxisModel | None, tuple[str, ...]]
#: Fits an axis, of which a fold may be held out.
Refit = Callable[[AxisData], Fitted]


def refit_bins(data: AxisData, refit: Refit) -> list[FoldBins]:
    """Refit a model without each fold in turn, and keep its errors there."""
    return [
        bins
        for fold in data.fold_numbers
        for bins in fold_bins(data, unexplained(data, refit(data.without(fold))[0]), fold)
    ]


def unexplained(data: AxisData, model: AxisModel | None) -> list[FloatArray]:
    """Subtract a model's free run from r - w, (N_i,), up to the constant of each recording."""
    if model is None:
        return list(data.residual)
    remainders = []
    for i, temperature_c in enumerate(data.temperature_c):
        _, drift = model.run(model.start(temperature_c[0]), temperature_c)
        explained = drift[:, 0]
        if data.load is not None and drift.shape[1] > 1:
            explained = explained + drift[:, 1] * data.load[i]
        remainders.append(data.residual[i] - explained)
    return remainders


def fold_bins(data: AxisData, remainders: Sequence[FloatArray], fold: int) -> list[FoldBins]:
    """Average what is left in a fold over bins, tared, or counted from the other plateaus."""
    bins = []
    for i, (folds, values) in enumerate(zip(data.folds, remainders, strict=True)):
        finite = np.isfinite(values)
        rows = np.flatnonzero((folds == fold) & finite)
        if len(rows):
            cells = bin_means(rows.astype(float), rows, data.bin_cells[0])
            means = [(bin_means(values[rows], rows, width), width) for width in data.bin_cells]
            if data.tared:
                errors = [tare(inside, width * data.period_s) for inside, width in means]
            else:
                others = values[(folds != fold) & finite].mean()
                errors = [inside - others for inside, _ in means]
            bins.append(FoldBins(i, fold, cells, *errors))
    return bins


def tare(values: FloatArray, period_s: float) -> FloatArray:
    """Zero what is left of a held-out fold, (n, …), on its first minute, as people do."""
    return np.asarray(values - values[: max(1, round(_TARE_S / period_s))].mean(axis=0))


def bin_means(values: FloatArray, cells: IntArray, bin_cells: int) -> FloatArray:
    """Average samples, (n, …), over bins of consecutive cells, whose numbers, (n,), increase."""
    if bin_cells <= 1:
        return values
    bins = cells // bin_cells
    starts = np.flatnonzero(np.diff(bins, prepend=bins[0] - 1))
    counts = np.diff(starts, append=len(bins))
    sums = np.add.reduceat(values, starts, axis=0)
    return np.asarray(sums / counts.reshape(-1, *[1] * (values.ndim - 1)))


def part_errors(bins: Sequence[FoldBins]) -> FloatArray:
    """Score every fold in parts: mean squares, shape (parts,)."""
    return np.array(
        [
            part.mean()
            for fold in bins
            for part in np.array_split(fold.judged**2, min(JUDGED_PARTS, len(fold.judged)))
        ]
    )


def simplest_good(errors: Sequence[FloatArray]) -> int:
    """
    Find the simplest candidate within one standard error of the best, or within 15 % of it.

    The standard error is that of the difference to the best, part by part: parts differ far more
    than candidates do. Mean square errors have shape (parts,), the simplest candidate's first.
    """
    means = [float(error.mean()) for error in errors]
    best = int(np.argmin(means))
    for position, error in enumerate(errors):
        differences, standard_error = error - errors[best], 0.0
        if len(error) > 1:
            standard_error = float(differences.std(ddof=1)) / np.sqrt(len(error))
        margin = max(standard_error, WORTHWHILE * means[position])
        if means[position] - means[best] <= margin:
            return position
    return best


def hold_out(
    rows: Sequence[tuple[int, int, FloatArray, FloatArray, FloatArray]],
    bin_s: float,
    *,
    tared: bool,
) -> HeldOut:
    """Keep in time order: recording, fold, cells, and errors without compensation and with it."""
    table = np.concatenate([np.stack(np.broadcast_arrays(*row)) for row in rows], axis=1)
    numbers, fold, cell, before, after = table[:, np.lexsort((table[2], table[0]))]
    return HeldOut(
        numbers.astype(np.int64), fold.astype(np.int64), cell, before, after, bin_s, tared
    )
