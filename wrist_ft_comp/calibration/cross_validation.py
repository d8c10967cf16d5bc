"""
Where a candidate is scored: on folds that it did not see, in free run, averaged over bins.

Relaxations are fitted from sums (``cross_validate``), any other model by refitting and running it
(``refit_bins``). ``part_errors`` sums their errors up, ``simplest_good`` compares the sums, and
``hold_out`` keeps the winner's errors for pictures.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.calibration.candidates import CandidateData
from wrist_ft_comp.calibration.result import HeldOut
from wrist_ft_comp.identification.axis_data import AxisData
from wrist_ft_comp.identification.bins import Sums
from wrist_ft_comp.identification.moments import accumulate, bank_inputs
from wrist_ft_comp.identification.output_error import fit_columns, Structure
from wrist_ft_comp.identification.time_constants import search_time_constants
from wrist_ft_comp.model.axis_model import AxisModel
from wrist_ft_comp.model.signals import FloatArray, IntArray

#: Nearer to its optimum, a candidate's errors change by far less than they differ from others'.
_TOLERANCE = 1e-5
#: Parts that each held-out fold is scored in: two recordings alone cannot tell chance from merit.
JUDGED_PARTS = 4
#: A candidate has to lower the mean square error by this share to be worth its complexity.
WORTHWHILE = 0.15


class FoldBins(NamedTuple):
    """
    Bins of a recording in a held-out fold: mean cell numbers, (n,), and errors.

    Errors are counted from a constant, (n,), or for every strength of a regression, (n, S).
    """

    recording: int
    fold: int
    cells: FloatArray
    errors: FloatArray


@dataclass(frozen=True, eq=False)
class CvScore:
    """
    How a candidate did on held-out folds, at its best strength.

    The strength is the position of the best one of a regularised regression; time constants are
    those that were searched, (K,), s.
    """

    structure: Structure
    bins: list[FoldBins]
    strength: int = 0
    time_constants_s: FloatArray | None = None


#: Fits an axis, of which a fold may be held out: a model or None, and what had to be mended.
Refit = Callable[[AxisData], tuple[AxisModel | None, tuple[str, ...]]]


def cross_validate(data: CandidateData, structure: Structure) -> CvScore:
    """Score a candidate, at its best strength, on folds that it did not see."""
    moments = data.fitted_moments
    tau_s = None
    if structure.free_time_constants:
        columns, _ = fit_columns(moments, structure, moments.everything, data.inputs(structure))
        half = len(moments.time_constants_s) * moments.inputs
        on_grid = moments.time_constants_s[np.unique(columns[columns < half] // moments.inputs)]
        # All combinations on the grid were the starts; the best of them is followed.
        features = data.features_of(structure)
        tau_s = search_time_constants(data.fitted, features, on_grid, _TOLERANCE)
    bins = [
        each
        for fold in np.unique(moments.fold).tolist()
        for each in _left_out_bins(data, structure, tau_s, fold)
    ]
    best = int(np.argmin(part_errors(bins).mean(axis=0)))
    at_best = [each._replace(errors=each.errors[:, best]) for each in bins]
    return CvScore(structure, at_best, best, tau_s)


def _left_out_bins(
    data: CandidateData, structure: Structure, start_s: FloatArray | None, fold: int
) -> list[FoldBins]:
    """Fit a candidate to all folds but one, from a start where it searches; its errors there."""
    fitted, judged = data.fitted, data.judged
    moments, banked = data.fitted_moments, data.judged_inputs
    if start_s is not None:
        features = data.features_of(structure)
        tau_s = search_time_constants(fitted.without(fold), features, start_s, _TOLERANCE)
        structure = replace(structure, free_time_constants=0, bank_s=tuple(tau_s))
        moments = accumulate(fitted, bank_inputs(fitted, features, tau_s), tau_s)
        banked = bank_inputs(judged, features, tau_s)
    keep = moments.fold != fold
    columns, coefficients = fit_columns(moments, structure, keep, data.inputs(structure))
    bins = []
    for i in _recordings_with(data, fold):
        design = _design(banked[i], judged.sums[i], loaded=judged.loaded)[:, columns]
        errors = judged.sums[i].residual[:, np.newaxis] - design @ coefficients.T
        bins.append(_around_level(data, i, fold, errors))
    return bins


def _recordings_with(data: CandidateData, fold: int) -> list[int]:
    """List the recordings with samples in a fold."""
    pairs = zip(data.judged.sums, data.judged.folds, strict=True)
    return [i for i, (sums, folds) in enumerate(pairs) if (sums.count[folds == fold] > 0).any()]


def _around_level(data: CandidateData, i: int, fold: int, errors: FloatArray) -> FoldBins:
    """Count a recording's errors, (n, S), in a fold from what no temperature has to explain."""
    judged, sums = data.judged, data.judged.sums[i]
    present = sums.count > 0
    held = (judged.folds[i] == fold) & present
    basis = held if judged.tared else ~held & present
    # A constant, and a trend where time is not 0.
    one_and_time = np.stack((np.ones_like(sums.time), sums.time), axis=1)
    level = one_and_time @ np.linalg.lstsq(one_and_time[basis], errors[basis], rcond=None)[0]
    cells = judged.period_s / data.axis_data.period_s
    middles = (np.flatnonzero(held) + 0.5) * cells - 0.5
    last = len(data.axis_data.residual[i]) - 1
    return FoldBins(i, fold, np.minimum(middles, last), (errors - level)[held])


