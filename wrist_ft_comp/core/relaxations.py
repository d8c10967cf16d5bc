"""Relaxations in competition: none, static, free time constants, and a regularised bank."""

from dataclasses import replace

import numpy as np

from wrist_ft_comp.core import simulation_error as oe
from wrist_ft_comp.core.arx import relaxation
from wrist_ft_comp.core.arx_pls import ArxPls
from wrist_ft_comp.core.features import Features
from wrist_ft_comp.core.moments import Moments, accumulate, bank_inputs
from wrist_ft_comp.core.outer_inner import from_gains
from wrist_ft_comp.core.problem import AxisProblem
from wrist_ft_comp.core.recording import FloatArray
from wrist_ft_comp.core.selection import AxisFit, Fitted, finish, simplest_good
from wrist_ft_comp.core.settings import IdentificationSettings, build_features

#: Drift that ranges this many times wider where no wrench was recorded has run away.
_RUNAWAY = 3.0
_GRID_POINTS = 13
_SHORTEST_TAU_S = 20.0
_LONGEST_TAU_S = 7200.0


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
    longest = max(len(residual) for residual in problem.residual) * problem.period_s
    low = max(_SHORTEST_TAU_S, 2 * problem.period_s)
    high = max(min(_LONGEST_TAU_S, longest / 2), 2 * low)
    return np.concatenate(([0.0], np.geomspace(low, high, _GRID_POINTS)))


def identify_relaxations(problem: AxisProblem, settings: IdentificationSettings) -> AxisFit:
    """
    Let none, static, free and banked relaxations compete, fitted on the simulation error.

    Parameters
    ----------
    problem : AxisProblem
        Drift observations.
    settings : IdentificationSettings
        ``auto`` tries all of them, ``arx_pls_oe`` free time constants only.

    Returns
    -------
    AxisFit
        The winner, and everything that was tried.

    """
    features = build_features(problem.temperature_c, settings)
    grid = time_constant_grid(problem)
    banked = bank_inputs(problem, features, grid)
    moments = accumulate(problem, banked, grid)
    judged = accumulate(problem, banked, grid, problem.judged_cells)
    errors = {'none': oe.uncompensated_errors(judged)}
    structures: dict[str, tuple[oe.Structure, float]] = {}
    for structure in _structures(settings, features, grid):
        inputs = _inputs(structure, features)
        strengths = oe.RIDGE_STRENGTHS if structure.regularised else (0.0,)
        tried = [oe.held_out_errors(moments, judged, structure, inputs, s) for s in strengths]
        best = int(np.argmin([error.mean() for error in tried]))
        errors[structure.name] = tried[best]
        structures[structure.name] = (structure, strengths[best])
    competing = list(errors) if settings.method == 'auto' else list(structures)
    notes: tuple[str, ...] = ()
    while True:
        chosen = competing[simplest_good([errors[name] for name in competing])]
        if chosen == 'none':
            return finish(problem, Fitted(features, None, notes), chosen, errors)
        fitted = _fit_structure(problem, features, moments, *structures[chosen])
        if len(competing) == 1 or _stays_bounded(problem, fitted):
            return finish(problem, replace(fitted, notes=notes), chosen, errors)
        competing.remove(chosen)
        notes = (*notes, f'{chosen}: left out, its drift runs away where no wrench was recorded')


def _fit_structure(
    problem: AxisProblem,
    features: Features,
    moments: Moments,
    structure: oe.Structure,
    strength: float,
) -> Fitted:
    """Fit the winner to all blocks, its time constants refined."""
    inputs = _inputs(structure, features)
    if features.kind == 'powers':
        features = replace(features, degree=structure.degree)
    taus = np.array(structure.bank_s or (0.0,))
    if structure.free_time_constants:
        everything = np.ones(len(moments.counts), dtype=bool)
        columns, _ = oe.fit_columns(moments, structure, everything, inputs, strength)
        half = len(moments.time_constants_s) * moments.inputs
        found = np.unique(columns[columns < half] // moments.inputs)
        taus = oe.refine_time_constants(problem, features, moments.time_constants_s[found])
    gains, _ = oe.fit_gains(problem, features, taus, max(strength, oe.TINY_RIDGE))
    return Fitted(features, _to_dynamics(problem, features, taus, gains))


def _inputs(structure: oe.Structure, features: Features) -> int:
    """Count the features that take part in a structure: powers up to its degree, or all hats."""
    if features.kind == 'powers':
        return structure.degree * features.thermometers
    return sum(len(knots) for knots in features.knots_c)


def _stays_bounded(problem: AxisProblem, fitted: Fitted) -> bool:
    """Tell whether the drift in cells without a wrench stays near that in cells with one."""
    features, dynamics = fitted.features, fitted.dynamics
    if dynamics is None:
        return True
    for temperature_c, residual in zip(problem.temperature_c, problem.residual, strict=True):
        x = features.expand(temperature_c)
        drift = dynamics.run(dynamics.start(x[0]), x)[1]
        seen = np.isfinite(residual)
        if seen.any() and (np.ptp(drift, axis=0) > _RUNAWAY * np.ptp(drift[seen], axis=0)).any():
            return False
    return True


def _structures(
    settings: IdentificationSettings, features: Features, grid: FloatArray
) -> list[oe.Structure]:
    """List the candidates that compete, simplest first."""
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
        found += [oe.Structure(f'bank of relaxations, {what[d]}', d, bank_s=bank) for d in degrees]
    return found


def _to_dynamics(
    problem: AxisProblem, features: Features, time_constants_s: FloatArray, gains: FloatArray
) -> ArxPls | None:
    """Write fitted gains as the model's ARX form."""
    inputs = np.concatenate([features.expand(t) for t in problem.temperature_c])
    deviation = inputs.std(axis=0)
    weight = 1.0 / np.where(deviation > 0, deviation, 1.0)
    bank = [relaxation(float(tau), problem.period_s) for tau in time_constants_s]
    return from_gains(bank, gains, inputs.mean(axis=0), weight, np.ones(gains.shape[2]))
