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

import numpy as np

from wrist_ft_comp.identification.moments import Moments
from wrist_ft_comp.identification.regression import least_squares
from wrist_ft_comp.model.signals import FloatArray


@dataclass(frozen=True)
class Structure:
    """Powers of temperature up to the degree (hats count as 1) behind free time constants."""

    name: str
    degree: int
    free_time_constants: int


def best_on_grid(moments: Moments, structure: Structure, inputs: int) -> FloatArray:
    """Find the time constants on the grid, s, behind which the first inputs explain most."""
    grid = moments.time_constants_s
    choices = list(combinations(range(1, len(grid)), structure.free_time_constants))
    candidates = np.stack([moments.columns(choice, inputs) for choice in choices])
    _, rss = least_squares(moments.centred(moments.everything), candidates)
    return grid[list(choices[int(np.argmin(rss))])]
