"""
Fits on one pool of columns, each a vector of gains: so every average of fits is one, too.

A relaxation is smooth in ln τ. So one between those of the pool's grid is a mixture of its four
neighbours, and free time constants are searched without a pass over the samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

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
        scaled = normal[np.ix_(places, places)] * np.outer(size, size)
        # numpy 1 takes a right side with one dimension less for several vectors.
        right = (normal[places, -1] * size)[np.newaxis, :, np.newaxis]
        ridges = np.multiply.outer(self.strengths, np.eye(len(places)))
        gains = np.zeros((len(self.strengths), len(normal)))
        gains[:, places] = np.linalg.solve(scaled + ridges, right)[..., 0] * size
        gains[:, -1] = -1.0
        return gains


class Mixtures(NamedTuple):
    """C columns of time constants between those of the grid, each mixed from four of the pool."""

    #: Which of the pool's, and their weights, shape (C, 4).
    places: IntArray
    weights: FloatArray
    #: Derivatives of the weights by ln τ, shape (C, 4).
    slopes: FloatArray
    #: Number of the time constant that a column is of, (C,); one more for the load.
    owners: IntArray


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

        def cost(logs: FloatArray) -> float:
            pairs = zip(normals, self._mixtures(moments, logs), strict=True)
            return float(np.sum(np.log([least_squares(*pair)[2] for pair in pairs])))

        guesses = (np.array(logs) for logs in combinations(_LOGS, self.count))
        return min(guesses, key=cost)

    def search(
        self, moments: Sequence[Moments], normals: Sequence[FloatArray], start: FloatArray
    ) -> FloatArray:
        """Find those that leave the least sum over axes of the logarithm of squares: ln τ."""

        def cost(logs: FloatArray) -> tuple[float, FloatArray]:
            total, gradient = 0.0, np.zeros(len(logs))
            for normal, mixtures in zip(normals, self._mixtures(moments, logs), strict=True):
                gains, error, rest = least_squares(normal, mixtures)
                total += np.log(rest)
                by_column = 2 * (mixtures.slopes * error[mixtures.places]).sum(axis=1) * gains
                gradient += np.bincount(mixtures.owners, by_column / rest, len(logs) + 1)[:-1]
            return total, gradient

        bounds = [(_LOGS[0], _LOGS[-1])] * len(start)
        options = {'maxiter': 40}
        found = scipy.optimize.minimize(cost, start, jac=True, bounds=bounds, options=options)
        return np.asarray(found.x)

    def fit(self, moments: Moments, normal: FloatArray, logs: FloatArray) -> FloatArray:
        """Fit an axis: gains of the whole pool and, last, -1 for r - w, (1, P + 1)."""
        (mixtures,) = self._mixtures([moments], logs)
        gains = least_squares(normal, mixtures)[0]
        shares = (mixtures.weights.T * gains).T
        places = mixtures.places.ravel()
        of_pool: FloatArray = np.bincount(places, shares.ravel(), len(normal)).astype(float)
        of_pool[-1] = -1.0
        return of_pool[np.newaxis]

    def _mixtures(self, moments: Sequence[Moments], logs: FloatArray) -> list[Mixtures]:
        """Mix columns of each time constant from those of the grid, for every axis."""
        made = {
            loaded: self._mixed(moments[0].inputs, logs, loaded=loaded)
            for loaded in {axis.loaded for axis in moments}
        }
        return [made[axis.loaded] for axis in moments]

    def _mixed(self, inputs: int, logs: FloatArray, *, loaded: bool) -> Mixtures:
        """Mix columns from a pool with some inputs behind every relaxation; the load is last."""
        half, starts = len(GRID_S) * inputs, np.arange(self.inputs)
        if loaded:
            starts = np.concatenate((starts, half + np.arange(self.gain_inputs)))
        owners = np.repeat(np.arange(len(logs)), len(starts))
        nodes, weights, slopes = interpolate(logs)
        weights, slopes = weights[owners], slopes[owners]
        places: IntArray = nodes[owners] * inputs + np.tile(starts, len(logs))[:, np.newaxis]
        if loaded:
            places = np.vstack((places, np.full(4, 2 * half)))
            weights, slopes = np.vstack((weights, [1, 0, 0, 0])), np.vstack((slopes, np.zeros(4)))
            owners = np.append(owners, len(logs))
        return Mixtures(places, weights, slopes, owners)


def interpolate(logs: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """
    Mix relaxations from the grid's by a cubic in ln τ.

    Return the positions of the four that are near to each ln τ, (n,), their weights, and the
    derivatives of these by ln τ, (n, 4).
    """
    step = np.log(_RATIO)
    position = (logs - _LOGS[0]) / step
    first = np.clip(np.floor(position).astype(int) - 1, 0, len(_LOGS) - 4)
    powers = np.vander(position - first, 4, increasing=True)
    slopes = np.zeros_like(powers)
    slopes[:, 1:] = powers[:, :-1] * (1.0, 2.0, 3.0) / step
    return first[:, np.newaxis] + np.arange(1, 5), powers @ _CUBICS, slopes @ _CUBICS


def least_squares(
    normal: FloatArray, mixtures: Mixtures | None = None
) -> tuple[FloatArray, FloatArray, float]:
    """
    Regress r - w on mixtures of the pool's columns, or on all, by their products, (P + 1, P + 1).

    Return the gains, (C,), the products of the error with all columns of the pool, (P,), and the
    sum of squares that remains.
    """
    places: IntArray = np.arange(len(normal) - 1)[:, np.newaxis]
    weights: FloatArray = np.ones(places.shape)
    if mixtures is not None:
        places, weights = mixtures.places, mixtures.weights
    rows = np.einsum('cmp,cm->cp', normal[places], weights)
    gram, right = np.einsum('cdm,dm->cd', rows[:, places], weights), rows[:, -1]
    power = np.diagonal(gram)
    size = np.sqrt(np.where(power > 0, power, np.inf))
    scaled = gram / np.outer(size, size) + _TINY_RIDGE * np.eye(len(gram))
    gains = np.linalg.solve(scaled, right / size) / size
    rest = normal[-1, -1] - 2 * gains @ right + gains @ gram @ gains
    error = gains @ rows - normal[-1]
    return gains, error[:-1], max(float(rest), 1e-12 * float(normal[-1, -1]), 1e-300)


def jackknife_errors(estimates: Sequence[FloatArray]) -> FloatArray:
    """Estimate standard errors of what was fitted without each fold in turn, shapes (…) to (…)."""
    spread = (len(estimates) - 1) * np.var(estimates, axis=0)
    return np.asarray(np.sqrt(spread))


def time_constant_errors(tau_s: FloatArray, held_out_s: Sequence[FloatArray]) -> FloatArray:
    """Estimate standard errors of time constants, (K,), by those without each fold in turn, s."""
    return np.asarray(np.hypot(jackknife_errors(held_out_s), _MIXED * tau_s))
