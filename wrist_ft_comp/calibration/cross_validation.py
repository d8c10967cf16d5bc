"""
Where a candidate is scored: on folds that it did not see, in free run, averaged over bins.

Relaxations are scored from sums (``cross_validate``), any other model by refitting and running it
(``refit_errors``). ``simplest_good`` compares the scores; ``hold_out`` keeps the errors behind
those of the winner, bin by bin, for pictures.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.calibration.candidates import CandidateData
from wrist_ft_comp.calibration.result import HeldOut
from wrist_ft_comp.identification.axis_data import AxisData, JUDGED_PARTS
from wrist_ft_comp.identification.bins import Sums
from wrist_ft_comp.identification.moments import accumulate, bank_inputs, Moments
from wrist_ft_comp.identification.output_error import fit_columns, Structure
from wrist_ft_comp.identification.time_constants import search_time_constants
from wrist_ft_comp.model.axis_model import AxisModel
from wrist_ft_comp.model.signals import BoolArray, FloatArray, IntArray

#: Nearer to its optimum, a candidate's errors change by far less than they differ from others'.
_TOLERANCE = 1e-5
#: A candidate has to lower the mean square error by this share to be worth its complexity.
WORTHWHILE = 0.15


@dataclass(frozen=True, eq=False)
class CvScore:
    """
    How a candidate did on held-out folds: mean square error of each part of each fold.

    The strength is the position of the best one of a regularised regression; time constants are
    those that were searched, (K,), s.
    """

    structure: Structure
    errors: FloatArray
    strength: int = 0
    time_constants_s: FloatArray | None = None


class FoldBins(NamedTuple):
    """Mean cell numbers and errors of a recording's bins in a fold, around its constant, (n,)."""

    recording: int
    cells: FloatArray
    errors: FloatArray


#: Fits an axis, of which a fold may be held out: a model or None, and what had to be mended.
Refit = Callable[[AxisData], tuple[AxisModel | None, tuple[str, ...]]]


