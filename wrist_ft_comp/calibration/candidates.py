"""The errors behind a candidate's score, bin by bin."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from wrist_ft_comp.calibration.cross_validation import BlockBins
from wrist_ft_comp.calibration.result import simplest_good
from wrist_ft_comp.calibration.settings import IdentificationSettings
from wrist_ft_comp.identification import output_error as oe
from wrist_ft_comp.identification.bins import bin_problem, BinnedProblem, Sums
from wrist_ft_comp.identification.moments import accumulate, bank_inputs, Moments
from wrist_ft_comp.identification.problem import AxisProblem, JUDGED_PARTS
from wrist_ft_comp.identification.time_constants import search_time_constants
from wrist_ft_comp.model.features import Features
from wrist_ft_comp.model.signals import BoolArray, FloatArray

#: Nearer to its optimum, a candidate's errors change by far less than they differ from others'.
_TOLERANCE = 1e-5


_GRID_POINTS = 13


_SHORTEST_TAU_S = 20.0


_LONGEST_TAU_S = 7200.0


_REGULARISED: tuple[Literal['PLS', 'ridge'], ...] = ('PLS', 'ridge')


@dataclass(frozen=True, eq=False)
class Competition:
    """
    What all candidates of an axis are fitted from and scored on.

    Attributes
    ----------
    problem : AxisProblem
        The axis.
    features : Features
        Of one relaxation's temperatures, of the highest degree.
    fitted, judged : BinnedProblem
        Fitted to, and scored on.
    fitted_moments, judged_moments : Moments
        Their sums, with all features behind a grid of time constants.
    trend : bool
        Whether a slow trend that no temperature has to explain is set aside.

    """

    problem: AxisProblem
    features: Features
    fitted: BinnedProblem
    judged: BinnedProblem
    fitted_moments: Moments
    judged_moments: Moments
    trend: bool

    def inputs(self, structure: oe.Structure) -> int:
        """Count the features of a structure: powers up to its degree, or all hats."""
        if self.features.kind == 'powers':
            return structure.degree * self.features.thermometers
        return sum(len(knots) for knots in self.features.knots_c)

    def features_of(self, structure: oe.Structure) -> Features:
        """Features of one relaxation's temperatures."""
        if self.features.kind == 'hats':
            return self.features
        return replace(self.features, degree=structure.degree)


@dataclass(frozen=True, eq=False)
class Entry:
    """
    A candidate in the competition.

    Attributes
    ----------
    structure : Structure
        Which.
    errors : ndarray, shape (parts,)
        Held-out mean square errors.
    strength : int
        Position of the best strength of a regularised regression.
    time_constants_s : ndarray, shape (K,), or None
        Those that were found, s.

    """

    structure: oe.Structure
    errors: FloatArray
    strength: int = 0
    time_constants_s: FloatArray | None = None


def time_constant_grid(problem: AxisProblem) -> FloatArray:
    """
    Lay out the time constants that are tried: 0 (static), then evenly in their logarithm.

    Parameters
    ----------
    problem : AxisProblem
        Its longest recording limits what can be told apart from a trend.

    Returns
    -------
    ndarray, shape (K,)
        s, increasing.

    """
    low = max(_SHORTEST_TAU_S, 2 * problem.period_s)
    high = max(min(_LONGEST_TAU_S, problem.longest_s / 2), 2 * low)
    return np.concatenate(([0.0], np.geomspace(low, high, _GRID_POINTS)))


