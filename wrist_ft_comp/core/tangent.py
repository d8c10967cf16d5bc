"""What free time constants leave, and how that changes with each of them."""

from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.core.binned import BinnedProblem
from wrist_ft_comp.core.features import Features
from wrist_ft_comp.core.moments import accumulate, bank_inputs, Moments
from wrist_ft_comp.core.recording import FloatArray, IntArray
from wrist_ft_comp.core.regularised import least_squares

#: Relative step of τ for the columns of derivatives.
_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class Tangent:
    """
    The moments of a fit and of its derivatives by log τ, at given time constants.

        columns of moments: [ X_1 … X_K | D_1 … D_K | w X … | w D … | w | r - w ]
        seen as:            [ the p columns that explain | X's change with each log τ | r - w ]

    Attributes
    ----------
    moments : Moments
        As drawn.
    columns : ndarray of int, shape (p,)
        Those that explain.
    gains : ndarray, shape (p,)
        Their coefficients.
    left : float
        Sum of squares of what they leave.
    slopes : ndarray, shape (K,)
        Its derivative by each log τ.
    derivative : ndarray, shape (K, P + 1)
        What each log τ changes, as a combination of the columns of moments.

    """

    moments: Moments
    columns: IntArray
    gains: FloatArray
    left: float
    slopes: FloatArray
    derivative: FloatArray

    @property
    def residual(self) -> FloatArray:
        """What the fit leaves of r - w, as a combination of the columns of moments, (P + 1,)."""
        combination = np.zeros(self.moments.products.shape[1])
        combination[-1] = 1.0
        combination[self.columns] = -self.gains
        return combination


def differentiate(
    problem: BinnedProblem, features: Features, time_constants_s: FloatArray
) -> Tangent:
    """
    Fit the gains for given time constants, and differentiate what they leave.

    Parameters
    ----------
    problem : BinnedProblem
        The axis.
    features : Features
        Of one relaxation's temperatures.
    time_constants_s : ndarray, shape (K,)
        τ, s.

    Returns
    -------
    Tangent
        With the derivatives by each log τ.

    """
    count = len(time_constants_s)
    here, up, down = (
        bank_inputs(problem, features, time_constants_s * np.exp(step))
        for step in (0.0, _STEP, -_STEP)
    )
    banked = [
        np.concatenate((x, (a - b) / (2 * _STEP)), axis=1)
        for x, a, b in zip(here, up, down, strict=True)
    ]
    moments = accumulate(problem, banked, np.concatenate((time_constants_s, time_constants_s)))
    products, _ = moments.centred(np.ones(len(moments.counts), dtype=bool))
    columns = moments.columns(range(count), moments.inputs)
    gains, left = least_squares(products, columns)
    load = 2 * len(moments.time_constants_s) * moments.inputs  # the column w, if there is one
    derivative = np.zeros((count, len(products)))
    for k in range(count):
        own = np.isin(columns, moments.columns([k], moments.inputs)) & (columns != load)
        derivative[k, columns[own] + count * moments.inputs] = gains[own]
    tangent = Tangent(moments, columns, gains, float(left), np.zeros(count), derivative)
    return replace(tangent, slopes=-2.0 * derivative @ products @ tangent.residual)
