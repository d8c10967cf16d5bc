"""Choosing among candidates by blocks they had not seen, and finishing the winner."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from wrist_ft_comp.calibration.cross_validation import HeldOut, unexplained
from wrist_ft_comp.identification.problem import AxisProblem
from wrist_ft_comp.model.axis_model import AxisModel
from wrist_ft_comp.model.signals import FloatArray

Output = Literal['zero', 'sensitivity']


OUTPUTS: tuple[Output, ...] = ('zero', 'sensitivity')


@dataclass(frozen=True)
class Candidate:
    """
    One competitor and how it did on held-out blocks.

    Attributes
    ----------
    name : str
        For people.
    rms : float
        Root mean square error of the free run on held-out blocks, N or N m.

    """

    name: str
    rms: float


@dataclass(frozen=True)
class Term:
    """
    One gain of a fitted model.

    Attributes
    ----------
    output : {'zero', 'sensitivity'}
        Which drift.
    time_constant_s : float
        Of the relaxation behind which the feature is taken, s; 0 is static.
    feature : str
        Such as ``θ1`` or ``θ2²``, or the knot of a hat.
    gain : float
        N or N m (zero drift), or 1 (sensitivity drift), per unit of the feature.
    error : float
        Its standard error; NaN behind a regularised regression, which has none.

    """

    output: Output
    time_constant_s: float
    feature: str
    gain: float
    error: float


@dataclass(frozen=True, eq=False)
class Fitted:
    """
    A candidate, fitted.

    Attributes
    ----------
    model : AxisModel or None
        Up to constants; None is "no compensation".
    time_constants_s, time_constant_errors_s : tuple of float
        Those that were searched, increasing, with their standard errors, s.
    terms : tuple of Term
        Gains, where the method determines them one by one.
    notes : tuple of str
        What had to be mended.
    doubts : tuple of str
        What a person should be warned of.

    """

    model: AxisModel | None
    time_constants_s: tuple[float, ...] = ()
    time_constant_errors_s: tuple[float, ...] = ()
    terms: tuple[Term, ...] = ()
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class AxisFit:
    """
    What was found for one axis.

    Attributes
    ----------
    model : AxisModel or None
        None is "no compensation".
    chosen : str
        Name of the winning candidate.
    candidates : tuple of Candidate
        All that were tried, simplest first.
    rms_before, rms_after : float
        Held-out root mean square error without and with compensation, in the unit.
    time_constants_s : tuple of float
        Of the model's relaxations, increasing, s.
    notes : tuple of str
        What had to be mended, and what could not be learnt.
    reason : str
        Why this candidate, in a sentence with its numbers.
    time_constant_errors_s : tuple of float
        Standard errors of the time constants, s; NaN where they were not searched.
    terms : tuple of Term
        Gains with standard errors, where the method determines them one by one.
    doubts : tuple of str
        What a person should be warned of, such as better candidates that could not be trusted.
    refusal : str
        Why this axis could not be learnt although it drifts; empty when it was.
    held_out : HeldOut or None
        The errors behind rms_before and rms_after, for pictures.
    unit : str
        N, N m, or what the recordings are in.

    """

    model: AxisModel | None
    chosen: str
    candidates: tuple[Candidate, ...]
    rms_before: float
    rms_after: float
    time_constants_s: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()
    reason: str = ''
    time_constant_errors_s: tuple[float, ...] = ()
    terms: tuple[Term, ...] = ()
    doubts: tuple[str, ...] = ()
    refusal: str = ''
    held_out: HeldOut | None = None
    unit: str = ''


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