def open_competition(problem: AxisProblem, features: Features) -> Competition:
    """
    Pass the temperatures through the grid of time constants, and sum.

    A slow trend, such as creep under load, is set aside where that helps on held-out data: in a
    long recording whose temperatures go up and down. In others it is mistaken for thermal drift
    as easily as the other way round. It is never counted against a candidate.

    Parameters
    ----------
    problem : AxisProblem
        The axis.
    features : Features
        Of one relaxation's temperatures, of the highest degree.

    Returns
    -------
    Competition
        Open to candidates.

    """
    grid = time_constant_grid(problem)
    fitted_cells, judged_cells = problem.bin_cells
    fitted = bin_problem(problem, fitted_cells)
    judged = bin_problem(problem, judged_cells, means=True)
    moments = accumulate(fitted, bank_inputs(fitted, features, grid), grid)
    judged_moments = accumulate(judged, bank_inputs(judged, features, grid), grid, JUDGED_PARTS)
    plain = Competition(
        problem,
        features,
        fitted.without_trend(),
        judged,
        moments.without_trend(),
        judged_moments,
        trend=False,
    )
    if not moments.time[:, 1].any():
        return plain
    trending = replace(plain, fitted=fitted, fitted_moments=moments, trend=True)
    bank = oe.Structure('any', 1, 0, tuple(grid.tolist()), 'ridge')
    chosen = simplest_good([enter(each, bank).errors for each in (plain, trending)])
    return (plain, trending)[chosen]


