"""The search for free time constants: gains are solved inside (variable projection)."""

from dataclasses import dataclass, replace

import numpy as np
import scipy  # which loads its parts when they are used

from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.bins import BinnedData
from wrist_ft_comp.fit.moments import accumulate, bank_inputs, Moments
from wrist_ft_comp.fit.regression import least_squares
from wrist_ft_comp.signals import FloatArray, IntArray

#: Relative step of τ for the columns of derivatives.
_STEP = 1e-4
#: Time constants keep this ratio: closer ones cannot be told apart, and their gains would explode.
_APART = 1.5


def search_time_constants(
    data: BinnedData, features: Features, start_s: FloatArray, tolerance: float = 1e-9
) -> FloatArray:
    """Search the time constants around a start, all gains solved inside; increasing, s."""
    # It ends when what is left falls by less than a share, the tolerance, of it.
    # Slower than its longest recording cannot be told from a trend.
    lower, upper = np.log((data.period_s, data.longest_s))
    start = np.clip(np.log(start_s), lower, upper)
    scale = max(residual_and_gradient(data, features, np.exp(start)).rss, 1e-300)

    def scaled(log_tau: FloatArray) -> tuple[float, FloatArray]:
        # The optimiser may leave the bounds by a rounding error, or try far beyond them.
        tau_s = np.exp(np.clip(log_tau, lower, upper))
        projection = residual_and_gradient(data, features, tau_s)
        return projection.rss / scale, projection.gradient / scale

    count = len(start)
    each = np.eye(count)
    # Rows: log τ_1, log τ_{k+1} - log τ_k, and log τ_K. As bounds, the first and the last would
    # make scipy warn of every rounding error.
    rows = np.concatenate((each[:1], each[1:] - each[:-1], each[-1:]))
    least = np.concatenate(([lower], np.full(count - 1, np.log(_APART)), [-np.inf]))
    most = np.concatenate((np.full(count, np.inf), [upper]))
    ordered = scipy.optimize.LinearConstraint(rows, least, most)
    options = {'ftol': tolerance, 'maxiter': 60}
    optimum = scipy.optimize.minimize(
        scaled, start, jac=True, method='SLSQP', constraints=ordered, options=options
    )
    return np.sort(np.exp(np.clip(optimum.x, lower, upper)))


@dataclass(frozen=True, eq=False)
class VarPro:
    """A fit of the gains at given time constants, and its derivatives by log τ."""

    #   columns of moments: [ X_1 … X_K | D_1 … D_K | w X … | w D … | w | r - w ]
    #   seen as:            [ the p columns that explain | X's change with each log τ | r - w ]

    moments: Moments
    #: Those that explain, and their coefficients, shape (p,).
    columns: IntArray
    gains: FloatArray
    #: Sum of squares of what they leave, and its derivative by each log τ, shape (K,).
    rss: float
    gradient: FloatArray
    #: What each log τ changes, as a combination of the columns of moments, shape (K, P + 1).
    derivative: FloatArray

    @property
    def residual(self) -> FloatArray:
        """What the fit leaves of r - w, as a combination of the columns of moments, (P + 1,)."""
        combination = np.zeros(self.moments.products.shape[1])
        combination[-1] = 1.0
        combination[self.columns] = -self.gains
        return combination


def residual_and_gradient(
    data: BinnedData, features: Features, time_constants_s: FloatArray
) -> VarPro:
    """Fit the gains for given time constants, and differentiate what they leave."""
    count = len(time_constants_s)
    here, up, down = (
        bank_inputs(data, features, time_constants_s * np.exp(step))
        for step in (0.0, _STEP, -_STEP)
    )
    banked = [
        np.concatenate((x, (a - b) / (2 * _STEP)), axis=1)
        for x, a, b in zip(here, up, down, strict=True)
    ]
    moments = accumulate(data, banked, np.concatenate((time_constants_s, time_constants_s)))
    products = moments.centred()
    columns = moments.columns(range(count), moments.inputs)
    gains, rss = least_squares(products, columns)
    load = 2 * len(moments.time_constants_s) * moments.inputs  # the column w, if there is one
    derivative = np.zeros((count, len(products)))
    for k in range(count):
        own = np.isin(columns, moments.columns([k], moments.inputs)) & (columns != load)
        derivative[k, columns[own] + count * moments.inputs] = gains[own]
    projection = VarPro(moments, columns, gains, float(rss), np.zeros(count), derivative)
    return replace(projection, gradient=-2.0 * derivative @ products @ projection.residual)