def _design(x: FloatArray, sums: Sums, *, loaded: bool) -> FloatArray:
    """
    Draw the regressors of the equation in ``output_error``, without the constant.

        [ x_f(H_τ T) … | w x_f(H_τ T) … | w ]     with load
        [ x_f(H_τ T) … ]                          without
    """
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
    """Score every fold in parts: mean squares, shape (parts,), by strength (parts, S)."""
    return np.array(
        [
            part.mean(axis=0)
            for each in bins
            for part in np.array_split(each.errors**2, min(JUDGED_PARTS, len(each.errors)))
        ]
    )


def simplest_good(errors: Sequence[FloatArray]) -> int:
    """
    Find the simplest candidate within one standard error of the best, or within 15 % of it.

    The standard error is that of the difference to the best, part by part: parts differ in
    difficulty far more than candidates do. Mean square errors (parts,), simplest candidate first.
    """
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
    """
    Subtract a model's free run, from the steady state of the first cell, from r - w, (N_i,).

    Up to the unknown constant of each recording; without a model, all of r - w.
    """
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
    """Average what is left in a fold over bins, around each recording's constant."""
    bins = []
    for i, (folds, values) in enumerate(zip(data.folds, remainders, strict=True)):
        finite = np.isfinite(values)
        rows = np.flatnonzero((folds == fold) & finite)
        if len(rows):
            inside = bin_means(values[rows], rows, data.bin_cells[1])
            constant = (inside if data.tared else values[(folds != fold) & finite]).mean()
            cells = bin_means(rows.astype(float), rows, data.bin_cells[1])
            bins.append(FoldBins(i, fold, cells, inside - constant))
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


def hold_out(
    data: AxisData,
    before: Sequence[FoldBins],
    after: Sequence[FoldBins],
    *,
    detrended: bool = False,
) -> HeldOut:
    """Keep the errors on every held-out fold, without compensation and of the winner."""
    rows = [
        np.stack(np.broadcast_arrays(*raw, compensated.errors))
        for raw, compensated in zip(before, after, strict=True)
    ]
    table = np.concatenate(rows, axis=1)
    recording, fold, cell, error, remaining = table[:, np.lexsort((table[2], table[0]))]
    return HeldOut(
        recording=recording.astype(np.int64),
        fold=fold.astype(np.int64),
        cell=cell,
        before=error,
        after=remaining,
        bin_s=data.bin_cells[1] * data.period_s,
        tared=data.tared,
        detrended=detrended,
    )
