"""Choosing among candidates by blocks they had not seen, and finishing the winner."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.core.arx_pls import ArxPls
from wrist_ft_comp.core.drift import AxisModel
from wrist_ft_comp.core.features import Features
from wrist_ft_comp.core.problem import AxisProblem
from wrist_ft_comp.core.recording import FloatArray
from wrist_ft_comp.core.scoring import unexplained

#: A candidate has to lower the mean square error by this share to be worth its complexity.
_WORTHWHILE = 0.15


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
        Held-out root mean square error without and with compensation, N or N m.
    time_constants_s : tuple of float
        Of the model's latents, increasing, s.
    notes : tuple of str
        What had to be mended, and what could not be learnt.

    """

    model: AxisModel | None
    chosen: str
    candidates: tuple[Candidate, ...]
    rms_before: float
    rms_after: float
    time_constants_s: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Fitted:
    """
    A candidate, fitted.

    Attributes
    ----------
    features : Features
        Its inputs.
    dynamics : ArxPls or None
        Up to constants; None is "no compensation".
    notes : tuple of str
        What had to be mended.

    """

    features: Features
    dynamics: ArxPls | None
    notes: tuple[str, ...] = ()


def simplest_good(errors: Sequence[FloatArray]) -> int:
    """
    Choose the simplest candidate within one standard error of the best, or within 15 % of it.

    The standard error is that of the difference to the best, block by block: blocks differ in
    difficulty far more than candidates do.

    Parameters
    ----------
    errors : sequence of ndarrays, shape (blocks,)
        Mean square errors, simplest candidate first.

    Returns
    -------
    int
        Its position.

    """
    means = [float(error.mean()) for error in errors]
    best = int(np.argmin(means))
    for position, error in enumerate(errors):
        difference = error - errors[best]
        blocks = len(difference)
        deviation = float(difference.std(ddof=1)) / np.sqrt(blocks) if blocks > 1 else 0.0
        if difference.mean() <= max(deviation, _WORTHWHILE * means[position]):
            return position
    return best


def finish(
    problem: AxisProblem, winner: Fitted, chosen: str, errors: Mapping[str, FloatArray]
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
    errors : mapping of str to ndarray, shape (blocks,)
        Held-out mean square errors by candidate, simplest first; "none" is among them.

    Returns
    -------
    AxisFit
        The result.

    """
    features, dynamics, notes = winner.features, winner.dynamics, winner.notes
    if problem.no_sensitivity:
        notes = (*notes, f'zero drift only: {problem.no_sensitivity}')
    candidates = tuple(
        Candidate(name, float(np.sqrt(error.mean()))) for name, error in errors.items()
    )
    rms = {candidate.name: candidate.rms for candidate in candidates}
    if dynamics is None:
        return AxisFit(None, 'none', candidates, rms['none'], rms['none'], notes=notes)
    poles = np.concatenate([latent.poles for latent in dynamics.latents])
    lasting = poles.real[(np.abs(poles.imag) < 1e-9) & (poles.real > 0)]
    return AxisFit(
        model=AxisModel(features, anchor(problem, features, dynamics)),
        chosen=chosen,
        candidates=candidates,
        rms_before=rms['none'],
        rms_after=rms[chosen],
        time_constants_s=tuple(
            float(tau) for tau in np.unique(np.round(-problem.period_s / np.log(lasting), 6))
        ),
        notes=notes,
    )


def anchor(problem: AxisProblem, features: Features, dynamics: ArxPls) -> ArxPls:
    """
    Fix the constants: no zero drift when soaked at T_ref, and the gain error there, if loaded.

    Parameters
    ----------
    problem : AxisProblem
        The axis; with load, the constant of the sensitivity drift is its least-squares value.
    features : Features
        For T_ref.
    dynamics : ArxPls
        Fitted up to constants.

    Returns
    -------
    ArxPls
        With its output mean set.

    """
    x_ref = features.expand(features.reference_c)
    resting = dynamics.step(dynamics.start(x_ref), x_ref)[1] - dynamics.output_mean
    mean = -resting
    anchored = replace(dynamics, output_mean=mean)
    if problem.load is None:
        return anchored
    left = unexplained(problem, features, anchored)
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
    return replace(anchored, output_mean=mean + np.array([0.0, gain_error]))
