"""
Method ``auto``: an average of 30 ridge fits, weighted by what they leave of recordings held out.

Picking the best of many fits on three or four recordings is itself an overfit, so none is picked.
All fits are vectors of gains on one pool of columns (``ridge_bank``), and so is their average.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.channels import axis_unit
from wrist_ft_comp.fit.axis_data import AxisData, BINS_PER_FOLD, build_features
from wrist_ft_comp.fit.day_limit import day_over_blocks, expected_rms, left_of_a_day
from wrist_ft_comp.fit.folds import bin_means, hold_out, tare
from wrist_ft_comp.fit.result import AxisFit, Candidate
from wrist_ft_comp.fit.ridge_bank import (
    bin_axis_data,
    build_axis_model,
    candidates,
    LONG_BANK_S,
    Pool,
    POOL_S,
    RidgeFit,
    sum_by_fold,
)
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.series import FloatArray, ROUNDING

COMBINATION = 'combination'
#: An average that lowers what is left of held-out recordings by less than this is not run, ...
_WORTH_RUNNING = 0.02
#: ... nor one that leaves this many times more of one of several recordings: it was right by
#: chance on the others. Of 144 axes on which there is nothing to learn one left 1.82 times as much
#: without this rule, with it none more than 1.1 times. Thirds of a single recording say less:
#: there an average that left 3 times more of one of them left 0.11 of another day.
HARMFUL_FOLD = 1.25
#: A fit's weight is what it leaves of the folds to the power of minus this.
_SHARPNESS = 8.0
#: Fits are compared by means over this time, or all look alike where a robot moves, s.
_COMPARED_S = 120.0
#: What a body forgets that did not start at rest is set aside before fits are compared, s ...
_TRANSIENTS_S = LONG_BANK_S[-3:]
#: ... as far as its variance is below this many times that of the mean of all errors.
_TRANSIENT_VARIANCE = 30.0
#: Below every square, so that logarithms exist.
_TINY = np.finfo(float).tiny


class LeftOfFold(NamedTuple):
    """What no compensation and the C - 1 fits, made from the other folds, leave of a fold."""

    recording: int
    fold: int
    #: Middle of every bin that has a sample, in cells of the recording, (n,).
    cells: FloatArray
    #: Errors of every fit, tared, (n, C).
    tared: FloatArray
    #: Mean square of each fit by which they are compared, start set aside, (C,).
    compared: FloatArray


def identify_auto(data: AxisData, settings: IdentificationSettings) -> AxisFit:
    """Learn the drift of an axis from all fits, each as far as it holds unseen."""
    fits = candidates(settings.highest_degree)
    bins = bin_axis_data(data, data.bin_cells[0])
    relaxed_c = bins.relaxed(POOL_S)
    features = build_features(bins.temperature_c, settings, beyond='tangents')
    pool = Pool(settings.highest_degree, features.thermometers, bins.loaded)
    # The pool's columns, without load, (n_i, K·F).
    inputs = [features.expand(values_c).reshape(len(values_c), -1) for values_c in relaxed_c]
    sums = sum_by_fold(bins, inputs)
    left = []
    for fold in data.fold_numbers:
        gains = pool.fit_all(fits, sums.centred(sums.fold != fold))
        # What runs has the range that the other folds saw, so the rule beyond it is judged, too.
        pairs = zip(bins.temperature_c, bins.folds, strict=True)
        others_c = np.concatenate([values_c[folds != fold] for values_c, folds in pairs])
        seen = replace(features, lower_c=others_c.min(axis=0), upper_c=others_c.max(axis=0))
        i = next(i for i, folds in enumerate(bins.folds) if (folds == fold).any())
        rows = np.flatnonzero((bins.folds[i] == fold) & (bins.sums[i].count > 0))
        x = seen.expand(relaxed_c[i][rows]).reshape(len(rows), -1)
        errors = bins.regression(i, rows, x) @ gains.T
        # Fits are compared around a constant and a start transient.
        time_s = np.arange(len(errors)) * bins.period_s
        transients = np.exp(-time_s[:, np.newaxis] / np.array(_TRANSIENTS_S))
        phi = np.concatenate((np.ones((len(errors), 1)), transients), axis=1)
        precision = np.full(phi.shape[1], len(errors) / _TRANSIENT_VARIANCE)
        precision[0] = 0.0
        level = np.linalg.solve(phi.T @ phi + np.diag(precision), phi.T @ errors)
        rest = errors - phi @ level
        width = max(1, min(round(_COMPARED_S / bins.period_s), len(rest) // BINS_PER_FOLD))
        means = bin_means(rest, np.arange(len(rest)), width)
        compared = np.asarray((means**2).mean(axis=0) + precision @ level**2 / len(errors))
        middles = np.asarray((rows + 0.5) * bins.cells - 0.5)
        left.append(LeftOfFold(i, fold, middles, tare(errors, bins.period_s), compared))
    weights = _weigh(left)
    fit = _axis_fit(data, fits, weights, left, bins.period_s)
    if weights[0] == 1:
        return fit
    gains = weights @ pool.fit_all(fits, sums.centred(sums.fold >= 0))
    model = build_axis_model(features, POOL_S, gains[:-1], inputs, data.period_s)
    return replace(fit, model=model)


def _weigh(left: Sequence[LeftOfFold]) -> FloatArray:
    """
    Weigh no compensation and all fits by what they leave of the folds: (C,), of sum 1.

    The mean of a logarithm over folds is a geometric mean of errors: no day outvotes the others.
    """
    logs = np.log(np.maximum([of_fold.compared for of_fold in left], _TINY)).mean(axis=0) / 2
    weights = np.exp(-_SHARPNESS * (logs - logs[1:].min()))
    weights[0] = 0.0
    weights /= weights.sum()
    none: FloatArray = np.eye(len(weights))[0]
    after, before = (np.sqrt(_mean_squares(used, left)) for used in (weights, none))
    worth = after.mean() < (1 - _WORTH_RUNNING) * before.mean()
    several = len({of_fold.recording for of_fold in left}) > 1
    harmful = several and bool((after > HARMFUL_FOLD * before).any())
    return weights if worth and not harmful else none


def _mean_squares(weights: FloatArray, left: Sequence[LeftOfFold]) -> FloatArray:
    """Mean square that a weighted average, (C,), leaves of every fold, tared, (folds,)."""
    return np.array([np.mean((of_fold.tared @ weights) ** 2) for of_fold in left])


def _axis_fit(
    data: AxisData,
    fits: Sequence[RidgeFit],
    weights: FloatArray,
    left: Sequence[LeftOfFold],
    period_s: float,
) -> AxisFit:
    """State what the average of an axis leaves, and what the fits of each name do."""
    # What runs, nothing, and the average of each name: weights, (C,), and their share of the sum.
    none: FloatArray = np.eye(len(weights))[0]
    averages = {'': (weights, 1.0), 'none': (none, float(weights[0]))}
    names = np.array(['none', *(candidate.name for candidate in fits)])
    for name in dict.fromkeys(names[1:].tolist()):
        members = names == name
        total = float(weights[members].sum())
        average = np.where(members, weights if total > 0 else 1.0, 0.0)
        averages[name] = average / average.sum(), total
    mean_squares = [_mean_squares(average, left) for average, _ in averages.values()]
    single = np.array([np.mean(of_fold.tared**2, axis=0) for of_fold in left])  # (folds, C)
    before = float(np.sqrt(single[:, 0]).mean())
    factor = day_over_blocks(data, before)
    rms = [left_of_a_day(float(np.sqrt(s).mean()), before, factor) for s in mean_squares]
    rounding = ROUNDING * max(np.fmax.reduce(np.abs(r), initial=0.0) for r in data.residual)
    after, *others = (value if value > rounding else 0.0 for value in rms)
    expected = expected_rms(data, mean_squares[0], single @ weights, single[:, 0])
    rows = [
        Candidate(name, value, total)
        for (name, (_, total)), value in zip(list(averages.items())[1:], others, strict=True)
    ]
    used, unit = weights[0] < 1, axis_unit(data.axis)
    reason = (
        f'Nothing that was tried holds on held-out data: no compensation leaves '
        f'{rows[0].rms:.3g} {unit} RMS.'
    )
    if used:
        heaviest = sorted(rows[1:], key=lambda row: -row.weight)[:2]
        names_of_two = [f'{row.name} ({100 * row.weight:.0f} %)' for row in heaviest]
        reason = (
            f'An average of {len(fits)} fits leaves {after:.3g} {unit} RMS on held-out data, '
            f'no compensation {rows[0].rms:.3g} {unit}; most weight have '
            f'{" and ".join(names_of_two)}.'
        )
    errors = []
    for i, fold, cells, tared, _ in left:
        inside = np.minimum(cells, len(data.residual[i]) - 1)
        errors.append((i, fold, inside, -tared[:, 0], -tared @ weights))
    return AxisFit(
        model=None, chosen=COMBINATION if used else 'none', candidates=tuple(rows),
        rms_before=rows[0].rms, rms_after=after,
        notes=(f'zero drift only: {data.no_sensitivity}',) if data.no_sensitivity else (),
        reason=reason, unit=unit, held_out=hold_out(errors, period_s, tared=True),
        expected_rms=expected if after else 0.0)  # fmt: skip