def enter(competition: Competition, structure: oe.Structure) -> Entry:
    """
    Score a candidate on blocks that it did not see.

    Parameters
    ----------
    competition : Competition
        From open_competition.
    structure : Structure
        The candidate.

    Returns
    -------
    Entry
        Its errors.

    """
    moments, judged = competition.fitted_moments, competition.judged_moments
    inputs = competition.inputs(structure)
    if not structure.free_time_constants:
        tried = oe.held_out_errors(moments, judged, structure, inputs)
        best = int(np.argmin(tried.mean(axis=1)))
        return Entry(structure, tried[best], best)
    everything = np.ones(len(moments.counts), dtype=bool)
    columns, _ = oe.fit_columns(moments, structure, everything, inputs)
    half = len(moments.time_constants_s) * moments.inputs
    found = np.unique(columns[columns < half] // moments.inputs)
    features = competition.features_of(structure)
    # All combinations on the grid were the starts; the best of them is followed.
    tau_s = search_time_constants(
        competition.fitted, features, moments.time_constants_s[found], _TOLERANCE
    )
    return Entry(structure, _free_errors(competition, features, tau_s), 0, tau_s)


def _free_errors(competition: Competition, features: Features, start_s: FloatArray) -> FloatArray:
    """Search time constants without each block in turn and score them there, shape (parts,)."""
    fitted, judged = competition.fitted, competition.judged
    structure = oe.Structure('found', features.degree, 0, tuple(start_s))
    errors = []
    for block in np.unique(competition.fitted_moments.block):
        tau_s = _without(competition, features, start_s, block)
        moments = accumulate(fitted, bank_inputs(fitted, features, tau_s), tau_s)
        scored = accumulate(judged, bank_inputs(judged, features, tau_s), tau_s, JUDGED_PARTS)
        errors.append(oe.block_errors(moments, scored, structure, moments.inputs, block)[0])
    return np.concatenate(errors)


def left_out_time_constants(competition: Competition, entry: Entry, block: int) -> FloatArray:
    """Return what a candidate uses when a block is held out: found anew, or fixed, s."""
    if entry.time_constants_s is None:
        return np.array(entry.structure.bank_s or (0.0,))
    features = competition.features_of(entry.structure)
    return _without(competition, features, entry.time_constants_s, block)


def _without(
    competition: Competition, features: Features, start_s: FloatArray, block: int
) -> FloatArray:
    """Search time constants without a block, s."""
    kept = competition.fitted.without(block)
    return search_time_constants(kept, features, start_s, _TOLERANCE)


def structures(
    settings: IdentificationSettings, features: Features, grid: FloatArray
) -> list[oe.Structure]:
    """
    List the candidates that compete, simplest first.

    Parameters
    ----------
    settings : IdentificationSettings
        ``auto`` has all of them, ``arx_pls_oe`` free time constants only.
    features : Features
        Kind and highest degree.
    grid : ndarray, shape (K,)
        From time_constant_grid.

    Returns
    -------
    list of Structure
        Without "none", which needs no fit.

    """
    hats = features.kind == 'hats'
    degrees = [1] if hats else list(range(1, settings.degree + 1))
    what = {degree: 'hats' if hats else f'degree {degree}' for degree in degrees}
    found = []
    if settings.method == 'auto':
        found += [oe.Structure(f'static, {what[d]}', d) for d in degrees]
    found += [
        oe.Structure(f'{count} time constant{"s" * (count > 1)}, {what[d]}', d, count)
        for count in (1, 2, 3)
        for d in degrees
        if count < 3 or d == 1
    ]
    if settings.method == 'auto':
        bank = tuple(float(tau) for tau in grid[::2])
        found += [
            oe.Structure(f'{regression} on a bank, {what[d]}', d, 0, bank, regression)
            for regression in _REGULARISED
            for d in degrees
        ]
    return found


def left_out_bins(competition: Competition, entry: Entry | None, block: int) -> list[BlockBins]:
    """
    Fit a candidate to all blocks but one, and keep its errors there.

    Parameters
    ----------
    competition : Competition
        What it is fitted from and scored on.
    entry : Entry or None
        The candidate; None is "no compensation".
    block : int
        Which block.

    Returns
    -------
    list of BlockBins
        Of the recordings that have samples in the block.

    """
    judged = competition.judged
    left = [of.residual for of in judged.sums]
    if entry is not None:
        left = _left(competition, entry, block)
    cells = judged.period_s / competition.problem.period_s
    found = []
    for i, (errors, of, number) in enumerate(zip(left, judged.sums, judged.blocks, strict=True)):
        present = of.count > 0
        held = (number == block) & present
        if held.any():
            basis = held if judged.tared else ~held & present
            level = _level(errors, of.time, basis)
            middles = (np.flatnonzero(held) + 0.5) * cells - 0.5
            last = len(competition.problem.residual[i]) - 1
            found.append(BlockBins(i, np.minimum(middles, last), (errors - level)[held]))
    return found


def _level(errors: FloatArray, time: FloatArray, basis: BoolArray) -> FloatArray:
    """Fit what no temperature has to explain: a constant, and a trend where time is not 0."""
    one_and_time = np.stack((np.ones_like(time), time), axis=1)
    level = np.linalg.lstsq(one_and_time[basis], errors[basis], rcond=None)[0]
    return np.asarray(one_and_time @ level, dtype=float)


def _left(competition: Competition, entry: Entry, block: int) -> list[FloatArray]:
    """Leave of r - w what a fit to the other blocks does not explain, shapes (n_i,)."""
    features = competition.features_of(entry.structure)
    tau_s = left_out_time_constants(competition, entry, block)
    structure = replace(entry.structure, free_time_constants=0, bank_s=tuple(tau_s))
    fitted, judged = competition.fitted, competition.judged
    moments = accumulate(fitted, bank_inputs(fitted, features, tau_s), tau_s)
    columns, coefficients = oe.fit_columns(
        moments, structure, moments.block != block, moments.inputs
    )
    theta = np.zeros(moments.sums.shape[1] - 1)
    theta[columns] = coefficients[entry.strength]
    return [
        of.residual - _design(x, of, loaded=judged.loaded) @ theta
        for x, of in zip(bank_inputs(judged, features, tau_s), judged.sums, strict=True)
    ]


def _design(x: FloatArray, of: Sums, *, loaded: bool) -> FloatArray:
    """
    Draw the regressors of the equation in simulation_error, without the constant.

        [ x_f(H_τ T) … | w x_f(H_τ T) … | w ]     with load
        [ x_f(H_τ T) … ]                          without
    """
    w = of.load[:, np.newaxis]
    return np.concatenate((x, w * x, w), axis=1) if loaded else x
