"""
Outer and inner model together: the paper's ARX-PLS (eq. 15), and the ARX of each latent (eq. 20).

    x(k)  features                               (F,)
    t(k) = Rᵀ [(x(k) - x̄) ∘ W_x]                 (R,)   eq. 4; R = W (PᵀW)⁻¹
    u_r(k) = H_r(t_r)                            (R,)   eq. 15 and 20, one ARX per latent
    y(k) = ȳ + [Q u(k)] / W_y                    (M,)   eq. 15

H_r is, with its static gain and its free run,

    u(k) = -a_1 u(k-1) - … - a_n u(k-n) + b_0 t(k-g) + b_1 t(k-g-1) + … + b_{m-1} t(k-g-m+1)

``g`` is the first lag: the paper's φ starts at t(k-d-1), so g = d + 1 there; g = d with a direct
term. A static latent is n = 0, m = 1, g = 0. What runs feeds back its own past outputs.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wrist_ft_comp.errors import check_part, check_range
from wrist_ft_comp.series import FloatArray

#: Most coefficients and longest first lag, cells, of a file's filter: poles and states are
#: computed from them before it can run.
_MOST_COEFFICIENTS = 100
_LONGEST_LAG = 1000
#: Up to this many cells, stepping all latents at once is faster than filtering each of them: with
#: 28 latents one cell takes a sixth of the time, and 40 cells take as long.
_BLOCK = 32
#: Cells that are skipped at once: what is left of each of them stays within a processor's cache.
_SKIPPED_AT_ONCE = 1024


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
        check_part(self.a.ndim == 1 and self.b.ndim == 1 and len(self.b) > 0, 'shape of a or b')
        check_range('first_lag', self.first_lag, 0, _LONGEST_LAG)
        check_range('number of coefficients', max(len(self.a), len(self.b)), 1, _MOST_COEFFICIENTS)

    @property
    def longest_lag(self) -> int:
        """L: how many past cells the next output depends on."""
        return max(len(self.a), self.first_lag + len(self.b) - 1)

    @cached_property
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


@dataclass(frozen=True, eq=False)
class ArxPls:
    """An identified dynamic model from F inputs through R latents to M outputs."""

    #: x̄, unit of the inputs, and the diagonal of W_x, one over it, shape (F,).
    input_mean: FloatArray
    input_weight: FloatArray
    #: W (PᵀW)⁻¹, without unit, shape (F, R).
    rotations: FloatArray
    #: H_r.
    latents: tuple[Arx, ...]
    #: Q, without unit, shape (M, R).
    output_loadings: FloatArray
    #: Diagonal of W_y, one over the unit of the outputs, and ȳ, shape (M,).
    output_weight: FloatArray
    output_mean: FloatArray

    def __post_init__(self) -> None:
        inputs, latents, outputs = len(self.input_mean), len(self.latents), len(self.output_mean)
        for name, array, shape in (
            ('input_mean', self.input_mean, (inputs,)),
            ('input_weight', self.input_weight, (inputs,)),
            ('rotations', self.rotations, (inputs, latents)),
            ('output_loadings', self.output_loadings, (outputs, latents)),
            ('output_weight', self.output_weight, (outputs,)),
            ('output_mean', self.output_mean, (outputs,)),
        ):
            check_part(array.shape == shape, f'shape of {name}')
        check_part(bool((self.output_weight > 0).all()), 'output_weight')
        for latent in self.latents:  # with a pole of radius 1, its free run would not end
            check_part(bool((np.abs(latent.poles) < 1).all()), 'a pole')

    @cached_property
    def _filters(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Numerators and denominators (R, L + 1) and unit resting states (R, L) of all latents."""
        order = max((latent.longest_lag for latent in self.latents), default=0)
        shape = (len(self.latents), order + 1)
        numerators, denominators, resting = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        for r, latent in enumerate(self.latents):
            numerators[r], denominators[r] = latent.polynomials(order)
            resting[r, :order] = latent.resting_state(order)
        return numerators, denominators, resting[:, :order]

    @property
    def state_shape(self) -> tuple[int, ...]:
        """Latents R and longest lag L: the shape of the filter state."""
        return self._filters[2].shape

    def start(self, x: FloatArray) -> FloatArray:
        """State, shape (R, L), after inputs x, shape (F,), for ever: a soaked robot."""
        return self._filters[2] * self._scores(x)[:, np.newaxis]

    def run(self, state: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """
        Advance by N cells: inputs (N, F), outputs (N, M).

        The state is that of filters in transposed direct form II. A few cells are stepped, all
        latents at once; many, as in files, are filtered latent by latent.
        """
        numerators, denominators, _ = self._filters
        t = self._scores(x)
        if not (len(x) and state.shape[1]):
            return state, self._outputs(numerators[:, 0] * t)
        if len(x) <= max(_BLOCK, state.shape[1]):
            u = np.empty_like(t)
            for k in range(len(t)):
                u[k] = numerators[:, 0] * t[k] + state[:, 0]
                delayed = numerators[:, 1:] * t[k, :, np.newaxis]
                fed_back = denominators[:, 1:] * u[k, :, np.newaxis]
                shifted = np.zeros_like(state)
                shifted[:, :-1] = state[:, 1:]
                state = shifted + delayed - fed_back
            return state, self._outputs(u)
        # Imported here: only recordings are filtered at once, and the node starts without scipy.
        from scipy.signal import lfilter  # noqa: PLC0415

        series = np.ascontiguousarray(t.T)  # (R, N)
        after = np.empty_like(state)
        for r in range(len(self.latents)):
            series[r], after[r] = lfilter(numerators[r], denominators[r], series[r], zi=state[r])
        return after, self._outputs(series.T)

    def skip(self, state: FloatArray, x: FloatArray, cells: int = 1) -> FloatArray:
        """
        Advance by N inputs, (N, F), each constant for some cells; the state after them, (R, L).

        It is the sum of what is left of each, z(N) = Aᴺ z(0) + Σ Aᴺ⁻¹⁻ᵏ (1 - A) z∞(k), where z∞ is
        the resting state. That takes a hundredth of the time of ``run``.
        """
        _, denominators, resting = self._filters
        rows, lags = self.state_shape
        if not lags:
            return state
        one_cell = np.tile(np.eye(lags, k=1), (rows, 1, 1))  # A, (R, L, L)
        one_cell[:, :, 0] -= denominators[:, 1:]
        power = one_input = np.linalg.matrix_power(one_cell, cells)
        # What is left of each input in the end, (R, L, inputs), of the last one last.
        left = resting[..., np.newaxis] - one_input @ resting[..., np.newaxis]
        while left.shape[2] < min(len(x), _SKIPPED_AT_ONCE):
            left = np.concatenate((power @ left, left), axis=2)
            power = power @ power
        for t in np.split(self._scores(x), range(_SKIPPED_AT_ONCE, len(x), _SKIPPED_AT_ONCE)):
            before = np.linalg.matrix_power(one_input, len(t)) @ state[..., np.newaxis]
            state = before[..., 0] + np.einsum('rln,nr->rl', left[..., -len(t) :], t)
        return state

    def _scores(self, x: FloatArray) -> FloatArray:
        """Compute t from inputs x, shapes (..., F) to (..., R) (eq. 4)."""
        return np.asarray(((x - self.input_mean) * self.input_weight) @ self.rotations)

    def _outputs(self, u: FloatArray) -> FloatArray:
        """Compute y from u, shapes (..., R) to (..., M) (eq. 15)."""
        return np.asarray(self.output_mean + (u @ self.output_loadings.T) / self.output_weight)
