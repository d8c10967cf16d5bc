"""
The inner model: one ARX per latent (eq. 15 and 20), its least squares (eq. 22) and its free run.

    u(k) = -a_1 u(k-1) - … - a_n u(k-n) + b_0 t(k-g) + b_1 t(k-g-1) + … + b_{m-1} t(k-g-m+1)

``g`` is the first lag: the paper's φ starts at t(k-d-1), so g = d + 1 there; g = d with a direct
term. A static latent is n = 0, m = 1, g = 0.

Two functions predict, and they are not interchangeable: ``predict_one_step`` feeds back measured
outputs and serves identification only; ``free_run`` feeds back its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from wrist_ft_comp.errors import TooShortError
from wrist_ft_comp.model.signals import FloatArray


@dataclass(frozen=True)
class Orders:
    """
    Pre-determined orders (the paper's last sentence of section 3).

    Attributes
    ----------
    latents : int
        R.
    outputs, inputs : int
        n and m of eq. 20, for arx_pls.
    first_lag : int
        g: d + 1 of eq. 20, or d with a direct term; cells.
    time_constants_s : tuple of float
        Filters before PLS, s, for filtered_pls; 0 passes the input as it is.

    """

    latents: int = 2
    outputs: int = 2
    inputs: int = 2
    first_lag: int = 1
    time_constants_s: tuple[float, ...] = (0.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)


#: Poles are kept inside this radius: at h = 1 s, a time constant of 28 h.
MAX_POLE_RADIUS = 1.0 - 1e-5


@dataclass(frozen=True, eq=False)
class Arx:
    """
    Coefficients of one latent's ARX.

    Attributes
    ----------
    a : ndarray, shape (n,)
        Feedback on past outputs, sign as in the module's equation.
    b : ndarray, shape (m,)
        Gains on inputs, b[0] on t(k - first_lag).
    first_lag : int
        g, in cells; 0 is a direct term.

    """

    a: FloatArray
    b: FloatArray
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
        """
        Write the transfer function in powers of z⁻¹, both padded to order + 1 coefficients.

        Parameters
        ----------
        order : int
            At least longest_lag.

        Returns
        -------
        tuple of two ndarrays, shape (order + 1,)
            Numerator and denominator; the denominator starts with 1.

        """
        numerator, denominator = np.zeros(order + 1), np.zeros(order + 1)
        numerator[self.first_lag : self.first_lag + len(self.b)] = self.b
        denominator[0] = 1.0
        denominator[1 : 1 + len(self.a)] = self.a
        return numerator, denominator


def static_gain(gain: float = 1.0) -> Arx:
    """Build the latent without memory: u = gain · t (eq. 10)."""
    return Arx(a=np.zeros(0), b=np.array([gain]))


def relaxation(time_constant_s: float, period_s: float, gain: float = 1.0) -> Arx:
    """
    Build a first-order lag, exact for an input that is constant over each cell.

    Parameters
    ----------
    time_constant_s : float
        τ, s; 0 gives a static gain.
    period_s : float
        Cell length h, s.
    gain : float
        Static gain.

    Returns
    -------
    Arx
        Pole exp(-h/τ), with a direct term.

    """
    if time_constant_s == 0:
        return static_gain(gain)
    pole = np.exp(-period_s / time_constant_s)
    return Arx(a=np.array([-pole]), b=np.array([gain * (1.0 - pole)]))


def mean_relaxation(time_constant_s: float, period_s: float, cells: int) -> Arx:
    """
    Build what ``relaxation`` gives on average over bins of cells, from the bins' inputs.

    Exact for an input that is constant over each bin.

    Parameters
    ----------
    time_constant_s : float
        τ, s; 0 gives a static gain.
    period_s : float
        Cell length h, s.
    cells : int
        Cells per bin.

    Returns
    -------
    Arx
        Of one step per bin: pole exp(-m h/τ), with a direct term, static gain 1.

    """
    if time_constant_s == 0:
        return static_gain()
    ratio = np.exp(-period_s / time_constant_s)
    pole = ratio**cells
    # After j cells of a bin the output is t + (s - t) p^j; its mean is t + kept · (s - t).
    kept = ratio * (1.0 - pole) / (cells * (1.0 - ratio))
    return Arx(a=np.array([-pole]), b=np.array([1.0 - kept, kept - pole]))


def regressors(
    t: FloatArray, u: FloatArray, order: int, inputs: int, first_lag: int
) -> tuple[FloatArray, FloatArray]:
    """
    Stack the rows φ(k) of eq. 20 and 22, one per predicted sample.

        k = L:  u(L-1) … u(L-n) | t(L-g) … t(L-g-m+1)
        …                       |
        k = N-1:                |

    Parameters
    ----------
    t : ndarray, shape (N,)
        Latent score t_r.
    u : ndarray, shape (N,)
        Latent output u_r, measured.
    order : int
        n, number of past outputs.
    inputs : int
        m, number of inputs.
    first_lag : int
        g, lag of the newest input, cells.

    Returns
    -------
    tuple of ndarrays, shapes (N - L, n + m) and (N - L,)
        Regressors, and the outputs they explain; L is the longest lag.

    Raises
    ------
    TooShortError
        When N <= L.

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
    Least squares on the one-step error over one or several recordings (eq. 21 and 22).

    Measurement noise biases it, and its poles may lie outside the unit circle; see ``stabilise``.

    Parameters
    ----------
    segments : sequence of pairs of ndarrays, shape (N_i,)
        Score t_r and output u_r of each recording; each has its own unknown constant in u. Rows
        that touch a NaN are left out.
    order, inputs, first_lag : int
        As for regressors.

    Returns
    -------
    Arx
        The coefficients θ_r, a with the sign of the module's equation.

    Raises
    ------
    TooShortError
        When a segment is shorter than the longest lag, or too few rows are complete.

    """
    blocks = []
    for t, u in segments:
        rows, outputs = regressors(t, u, order, inputs, first_lag)
        complete = np.isfinite(rows).all(axis=1) & np.isfinite(outputs)
        if complete.any():
            rows, outputs = rows[complete], outputs[complete]
            blocks.append((rows - rows.mean(axis=0), outputs - outputs.mean()))
    if sum(len(outputs) for _, outputs in blocks) <= order + inputs:
        raise TooShortError(
            f'An ARX with {order + inputs} coefficients needs more runs of '
            f'{max(order, first_lag + inputs - 1) + 1} consecutive cells with samples than that. '
            'Record without gaps, use a longer thermal period, or choose a static method.'
        )
    phi = np.concatenate([rows for rows, _ in blocks])
    target = np.concatenate([outputs for _, outputs in blocks])
    # θ (n + m,) = (φᵀφ)⁻¹ φᵀ u  (eq. 22), by an orthogonal factorisation
    theta = np.linalg.lstsq(phi, target, rcond=None)[0]
    return Arx(a=-theta[:order], b=theta[order:], first_lag=first_lag)


def stabilise(arx: Arx) -> tuple[Arx, bool]:
    """
    Move poles that lie outside the unit circle inside, keeping the static gain where it exists.

    Parameters
    ----------
    arx : Arx
        As fitted.

    Returns
    -------
    tuple of Arx and bool
        The model, and whether anything was moved.

    """
    poles = arx.poles
    radius = np.abs(poles)
    if not len(poles) or radius.max() <= MAX_POLE_RADIUS:
        return arx, False
    reflected = np.where(radius > 1, 1 / np.maximum(radius, 1e-300), radius)
    inside = poles / radius.clip(1e-300) * np.minimum(reflected, MAX_POLE_RADIUS)
    a = np.real(np.poly(inside))[1:]
    # Mirrored at the circle, 1/|z - p| keeps its shape and grows by |p|; a pole near 1, which has
    # no static gain to speak of, keeps how it sets out.
    b = arx.b / np.prod(np.maximum(radius, 1.0))
    return Arx(a=a, b=b, first_lag=arx.first_lag), True


def predict_one_step(arx: Arx, t: FloatArray, u: FloatArray) -> FloatArray:
    """
    Predict each output from *measured* past outputs (eq. 20). For identification only.

    Parameters
    ----------
    arx : Arx
        The model.
    t, u : ndarray, shape (N,)
        Score and measured output.

    Returns
    -------
    ndarray, shape (N,)
        NaN for the first L samples, whose past is not known.

    Raises
    ------
    TooShortError
        When N <= L.

    """
    phi, _ = regressors(t, u, len(arx.a), len(arx.b), arx.first_lag)
    theta = np.concatenate((-arx.a, arx.b))
    return np.concatenate((np.full(len(t) - len(phi), np.nan), phi @ theta))


def free_run(arx: Arx, t: FloatArray) -> FloatArray:
    """
    Run the model on its own past outputs, from the steady state of the first input.

    Parameters
    ----------
    arx : Arx
        The model; its static gain must exist.
    t : ndarray, shape (N,) or (N, K)
        Scores, one column per series.

    Returns
    -------
    ndarray, shape of t
        Outputs.

    """
    order = arx.longest_lag
    numerator, denominator = arx.polynomials(order)
    if not order:
        return np.asarray(numerator[0] * t)
    resting = resting_state(numerator, denominator, arx.gain)
    start = resting.reshape((order,) + (1,) * (t.ndim - 1)) * t[:1]
    outputs: FloatArray = lfilter(numerator, denominator, t, axis=0, zi=start)[0]
    return outputs


def resting_state(numerator: FloatArray, denominator: FloatArray, gain: float) -> FloatArray:
    """
    Compute the filter state of a latent that has seen a constant unit input for ever.

    Parameters
    ----------
    numerator, denominator : ndarray, shape (L + 1,)
        From Arx.polynomials.
    gain : float
        Static gain.

    Returns
    -------
    ndarray, shape (L,)
        State of the transposed direct form II, as scipy.signal.lfilter's zi.

    """
    # z_i = Σ_{j > i} (b_j t - a_j u) with t = 1 and u = gain
    remainder = numerator[1:] - denominator[1:] * gain
    state: FloatArray = np.cumsum(remainder[::-1])[::-1]
    return state
