"""
The inner model: one ARX per latent (eq. 15 and 20), and its free run.

    u(k) = -a_1 u(k-1) - … - a_n u(k-n) + b_0 t(k-g) + b_1 t(k-g-1) + … + b_{m-1} t(k-g-m+1)

``g`` is the first lag: the paper's φ starts at t(k-d-1), so g = d + 1 there; g = d with a direct
term. A static latent is n = 0, m = 1, g = 0. What runs feeds back its own past outputs.
"""

from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.errors import ModelFileError
from wrist_ft_comp.ranges import check_range
from wrist_ft_comp.series import FloatArray

#: Most coefficients and longest first lag, cells, of a file's filter: poles and states are
#: computed from them before it can run.
_MOST_COEFFICIENTS = 100
_LONGEST_LAG = 1000


@dataclass(frozen=True, eq=False)
class Arx:
    """Coefficients of one latent's ARX, signs as in the module's equation."""

    #: Feedback on past outputs, shape (n,).
    a: FloatArray
    #: Gains on inputs, b[0] on t(k - first_lag), shape (m,).
    b: FloatArray
    #: g, in cells; 0 is a direct term.
    first_lag: int = 0

    def __post_init__(self) -> None:
        if self.a.ndim != 1 or self.b.ndim != 1 or not len(self.b):
            raise ModelFileError('a and b must be lists of numbers, b not empty.')
        check_range('first_lag', self.first_lag, 0, _LONGEST_LAG)
        check_range('number of coefficients', max(len(self.a), len(self.b)), 1, _MOST_COEFFICIENTS)

    @property
    def longest_lag(self) -> int:
        """L: how many past cells the next output depends on."""
        return max(len(self.a), self.first_lag + len(self.b) - 1)

    @property
    def poles(self) -> FloatArray:
        """Roots of z^n + a_1 z^(n-1) + … + a_n, complex, shape (n,)."""
        return np.asarray(np.roots(np.concatenate(([1.0], self.a))))

    @property
    def gain(self) -> float:
        """Static gain: output over a constant input, after a long time."""
        return float(np.sum(self.b) / (1.0 + np.sum(self.a)))

    def polynomials(self, order: int) -> tuple[FloatArray, FloatArray]:
        """Numerator and denominator in powers of z⁻¹, shapes (order + 1,), order >= L."""
        numerator, denominator = np.zeros(order + 1), np.zeros(order + 1)
        numerator[self.first_lag : self.first_lag + len(self.b)] = self.b
        denominator[0] = 1.0
        denominator[1 : 1 + len(self.a)] = self.a
        return numerator, denominator

    def resting_state(self, order: int) -> FloatArray:
        """Filter state (transposed direct form II) after a unit input for ever, shape (order,)."""
        numerator, denominator = self.polynomials(order)
        # z_i = Σ_{j > i} (b_j t - a_j u) with t = 1 and u = gain
        remainder = numerator[1:] - denominator[1:] * self.gain
        return np.asarray(np.cumsum(remainder[::-1])[::-1])


def static_gain(gain: float = 1.0) -> Arx:
    """Build the latent without memory: u = gain · t (eq. 10)."""
    return Arx(a=np.zeros(0), b=np.array([gain]))


def relaxation(time_constant_s: float, period_s: float, cells: int = 1) -> Arx:
    """
    Build a first-order lag: pole exp(-h/τ), with a direct term; without memory for τ = 0.

    With bins of m cells it gives its mean over each, one step per bin: pole exp(-m h/τ). It is
    exact for an input that is constant over each cell of length h, or over each bin.
    """
    if time_constant_s == 0:
        return static_gain()
    ratio = np.exp(-period_s / time_constant_s)
    pole = ratio**cells
    if cells == 1:
        return Arx(a=np.array([-pole]), b=np.array([1.0 - pole]))
    # After j cells of a bin the output is t + (s - t) p^j; its mean is t + kept · (s - t).
    kept = ratio * (1.0 - pole) / (cells * (1.0 - ratio))
    return Arx(a=np.array([-pole]), b=np.array([1.0 - kept, kept - pole]))


def free_run(arx: Arx, t: FloatArray) -> FloatArray:
    """
    Run a model on its own past outputs, from the steady state of the first input.

    Its static gain must exist. Scores t have shape (N,) or (N, K), one column per series.
    """
    # Imported here, because only fits call this: what runs live is light.
    from scipy.signal import lfilter  # noqa: PLC0415

    order = arx.longest_lag
    numerator, denominator = arx.polynomials(order)
    if not order:
        return np.asarray(numerator[0] * t)
    start = arx.resting_state(order).reshape((order,) + (1,) * (t.ndim - 1)) * t[:1]
    return np.asarray(lfilter(numerator, denominator, t, axis=0, zi=start)[0])
