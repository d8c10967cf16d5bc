"""
Where a candidate is scored: on folds that it did not see, in free run, averaged over bins.

Free relaxations are fitted from sums (``cross_validate``), the paper's methods by refitting and
running (``refit_bins``); ``auto`` scores all pairs of candidates at once, on its own.
``part_errors`` sums errors up, ``simplest_good`` compares the sums, and ``hold_out`` keeps the
winner's errors for pictures.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.calibration.result import HeldOut
from wrist_ft_comp.identification.axis_data import AxisData
from wrist_ft_comp.identification.bins import bin_axis_data, BinnedData, Sums, tare
from wrist_ft_comp.identification.moments import accumulate, bank_inputs, Moments
from wrist_ft_comp.identification.regression import best_on_grid, least_squares, Structure
from wrist_ft_comp.identification.time_constants import search_time_constants
from wrist_ft_comp.model.axis_model import AxisModel
from wrist_ft_comp.model.features import Features
from wrist_ft_comp.model.signals import FloatArray, IntArray

#: Nearer to its optimum, a candidate's errors change by far less than they differ from others'.
_TOLERANCE = 1e-5
#: Parts that each held-out fold is scored in: two recordings alone cannot tell chance from merit.
JUDGED_PARTS = 4
#: A candidate has to lower the mean square error by this share to be worth its complexity.
WORTHWHILE = 0.15
#: Time constants from which a search begins, s.
_GRID_POINTS, _SHORTEST_TAU_S, _LONGEST_TAU_S = 13, 20.0, 7200.0


@dataclass(frozen=True, eq=False)
class CandidateData:
    """What all candidates of an axis are fitted from and scored on."""

    # Features are those of one relaxation's temperatures, of the highest degree; moments hold all
    # of them behind a grid of time constants.

    axis_data: AxisData
    features: Features
    fitted: BinnedData
    judged: BinnedData
    fitted_moments: Moments

    def inputs(self, structure: Structure) -> int:
        """Count the features of a structure: powers up to its degree, or all hats."""
        return len(self.features_of(structure).names)

    def features_of(self, structure: Structure) -> Features:
        """Features of one relaxation's temperatures."""
        if self.features.kind == 'hats':
            return self.features
        return replace(self.features, degree=structure.degree)


def build_candidate_data(data: AxisData, features: Features) -> CandidateData:
    """Pass the temperatures through the grid of time constants, and sum."""
    grid = time_constant_grid(data)
    fitted_cells, judged_cells = data.bin_cells
    fitted = bin_axis_data(data, fitted_cells)
    judged = bin_axis_data(data, judged_cells, means=True)
    moments = accumulate(fitted, bank_inputs(fitted, features, grid), grid)
    return CandidateData(data, features, fitted, judged, moments)


def time_constant_grid(data: AxisData) -> FloatArray:
    """Lay out the time constants that are tried: 0 (static), then evenly in their logarithm, s."""
    low = max(_SHORTEST_TAU_S, 2 * data.period_s)
    high = max(min(_LONGEST_TAU_S, data.longest_s / 2), 2 * low)
    return np.concatenate(([0.0], np.geomspace(low, high, _GRID_POINTS)))


class FoldBins(NamedTuple):
    """Bins of a recording in a held-out fold: cell numbers and tared errors, (n,)."""

    recording: int
    fold: int
    cells: FloatArray
    errors: FloatArray


@dataclass(frozen=True, eq=False)
class CvScore:
    """How a candidate did on held-out folds; its time constants fitted to all, (K,), s."""

    structure: Structure
    bins: list[FoldBins]
    time_constants_s: FloatArray


#: Fits an axis, of which a fold may be held out: a model or None, and what had to be mended.
Refit = Callable[[AxisData], tuple[AxisModel | None, tuple[str, ...]]]


def cross_validate(data: CandidateData, structure: Structure) -> CvScore:
    """Score a candidate on folds that it did not see."""
    moments, features = data.fitted_moments, data.features_of(structure)
    # All combinations on the grid were the starts; the best of them is followed.
    start_s = best_on_grid(moments, structure, data.inputs(structure))
    tau_s = search_time_constants(data.fitted, features, start_s, _TOLERANCE)
    bins = [
        each
        for fold in np.unique(moments.fold).tolist()
        for each in _left_out_bins(data, features, tau_s, fold)
    ]
    return CvScore(structure, bins, tau_s)


def _left_out_bins(
    data: CandidateData, features: Features, start_s: FloatArray, fold: int
) -> list[FoldBins]:
    """Fit time constants and gains to all folds but one, and keep their errors there."""
    fitted, judged = data.fitted.without(fold), data.judged
    tau_s = search_time_constants(fitted, features, start_s, _TOLERANCE)
    moments = accumulate(fitted, bank_inputs(fitted, features, tau_s), tau_s)
    columns = moments.columns(range(len(tau_s)), moments.inputs)
    gains, _ = least_squares(moments.centred(), columns)
    banked = bank_inputs(judged, features, tau_s)
    bins = []
    for i in _recordings_with(data, fold):
        design = _design(banked[i], judged.sums[i], loaded=judged.loaded)[:, columns]
        bins.append(_around_level(data, i, fold, judged.sums[i].residual - design @ gains))
    return bins


