"""Choosing among candidates by blocks they had not seen, and finishing the winner."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrist_ft_comp.core.axis_fit import AxisFit, Candidate, Fitted
from wrist_ft_comp.core.axis_model import AxisModel
from wrist_ft_comp.core.problem import AxisProblem
from wrist_ft_comp.core.recording import FloatArray
from wrist_ft_comp.core.scoring import unexplained

#: A candidate has to lower the mean square error by this share to be worth its complexity.
_WORTHWHILE = 0.15


def simplest_good(errors: Sequence[FloatArray]) -> int:
    """
    Choose the simplest candidate within one standard error of the best, or within 15 % of it.

    The standard error is that of the difference to the best, part by part: parts differ in
    difficulty far more than candidates do.

    Parameters
    ----------
    errors : sequence of ndarrays, shape (parts,)
        Mean square errors, simplest candidate first.

    Returns
    -------
    int
        Its position.

    """
    means = [float(error.mean()) for error in errors]
    best = int(np.argmin(means))
    for position, error in enumerate(errors):
        margin = max(_standard_error(error - errors[best]), _WORTHWHILE * means[position])
        if means[position] - means[best] <= margin:
            return position
    return best


def _standard_error(differences: FloatArray) -> float:
    """Estimate the standard error of a mean; 0 for a single value."""
    count = len(differences)
    return float(differences.std(ddof=1)) / np.sqrt(count) if count > 1 else 0.0


def finish(
    problem: AxisProblem,
    winner: Fitted,
    chosen: str,
    errors: Mapping[str, FloatArray],
    competing: Sequence[str],
) -> AxisFit:
    """
    Fix what the fit leaves open, and collect the scores.

    Parameters
    ----------
    problem : AxisProblem
        The axis.
    winner : Fitted
        Fitted to everything.
    chosen : str
        Its name.
    errors : mapping of str to ndarray, shape (parts,)
        Held-out mean square errors by candidate, simplest first; "none" is among them.
    competing : sequence of str
        Those that could have been chosen.

    Returns
    -------
    AxisFit
        The result.

    """
    notes = winner.notes
    if problem.no_sensitivity:
        notes = (*notes, f'zero drift only: {problem.no_sensitivity}')
    rms = {name: float(np.sqrt(error.mean())) for name, error in errors.items()}
    model = None if winner.model is None else anchor(problem, winner.model)
    fit = AxisFit(
        model=model,
        chosen=chosen,
        candidates=tuple(Candidate(name, value) for name, value in rms.items()),
        rms_before=rms['none'],
        rms_after=rms[chosen],
        reason=_reason(problem, chosen, errors, competing),
        time_constants_s=winner.time_constants_s,
        time_constant_errors_s=winner.time_constant_errors_s,
        terms=winner.terms,
        notes=notes,
        doubts=winner.doubts,
        unit=problem.unit,
    )
    if model is None or winner.time_constants_s:
        return fit
    found = _lasting_time_constants(model, problem.period_s)
    return replace(
        fit, time_constants_s=found, time_constant_errors_s=(float('nan'),) * len(found)
    )


def _lasting_time_constants(model: AxisModel, period_s: float) -> tuple[float, ...]:
    """Turn the real positive poles of a model into time constants, increasing, s."""
    poles = model.poles
    lasting = poles.real[(np.abs(poles.imag) < 1e-9) & (poles.real > 0)]
    return tuple(float(tau) for tau in np.unique(np.round(-period_s / np.log(lasting), 6)))


def _reason(
    problem: AxisProblem,
    chosen: str,
    errors: Mapping[str, FloatArray],
    competing: Sequence[str],
) -> str:
    """Say in one sentence why a candidate was chosen."""
    unit = problem.unit
    means = {name: float(errors[name].mean()) for name in competing}
    own, nothing = (float(np.sqrt(errors[name].mean())) for name in (chosen, 'none'))
    says = f'{chosen} leaves {own:.3g} {unit} RMS on held-out data'
    if chosen != 'none':
        says += f', no compensation {nothing:.3g} {unit}'
    if len(competing) == 1:
        return f'{says}; nothing else competed.'
    best = min(means, key=lambda name: means[name])
    if best == chosen:
        return f'{says}; of {len(competing)} candidates it is the best.'
    chance = _standard_error(errors[chosen] - errors[best])
    gap = means[chosen] - means[best]
    why = (
        f'no more than chance (standard error {chance:.2g} {unit}²)'
        if gap <= chance
        else f'not worth its complexity (less than {100 * _WORTHWHILE:.0f} %)'
    )
    return (
        f'{says}; the best of {len(competing)}, {best}, leaves {np.sqrt(means[best]):.3g} {unit}: '
        f'in mean square {gap:.2g} {unit}² less, {why}.'
    )


def anchor(problem: AxisProblem, model: AxisModel) -> AxisModel:
    """
    Fix the constants: no zero drift when soaked at T_ref, and the gain error there, if loaded.

    Parameters
    ----------
    problem : AxisProblem
        The axis; with load, the constant of the sensitivity drift is its least-squares value.
    model : AxisModel
        Fitted up to constants.

    Returns
    -------
    AxisModel
        With its output mean set.

    """
    resting = model.step(model.start(model.reference_c), model.reference_c)[1]
    mean = model.dynamics.output_mean - resting
    anchored = replace(model, dynamics=replace(model.dynamics, output_mean=mean))
    if problem.load is None:
        return anchored
    left = unexplained(problem, anchored)
    above, below, whole = 0.0, 0.0, 0.0
    for values, load in zip(left, problem.load, strict=True):
        rows = np.isfinite(values) & np.isfinite(load)
        if rows.any():
            w = load[rows] - load[rows].mean()
            above += float(w @ values[rows])
            below += float(w @ w)
            whole += float(load[rows] @ load[rows])
    # A load that is constant within each recording leaves the gain error at T_ref open.
    gain_error = above / below if below > 1e-12 * whole else 0.0
    mean = mean + np.array([0.0, gain_error])
    return replace(anchored, dynamics=replace(anchored.dynamics, output_mean=mean))
