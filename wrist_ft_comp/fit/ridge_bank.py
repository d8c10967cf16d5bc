"""
The 30 candidates of ``auto``: ridge regressions on one pool of columns, each a vector of gains.

A column of the pool is a power of temperature behind a relaxation; with load also a temperature
behind a relaxation times the load, and the load. So every average of fits is such a vector, too.
"""

from typing import NamedTuple

import numpy as np

from wrist_ft_comp.series import FloatArray, IntArray

#: Time constants of the longest bank of relaxations, s; 0 is static.
LONG_BANK_S = (0.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)
#: Time constants of all banks, s. With the longest alone 1.18 times as much drift was left on 620
#: drawn days of 31 kinds.
BANKS_S = {
    'bank to 3000 s': LONG_BANK_S,
    'bank to 60 s': (0.0, 20.0, 60.0),
    'bank to 600 s': (0.0, 100.0, 600.0),
}
#: Time constants of the pool, increasing, s, shape (K,).
POOL_S: FloatArray = np.unique(np.concatenate([*BANKS_S.values()]))
#: Ridge of the banks, relative to the diagonal; the static fit takes the weakest.
STRENGTHS = (1e-2, 1e-4, 1e-6)
#: The variance that a gain has before any data falls by this factor with every degree.
DEGREE_PENALTY = 10.0


class RidgeFit(NamedTuple):
    """A candidate: its name for people, relaxations and highest power, and its ridge."""

    name: str
    bank_s: tuple[float, ...]
    degree: int
    strength: float


def candidates(highest_degree: int) -> list[RidgeFit]:
    """List the candidates, the simplest first: ten for each degree."""
    fits = []
    for degree in range(1, highest_degree + 1):
        fits.append(RidgeFit(f'static, degree {degree}', (0.0,), degree, STRENGTHS[-1]))
        fits += [
            RidgeFit(f'{name}, degree {degree}', bank_s, degree, strength)
            for name, bank_s in BANKS_S.items()
            for strength in STRENGTHS
        ]
    return fits


class Pool(NamedTuple):
    """How the columns of the pool are laid out: by relaxation, power, thermometer; then loads."""

    highest_degree: int
    thermometers: int
    loaded: bool

    def fit(self, candidate: RidgeFit, normal: FloatArray) -> FloatArray:
        """
        Fit a candidate to centred sums of products, (P + 1, P + 1).

        The result, (P + 1,), holds gains of the whole pool and, last, -1 for r - w. Powers up to
        the degree explain zero drift, the first one sensitivity drift.
        """
        # The columns that the candidate uses, and the power of temperature in each.
        width, j = self.highest_degree * self.thermometers, np.arange(self.thermometers)
        banks = np.searchsorted(POOL_S, candidate.bank_s)[:, np.newaxis] * width
        places: IntArray = (banks + np.arange(candidate.degree * self.thermometers)).ravel()
        powers: IntArray = places % width // self.thermometers + 1
        if self.loaded:
            half = len(POOL_S) * width
            places = np.concatenate((places, (half + banks + j).ravel(), [2 * half]))
            powers = np.append(powers, np.ones(len(places) - len(powers), dtype=int))
        diagonal = np.diagonal(normal)[places]
        size = 1 / np.sqrt(np.where(diagonal > 0, diagonal, np.inf))
        size = size * DEGREE_PENALTY ** (-(powers - 1) / 2)
        scaled = normal[np.ix_(places, places)] * np.outer(size, size)
        ridge = candidate.strength * np.eye(len(places))
        gains = np.zeros(len(normal))
        gains[places] = np.linalg.solve(scaled + ridge, normal[places, -1] * size) * size
        gains[-1] = -1.0
        return gains
