"""
The search for free time constants.

For given time constants every gain is linear, so only their logarithms are searched and the gains
are solved inside (variable projection). The slope of what is left comes from the same sums: it is
twice the product of what is left with the column that a small change of τ adds.
"""

import numpy as np
from scipy.optimize import LinearConstraint, minimize

from wrist_ft_comp.core.binned import BinnedProblem
from wrist_ft_comp.core.features import Features
from wrist_ft_comp.core.recording import FloatArray
from wrist_ft_comp.core.tangent import differentiate

#: Time constants keep this ratio: closer ones cannot be told apart, and their gains would explode.
_APART = 1.5


def search_time_constants(
    problem: BinnedProblem, features: Features, start_s: FloatArray, tolerance: float = 1e-9
) -> FloatArray:
    """
    Search the time constants around a start, all gains solved inside.

    Parameters
    ----------
    problem : BinnedProblem
        The axis.
    features : Features
        Of one relaxation's temperatures.
    start_s : ndarray, shape (K,)
        Start, s.
    tolerance : float
        Stop when what is left falls by less than this share of it.

    Returns
    -------
    ndarray, shape (K,)
        Time constants, s, increasing.

    """
    # Slower than its longest recording cannot be told from a trend.
    lower, upper = np.log((problem.period_s, problem.longest_s))
    start = np.clip(np.log(start_s), lower, upper)
    scale = max(differentiate(problem, features, np.exp(start)).left, 1e-300)

    def left(log_tau: FloatArray) -> tuple[float, FloatArray]:
        # The optimiser may leave the bounds by a rounding error, or try far beyond them.
        tangent = differentiate(problem, features, np.exp(np.clip(log_tau, lower, upper)))
        return tangent.left / scale, tangent.slopes / scale

    count = len(start)
    each = np.eye(count)
    # Rows: log τ_1, log τ_{k+1} - log τ_k, and log τ_K. As bounds, the first and the last would
    # make scipy warn of every rounding error.
    rows = np.concatenate((each[:1], each[1:] - each[:-1], each[-1:]))
    least = np.concatenate(([lower], np.full(count - 1, np.log(_APART)), [-np.inf]))
    most = np.concatenate((np.full(count, np.inf), [upper]))
    found = minimize(
        left,
        start,
        jac=True,
        method='SLSQP',
        constraints=LinearConstraint(rows, least, most),
        options={'ftol': tolerance, 'maxiter': 60},
    )
    return np.sort(np.exp(np.clip(found.x, lower, upper)))
