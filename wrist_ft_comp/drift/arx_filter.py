"""
The inner model: one ARX per latent (eq. 15 and 20), its free run, and its least squares (eq. 22).

    u(k) = -a_1 u(k-1) - … - a_n u(k-n) + b_0 t(k-g) + b_1 t(k-g-1) + … + b_{m-1} t(k-g-m+1)

``g`` is the first lag: the paper's φ starts at t(k-d-1), so g = d + 1 there; g = d with a direct
term. A static latent is n = 0, m = 1, g = 0. What runs feeds back its own past outputs; measured
ones serve the least squares only.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.errors import SettingsError, TooShortError
from wrist_ft_comp.ranges import check_range
from wrist_ft_comp.signals import FloatArray

#: Poles are kept inside this radius: at h = 1 s, a time constant of 28 h.
MAX_POLE_RADIUS = 1.0 - 1e-5


@dataclass(frozen=True)
class Orders:
    """Pre-determined orders (the paper's last sentence of section 3)."""

    #: R.
    latents: int = 2
    #: n and m of eq. 20, for arx_pls.
    outputs: int = 2
    inputs: int = 2
    #: g: d + 1 of eq. 20, or d with a direct term; cells.
    first_lag: int = 1
    #: Filters before PLS, s, for filtered_pls; 0 passes the input as it is.
    time_constants_s: tuple[float, ...] = (0.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)

    def __post_init__(self) -> None:
        for name, least in (('latents', 1), ('outputs', 0), ('inputs', 1), ('first_lag', 0)):
            check_range(name, getattr(self, name), least)
        if not self.time_constants_s:
            raise SettingsError('time_constants_s must hold at least one filter; got none.')
        for tau in self.time_constants_s:
            check_range('Each of time_constants_s', tau, 0.0)


@dataclass(frozen=True, eq=False)
class Arx:
    """Coefficients of one latent's ARX, signs as in the module's equation."""

    #: Feedback on past outputs, shape (n,).
    a: FloatArray
    #: Gains on inputs, b[0] on t(k - first_lag), shape (m,).
    b: FloatArray
    #: g, in cells; 0 is a direct term.
    first_lag: int = 0

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


def relaxation(time_constant_s: float, period_s: float) -> Arx:
    """
    Build a first-order lag: pole exp(-h/τ), with a direct term; without memory for τ = 0.

    It is exact for an input that is constant over each cell of length h.
    """
    if time_constant_s == 0:
        return static_gain()
    pole = np.exp(-period_s / time_constant_s)
    return Arx(a=np.array([-pole]), b=np.array([1.0 - pole]))


def mean_relaxation(time_constant_s: float, period_s: float, cells: int) -> Arx:
    """
    Build what ``relaxation`` gives on average over bins of m cells, one step per bin.

    Its pole is exp(-m h/τ), its static gain 1; it is exact for an input that is constant over
    each bin.
    """
    if time_constant_s == 0:
        return static_gain()
    ratio = np.exp(-period_s / time_constant_s)
    pole = ratio**cells
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


def regressors(
    t: FloatArray, u: FloatArray, order: int, inputs: int, first_lag: int
) -> tuple[FloatArray, FloatArray]:
    """
    Stack the rows φ(k) of eq. 20 and 22, one per predicted sample, and the outputs u(k).

    Score t and measured output u have shape (N,); where N <= L, TooShortError is raised.

        k = L:    u(L-1) … u(L-n) | t(L-g) … t(L-g-m+1)
        …
        k = N-1:  u(N-2) …        | t(N-1-g) …
    """
    longest = max(order, first_lag + inputs - 1)
    rows = len(t) - longest
    if rows <= 0:
        raise TooShortError(
            f'An ARX with a longest lag of {longest} cells needs more samples than that; '
            f'got {len(t)}. Record longer, or lower the orders.'
        )
    columns = [u[longest - j : longest - j + rows] for j in range(1, order + 1)]
    columns += [t[longest - first_lag - i : longest - first_lag - i + rows] for i in range(inputs)]
    return np.stack(columns, axis=1), u[longest:]


def fit_one_step(
    segments: Sequence[tuple[FloatArray, FloatArray]], order: int, inputs: int, first_lag: int
) -> Arx:
    """
    Fit by least squares on the one-step error over one or several recordings (eq. 21 and 22).

    A segment is score t_r and output u_r of a recording, shapes (N_i,), with an unknown constant
    in u; rows that touch a NaN are left out. Measurement noise biases the fit, and its poles may
    lie outside the unit circle: see ``stabilise``. TooShortError is raised where a segment is
    shorter than the longest lag, or where too few rows are complete.
    """
    parts = []
    for t, u in segments:
        rows, outputs = regressors(t, u, order, inputs, first_lag)
        complete = np.isfinite(rows).all(axis=1) & np.isfinite(outputs)
        if complete.any():
            rows, outputs = rows[complete], outputs[complete]
            parts.append((rows - rows.mean(axis=0), outputs - outputs.mean()))
    if sum(len(outputs) for _, outputs in parts) <= order + inputs:
        raise TooShortError(
            f'An ARX with {order + inputs} coefficients needs more runs of '
            f'{max(order, first_lag + inputs - 1) + 1} consecutive cells with samples than that. '
            'Record without gaps, use a longer thermal period, or choose a static method.'
        )
    phi = np.concatenate([rows for rows, _ in parts])
    target = np.concatenate([outputs for _, outputs in parts])
    # θ (n + m,) = (φᵀφ)⁻¹ φᵀ u  (eq. 22), by an orthogonal factorisation
    theta = np.linalg.lstsq(phi, target, rcond=None)[0]
    return Arx(a=-theta[:order], b=theta[order:], first_lag=first_lag)


def stabilise(arx: Arx) -> tuple[Arx, bool]:
    """Move poles into the unit circle, keeping a static gain; tell whether any was moved."""
    poles = arx.poles
    radius = np.abs(poles).clip(1e-300)  # a pole at 0 has no direction, and stays
    if not len(poles) or radius.max() <= MAX_POLE_RADIUS:
        return arx, False
    inside = poles / radius * np.minimum(np.minimum(radius, 1 / radius), MAX_POLE_RADIUS)
    a = np.real(np.poly(inside))[1:]
    # Mirrored at the circle, 1/|z - p| keeps its shape and grows by |p|; a pole near 1, which has
    # no static gain to speak of, keeps how it sets out.
    b = arx.b / np.prod(np.maximum(radius, 1.0))
    return Arx(a=a, b=b, first_lag=arx.first_lag), True
