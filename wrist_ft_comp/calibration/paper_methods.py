"""The two-step methods in competition: held-out blocks choose the number of latents."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from wrist_ft_comp.calibration.cross_validation import (
    block_bins,
    block_errors,
    BlockBins,
    hold_out,
    unexplained,
)
from wrist_ft_comp.calibration.result import AxisFit, finish, Fitted, simplest_good
from wrist_ft_comp.calibration.settings import build_features, IdentificationSettings
from wrist_ft_comp.identification.pls_arx import identify, OuterInnerMethod
from wrist_ft_comp.identification.problem import AxisProblem
from wrist_ft_comp.model.axis_model import AxisModel
from wrist_ft_comp.model.features import Features
from wrist_ft_comp.model.signals import FloatArray

_MAX_LATENTS = 8


_Fit = Callable[[AxisProblem], Fitted]


def identify_two_step(
    problem: AxisProblem,
    settings: IdentificationSettings,
    methods: Sequence[OuterInnerMethod | Literal['none']],
) -> AxisFit:
    """
    Let held-out blocks choose among two-step methods and their numbers of latents.

    Parameters
    ----------
    problem : AxisProblem
        Drift observations.
    settings : IdentificationSettings
        Features and orders.
    methods : sequence of str
        Those that compete; "none" stands for no compensation.

    Returns
    -------
    AxisFit
        The winner, and everything that was tried.

    Raises
    ------
    TooShortError
        When an ARX does not find enough consecutive samples.

    """
    candidates: dict[str, _Fit] = {'none': lambda _: Fitted(None)}
    for method in methods:
        if method != 'none':
            for r in _latents_to_try(settings, _features(problem, settings), method):
                name = f'{method}, {r} latent{"s" * (r > 1)}'
                candidates[name] = partial(_fit_two_step, settings, method, r)
    errors = {name: _held_out(problem, fit) for name, fit in candidates.items()}
    competing = [name for name in candidates if name != 'none' or 'none' in methods]
    chosen = competing[simplest_good([errors[name] for name in competing])]
    fit = finish(problem, candidates[chosen](problem), chosen, errors, competing)
    before, after = (partial(_bins, problem, candidates[name]) for name in ('none', chosen))
    return replace(fit, held_out=hold_out(problem, before, after))


def _features(problem: AxisProblem, settings: IdentificationSettings) -> Features:
    """Build the features of a problem, with knots only where there are samples."""
    observed = [
        temperature_c[np.isfinite(residual)]
        for temperature_c, residual in zip(problem.temperature_c, problem.residual, strict=True)
    ]
    return build_features(problem.temperature_c, settings, observed)


def _fit_two_step(
    settings: IdentificationSettings, method: OuterInnerMethod, latents: int, part: AxisProblem
) -> Fitted:
    """Fit one candidate to what is not held out."""
    features = _features(part, settings)
    orders = replace(settings.orders, latents=latents)
    dynamics, notes = identify(method, part, features, orders)
    return Fitted(None if dynamics is None else AxisModel(features, dynamics), notes=notes)


def _latents_to_try(
    settings: IdentificationSettings, features: Features, method: OuterInnerMethod
) -> Sequence[int]:
    """List numbers of latents; hats take all, so that every knot keeps its own coefficients."""
    if settings.latents is not None:
        return [settings.latents]
    width = features.expand(features.reference_c).shape[0]
    if method == 'filtered_pls':
        # Hats behind a bank of filters are too many and too alike for each to keep its own.
        return range(1, min(width * len(settings.orders.time_constants_s), _MAX_LATENTS) + 1)
    return [width] if features.kind == 'hats' else range(1, min(width, _MAX_LATENTS) + 1)


def _held_out(problem: AxisProblem, fit: _Fit) -> FloatArray:
    """Fit without each block in turn and score it there: mean square errors, shape (parts,)."""
    errors: list[float] = []
    for block in problem.block_numbers:
        errors += block_errors(problem, _left(problem, fit, block), block)
    return np.array(errors)


def _left(problem: AxisProblem, fit: _Fit, block: int) -> list[FloatArray]:
    """Leave of r - w what a fit to the other blocks does not explain, shapes (N_i,)."""
    return unexplained(problem, fit(problem.without(block)).model)


def _bins(problem: AxisProblem, fit: _Fit, block: int) -> list[BlockBins]:
    """Return the errors on a block of a fit to the others."""
    return block_bins(problem, _left(problem, fit, block), block)