def _recordings_with(data: CandidateData, fold: int) -> list[int]:
    """List the recordings with samples in a fold."""
    pairs = zip(data.judged.sums, data.judged.folds, strict=True)
    return [i for i, (sums, folds) in enumerate(pairs) if (sums.count[folds == fold] > 0).any()]


def _around_level(data: CandidateData, i: int, fold: int, errors: FloatArray) -> FoldBins:
    """Count a recording's errors, (n,), in a fold from its first minute, or from the others."""
    judged, present = data.judged, data.judged.sums[i].count > 0
    held = (judged.folds[i] == fold) & present
    if judged.tared:
        remaining = tare(errors[held], judged.period_s)
    else:
        remaining = errors[held] - errors[~held & present].mean()
    cells = judged.period_s / data.axis_data.period_s
    middles = (np.flatnonzero(held) + 0.5) * cells - 0.5
    last = len(data.axis_data.residual[i]) - 1
    return FoldBins(i, fold, np.minimum(middles, last), remaining)


def _design(x: FloatArray, sums: Sums, *, loaded: bool) -> FloatArray:
    """Draw the regressors of the equation in ``regression``, without the constant."""
    #   [ x_f(H_τ T) … | w x_f(H_τ T) … | w ]     with load
    #   [ x_f(H_τ T) … ]                          without
    w = sums.load[:, np.newaxis]
    return np.concatenate((x, w * x, w), axis=1) if loaded else x


def uncompensated_bins(data: CandidateData) -> list[FoldBins]:
    """Keep the errors of doing nothing, as those of CvScore."""
    return [
        _around_level(data, i, fold, data.judged.sums[i].residual)
        for fold in np.unique(data.fitted_moments.fold).tolist()
        for i in _recordings_with(data, fold)
    ]


def part_errors(bins: Sequence[FoldBins]) -> FloatArray:
    """Score every fold in parts: mean squares, shape (parts,)."""
    return np.array(
        [
            part.mean()
            for each in bins
            for part in np.array_split(each.errors**2, min(JUDGED_PARTS, len(each.errors)))
        ]
    )


def simplest_good(errors: Sequence[FloatArray]) -> int:
    """Find the simplest candidate within one standard error of the best, or within 15 % of it."""
    # The standard error is that of the difference to the best, part by part: parts differ in
    # difficulty far more than candidates do. Mean square errors (parts,), simplest candidate
    # first.
    means = [float(error.mean()) for error in errors]
    best = int(np.argmin(means))
    for position, error in enumerate(errors):
        margin = max(standard_error(error - errors[best]), WORTHWHILE * means[position])
        if means[position] - means[best] <= margin:
            return position
    return best


def standard_error(differences: FloatArray) -> float:
    """Estimate the standard error of a mean; 0 for a single value."""
    count = len(differences)
    return float(differences.std(ddof=1)) / np.sqrt(count) if count > 1 else 0.0


def refit_bins(data: AxisData, refit: Refit) -> list[FoldBins]:
    """Refit a model without each fold in turn, and keep its errors there."""
    return [
        each
        for fold in data.fold_numbers
        for each in fold_bins(data, unexplained(data, refit(data.without(fold))[0]), fold)
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
            inside = bin_means(values[rows], rows, data.bin_cells[1])
            cells = bin_means(rows.astype(float), rows, data.bin_cells[1])
            if data.tared:
                errors = tare(inside, data.bin_cells[1] * data.period_s)
            else:
                errors = inside - values[(folds != fold) & finite].mean()
            bins.append(FoldBins(i, fold, cells, errors))
    return bins


def bin_means(values: FloatArray, cells: IntArray, bin_cells: int) -> FloatArray:
    """Average samples, (n, …), over bins of consecutive cells, whose numbers, (n,), increase."""
    if bin_cells <= 1:
        return values
    bins = cells // bin_cells
    starts = np.flatnonzero(np.diff(bins, prepend=bins[0] - 1))
    counts = np.diff(starts, append=len(bins))
    sums = np.add.reduceat(values, starts, axis=0)
    return np.asarray(sums / counts.reshape(-1, *[1] * (values.ndim - 1)))


def hold_out(data: AxisData, before: Sequence[FoldBins], after: Sequence[FoldBins]) -> HeldOut:
    """Keep the errors on every held-out fold, without compensation and of the winner."""
    rows = [
        np.stack(np.broadcast_arrays(*raw, compensated.errors))
        for raw, compensated in zip(before, after, strict=True)
    ]
    table = np.concatenate(rows, axis=1)
    sorted_ = table[:, np.lexsort((table[2], table[0]))]
    return keep_errors(sorted_, data.bin_cells[1] * data.period_s, tared=data.tared)


def keep_errors(table: FloatArray, bin_s: float, *, tared: bool) -> HeldOut:
    """Name the rows of a table, (5, n): recording, fold, cell, and errors before and after."""
    recording, fold = table[:2].astype(np.int64)
    cell, before, after = table[2:]
    return HeldOut(recording, fold, cell, before, after, bin_s, tared)