def cross_validate(data: CandidateData, structure: Structure) -> CvScore:
    """Score a candidate, at its best strength, on folds that it did not see."""
    moments, judged = data.fitted_moments, data.judged_moments
    inputs = data.inputs(structure)
    if not structure.free_time_constants:
        folds = np.unique(moments.fold)
        tried = [_score_fold(moments, judged, structure, inputs, fold) for fold in folds]
        errors = np.concatenate(tried, axis=1)
        best = int(np.argmin(errors.mean(axis=1)))
        return CvScore(structure, errors[best], best)
    columns, _ = fit_columns(moments, structure, moments.everything, inputs)
    half = len(moments.time_constants_s) * moments.inputs
    on_grid = moments.time_constants_s[np.unique(columns[columns < half] // moments.inputs)]
    # All combinations on the grid were the starts; the best of them is followed.
    tau_s = search_time_constants(data.fitted, data.features_of(structure), on_grid, _TOLERANCE)
    return CvScore(structure, _searched_errors(data, structure, tau_s), 0, tau_s)


def _score_fold(
    moments: Moments, judged: Moments, structure: Structure, inputs: int, fold: int
) -> FloatArray:
    """Fit to all folds but one, score on it: mean squares, shape (S, parts of the fold)."""
    columns, coefficients = fit_columns(moments, structure, moments.fold != fold, inputs)
    theta = np.zeros((len(coefficients), moments.sums.shape[1]))
    theta[:, columns] = coefficients
    theta[:, -1] = -1.0
    return judged.mean_squares(judged.fold == fold, theta)


def _searched_errors(data: CandidateData, structure: Structure, start_s: FloatArray) -> FloatArray:
    """Search time constants without each fold in turn and score them there, shape (parts,)."""
    features = data.features_of(structure)
    errors = []
    for fold in np.unique(data.fitted_moments.fold):
        tau_s = _search_without(data, structure, start_s, fold)
        fixed = replace(structure, free_time_constants=0, bank_s=tuple(tau_s))
        moments = accumulate(data.fitted, bank_inputs(data.fitted, features, tau_s), tau_s)
        banked = bank_inputs(data.judged, features, tau_s)
        judged = accumulate(data.judged, banked, tau_s, JUDGED_PARTS)
        errors.append(_score_fold(moments, judged, fixed, moments.inputs, fold)[0])
    return np.concatenate(errors)


def _search_without(
    data: CandidateData, structure: Structure, start_s: FloatArray, fold: int
) -> FloatArray:
    """Search time constants without a fold, s."""
    kept = data.fitted.without(fold)
    return search_time_constants(kept, data.features_of(structure), start_s, _TOLERANCE)


def uncompensated_errors(judged: Moments) -> FloatArray:
    """Score doing nothing, as CvScore.errors."""
    nothing = np.zeros((1, judged.sums.shape[1]))
    nothing[0, -1] = 1.0
    folds = np.unique(judged.fold)
    return np.concatenate([judged.mean_squares(judged.fold == fold, nothing)[0] for fold in folds])


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


def refit_errors(data: AxisData, refit: Refit) -> FloatArray:
    """Refit a model without each fold in turn and score it there: mean squares, shape (parts,)."""
    return np.array(
        [
            error
            for fold in data.fold_numbers
            for error in fold_errors(data, unexplained(data, refit(data.without(fold))[0]), fold)
        ]
    )


def refit_bins(data: AxisData, refit: Refit, fold: int) -> list[FoldBins]:
    """Refit a model without a fold, and keep its errors there."""
    return fold_bins(data, unexplained(data, refit(data.without(fold))[0]), fold)


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


def fold_errors(data: AxisData, remainders: Sequence[FloatArray], fold: int) -> list[float]:
    """Score what ``unexplained`` leaves in a fold: mean squares of the fold's parts."""
    errors = []
    for bins in fold_bins(data, remainders, fold):
        parts = np.array_split(bins.errors**2, min(JUDGED_PARTS, len(bins.errors)))
        errors += [float(part.mean()) for part in parts]
    return errors


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
            bins.append(FoldBins(i, cells, inside - constant))
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
    before: Callable[[int], Sequence[FoldBins]],
    after: Callable[[int], Sequence[FoldBins]],
    *,
    detrended: bool = False,
) -> HeldOut:
    """Keep the errors on every held-out fold, without compensation and of the winner."""
    rows: list[FloatArray] = []
    for fold in data.fold_numbers:
        for raw, compensated in zip(before(fold), after(fold), strict=True):
            count = len(raw.cells)
            recordings, folds = np.full(count, raw.recording), np.full(count, fold)
            rows.append(np.stack((recordings, folds, raw.cells, raw.errors, compensated.errors)))
    table = np.concatenate(rows, axis=1)
    recording, held_out, cell, error, remaining = table[:, np.lexsort((table[2], table[0]))]
    return HeldOut(
        recording=recording.astype(np.int64),
        fold=held_out.astype(np.int64),
        cell=cell,
        before=error,
        after=remaining,
        bin_s=data.bin_cells[1] * data.period_s,
        tared=data.tared,
        detrended=detrended,
    )


def left_out_bins(data: CandidateData, score: CvScore | None, fold: int) -> list[FoldBins]:
    """Fit a candidate to all folds but one, and keep its errors there; None does nothing."""
    judged = data.judged
    remainders = [sums.residual for sums in judged.sums]
    if score is not None:
        remainders = _remainders(data, score, fold)
    cells = judged.period_s / data.axis_data.period_s
    bins = []
    for i, (errors, sums, folds) in enumerate(
        zip(remainders, judged.sums, judged.folds, strict=True)
    ):
        present = sums.count > 0
        held = (folds == fold) & present
        if held.any():
            basis = held if judged.tared else ~held & present
            level = _level(errors, sums.time, basis)
            middles = (np.flatnonzero(held) + 0.5) * cells - 0.5
            last = len(data.axis_data.residual[i]) - 1
            bins.append(FoldBins(i, np.minimum(middles, last), (errors - level)[held]))
    return bins


def _level(errors: FloatArray, time: FloatArray, basis: BoolArray) -> FloatArray:
    """Fit what no temperature has to explain: a constant, and a trend where time is not 0."""
    one_and_time = np.stack((np.ones_like(time), time), axis=1)
    level = np.linalg.lstsq(one_and_time[basis], errors[basis], rcond=None)[0]
    return np.asarray(one_and_time @ level, dtype=float)


def _remainders(data: CandidateData, score: CvScore, fold: int) -> list[FloatArray]:
    """Subtract a fit to the other folds from r - w in bins, shapes (n_i,)."""
    fitted, judged, structure = data.fitted, data.judged, score.structure
    features = data.features_of(structure)
    tau_s = np.array(structure.bank_s or (0.0,))
    if score.time_constants_s is not None:
        tau_s = _search_without(data, structure, score.time_constants_s, fold)
    fixed = replace(structure, free_time_constants=0, bank_s=tuple(tau_s))
    moments = accumulate(fitted, bank_inputs(fitted, features, tau_s), tau_s)
    columns, coefficients = fit_columns(moments, fixed, moments.fold != fold, moments.inputs)
    theta = np.zeros(moments.sums.shape[1] - 1)
    theta[columns] = coefficients[score.strength]
    return [
        sums.residual - _design(x, sums, loaded=judged.loaded) @ theta
        for x, sums in zip(bank_inputs(judged, features, tau_s), judged.sums, strict=True)
    ]


def _design(x: FloatArray, sums: Sums, *, loaded: bool) -> FloatArray:
    """
    Draw the regressors of the equation in ``output_error``, without the constant.

        [ x_f(H_τ T) … | w x_f(H_τ T) … | w ]     with load
        [ x_f(H_τ T) … ]                          without
    """
    w = sums.load[:, np.newaxis]
    return np.concatenate((x, w * x, w), axis=1) if loaded else x
