"""
Fits on one pool of columns, each a vector of gains: so every average of fits is one, too.

A relaxation is smooth in ln τ. So one between those of the pool's grid is a mixture of its four
neighbours, and free time constants are searched without a pass over the samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import scipy  # which loads its parts when they are used

from wrist_ft_comp.fit.moments import Moments
from wrist_ft_comp.signals import FloatArray, IntArray

#: Ratio of neighbours on the grid.
_RATIO = 1.6
#: Shortest relaxation of the grid, s.
_SHORTEST_S = 20.0
#: τ, s, shape (K,): static, then 20 s to an hour and a half.
GRID_S: FloatArray = np.array([0.0, *(_SHORTEST_S * _RATIO**k for k in range(13))])
_LOGS = np.log(GRID_S[1:])
#: The variance that a gain has before any data falls by this factor with every degree.
_DEGREE_PENALTY = 10.0
#: Just enough ridge to solve for free time constants, relative to the diagonal.
_TINY_RIDGE = 1e-7
#: A relaxation that is a mixture of the grid's has its time constant up to this share.
_MIXED = 0.005
#: Coefficients of cubics that are 1 at one of the places 0 to 3, and 0 at the others: (4, 4).
_CUBICS = np.linalg.inv(np.vander(np.arange(4.0), increasing=True))


def near(*taus_s: float) -> tuple[int, ...]:
    """Find the positions on the grid nearest to time constants."""
    return tuple(
        int(np.argmin(np.abs(np.log((GRID_S + 1.0) / (tau_s + 1.0))))) for tau_s in taus_s
    )


@dataclass(frozen=True)
class RidgeBank:
    """
    A bank on the grid in ridge, at some strengths relative to the diagonal.

    Powers up to the degree explain zero drift, the first one sensitivity drift.
    """

    degree: int
    thermometers: int
    bank: tuple[int, ...]
    strengths: tuple[float, ...]

    def fit(self, moments: Moments, normal: FloatArray) -> FloatArray:
        """Fit an axis: gains of the whole pool and, last, -1 for r - w, (S, P + 1)."""
        zero = self.degree * self.thermometers
        places = moments.columns(self.bank, zero, self.thermometers)
        powers = np.ones(len(places))
        powers[: len(self.bank) * zero] = np.tile(
            np.repeat(np.arange(1, self.degree + 1), self.thermometers), len(self.bank)
        )
        diagonal = np.diagonal(normal)[places]
        size = 1 / np.sqrt(np.where(diagonal > 0, diagonal, np.inf))
        size = size * _DEGREE_PENALTY ** (-(powers - 1) / 2)
        values, vectors = np.linalg.eigh(normal[np.ix_(places, places)] * np.outer(size, size))
        right = vectors.T @ (normal[places, -1] * size)
        damped = right / (np.maximum(values, 0) + np.array(self.strengths)[:, np.newaxis])
        gains = np.zeros((len(self.strengths), len(normal)))
        gains[:, places] = (damped @ vectors.T) * size
        gains[:, -1] = -1.0
        return gains


@dataclass(frozen=True)
class FreeTimeConstants:
    """Some free time constants, shared by axes whose moments are alike but for the load."""

    #: How many of the pool's features explain zero drift, and how many sensitivity drift.
    inputs: int
    gain_inputs: int
    #: How many time constants.
    count: int

    def first_guess(self, moments: Sequence[Moments], normals: Sequence[FloatArray]) -> FloatArray:
        """Try all combinations on the grid: ln τ, (count,)."""

        def cost(bank: Sequence[int]) -> float:
            total = 0.0
            for axis, normal in zip(moments, normals, strict=True):
                columns = axis.columns(bank, self.inputs, self.gain_inputs)
                mixtures = np.eye(len(normal) - 1)[:, columns]
                total += float(np.log(least_squares(normal, mixtures)[2]))
            return total

        best = min(combinations(range(1, len(GRID_S)), self.count), key=cost)
        return np.asarray(_LOGS[np.array(best) - 1])

    def search(
        self, moments: Sequence[Moments], normals: Sequence[FloatArray], start: FloatArray
    ) -> FloatArray:
        """Find those that leave the least sum over axes of the logarithm of squares: ln τ."""

        def cost(logs: FloatArray) -> tuple[float, FloatArray]:
            total, gradient = 0.0, np.zeros(len(logs))
            for axis, normal in zip(moments, normals, strict=True):
                mixtures, slopes, owners = self._mixtures(axis, logs)
                weights, gains, rest = least_squares(normal, mixtures)
                total += np.log(rest)
                error = normal[:-1, :-1] @ gains - normal[:-1, -1]
                by_column = 2 * (slopes.T @ error) * weights
                gradient += np.bincount(owners, by_column / rest, len(logs) + 1)[: len(logs)]
            return total, gradient

        bounds = [(_LOGS[0], _LOGS[-1])] * len(start)
        options = {'maxiter': 40}
        found = scipy.optimize.minimize(cost, start, jac=True, bounds=bounds, options=options)
        return np.asarray(found.x)

    def fit(self, moments: Moments, normal: FloatArray, logs: FloatArray) -> FloatArray:
        """Fit an axis: gains of the whole pool and, last, -1 for r - w, (1, P + 1)."""
        mixtures, _, _ = self._mixtures(moments, logs)
        return np.append(least_squares(normal, mixtures)[1], -1.0)[np.newaxis]

    def _mixtures(
        self, moments: Moments, logs: FloatArray
    ) -> tuple[FloatArray, FloatArray, IntArray]:
        """Write columns as mixtures of the pool, (P, C), their slopes, and which τ each is of."""
        half, width = len(GRID_S) * moments.inputs, moments.products.shape[1] - 1
        starts = list(range(self.inputs))
        if moments.loaded:
            starts += [half + first for first in range(self.gain_inputs)]
        mixtures = np.zeros((width, len(logs) * len(starts) + moments.loaded))
        slopes = np.zeros_like(mixtures)
        for owner, log_tau in enumerate(logs):
            weights, derivatives = interpolate(float(log_tau))
            for number, first in enumerate(starts, owner * len(starts)):
                rows = slice(first, first + half, moments.inputs)
                mixtures[rows, number], slopes[rows, number] = weights, derivatives
        owners = np.repeat(np.arange(len(logs)), len(starts))
        if moments.loaded:
            mixtures[2 * half, -1] = 1.0
            owners = np.append(owners, len(logs))
        return mixtures, slopes, owners


def interpolate(log_tau: float) -> tuple[FloatArray, FloatArray]:
    """Weights (K,) of the grid's relaxations for one between them, and their derivative."""
    step = np.log(_RATIO)
    position = (log_tau - _LOGS[0]) / step
    first = int(np.clip(np.floor(position) - 1, 0, len(_LOGS) - 4))
    at = position - first
    weights, slopes = np.zeros(len(GRID_S)), np.zeros(len(GRID_S))
    nodes = slice(1 + first, 5 + first)
    weights[nodes] = np.array([1.0, at, at**2, at**3]) @ _CUBICS
    slopes[nodes] = np.array([0.0, 1.0, 2 * at, 3 * at**2]) @ _CUBICS / step
    return weights, slopes


