"""
Fits on the simulation error (eq. 16): relaxations with free or fixed time constants.

Thermal diffusion has no other dynamics than relaxations H_τ, so the drift is

    r - w = Σ_τ Σ_f g_τf x_f(H_τ T)  +  w · Σ_τ Σ_f k_τf x_f(H_τ T)  +  s_0 w  +  constant

with the features x_f of every relaxation's temperatures; for given time constants everything else
is linear. All candidates are fitted from one matrix of moments whose columns hold every feature
behind every relaxation of a grid of time constants.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from wrist_ft_comp.identification.moments import Moments
from wrist_ft_comp.identification.regression import least_squares, Path, pls_path, ridge_path
from wrist_ft_comp.model.signals import BoolArray, FloatArray, IntArray

_REGRESSIONS: dict[str, Path] = {
    'least squares': lambda products, columns: least_squares(products, columns)[0][np.newaxis],
    'ridge': ridge_path,
    'PLS': pls_path,
}


@dataclass(frozen=True)
class Structure:
    """
    A candidate: which columns may explain the drift, with a name for people.

    Powers of temperature take part up to the degree (hats count as 1), behind time constants that
    are searched or those of a fixed bank, s; without either it is static. Held-out folds choose
    the strength of ridge and PLS.
    """

    name: str
    degree: int
    free_time_constants: int = 0
    bank_s: tuple[float, ...] = ()
    regression: Literal['least squares', 'ridge', 'PLS'] = 'least squares'


def fit_columns(
    moments: Moments, structure: Structure, keep: BoolArray, inputs: int
) -> tuple[IntArray, FloatArray]:
    """
    Fit a candidate with its first inputs to the entries that are kept.

    Return its columns, (p,), and their coefficients, (S, p), for every strength of the regression,
    the most regularised first; S is 1 for least squares.
    """
    products = moments.centred(keep)
    grid = moments.time_constants_s
    if not structure.free_time_constants:
        fixed = structure.bank_s or (0.0,)
        columns = moments.columns([int(np.argmin(np.abs(grid - t))) for t in fixed], inputs)
        return columns, _REGRESSIONS[structure.regression](products, columns)
    choices = list(combinations(range(1, len(grid)), structure.free_time_constants))
    candidates = np.stack([moments.columns(choice, inputs) for choice in choices])
    coefficients, rss = least_squares(products, candidates)
    best = int(np.argmin(rss))
    return candidates[best], coefficients[best][np.newaxis]