def least_squares(
    normal: FloatArray, mixtures: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """
    Regress r - w on mixtures, (P, C), of the pool's columns, by their products, (P + 1, P + 1).

    Return gains of the mixtures, (C,), and of the pool's columns, (P,), and the sum of squares
    that remains.
    """
    gram, right = normal[:-1, :-1], normal[:-1, -1]
    projected = gram @ mixtures
    power = np.einsum('pc,pc->c', mixtures, projected)
    size = np.sqrt(np.where(power > 0, power, np.inf))
    inner = mixtures.T @ projected / np.outer(size, size)
    scaled = np.linalg.solve(inner + _TINY_RIDGE * np.eye(len(inner)), mixtures.T @ right / size)
    weights = scaled / size
    gains = mixtures @ weights
    rest = normal[-1, -1] - 2 * gains @ right + gains @ gram @ gains
    return weights, gains, max(float(rest), 1e-12 * float(normal[-1, -1]), 1e-300)


def jackknife_errors(estimates: Sequence[FloatArray]) -> FloatArray:
    """Estimate standard errors of what was fitted without each fold in turn, shapes (…) to (…)."""
    spread = (len(estimates) - 1) * np.var(estimates, axis=0)
    return np.asarray(np.sqrt(spread))


def time_constant_errors(tau_s: FloatArray, held_out_s: Sequence[FloatArray]) -> FloatArray:
    """Estimate standard errors of time constants, (K,), by those without each fold in turn, s."""
    return np.asarray(np.hypot(jackknife_errors(held_out_s), _MIXED * tau_s))
