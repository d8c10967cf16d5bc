"""Drift observed directly, window by window, for the methods that need an output block."""

import numpy as np

from wrist_ft_comp.core.problem import AxisProblem, stretches
from wrist_ft_comp.core.recording import FloatArray

#: Longest stretch of constant sensitivity assumed when it is observed directly, s.
OBSERVATION_WINDOW_S = 300.0


def observe_drift(problem: AxisProblem) -> list[FloatArray]:
    """
    Turn r - w into direct observations of the outputs, for methods that need them.

    Without load the only output is the zero drift. With load, sensitivity is a least-squares
    slope over windows of at most OBSERVATION_WINDOW_S that do not cross gaps: "coefficients
    recorded at discrete temperatures" (the paper's 3.2).

    Parameters
    ----------
    problem : AxisProblem
        The axis.

    Returns
    -------
    list of ndarrays, shape (N_i, M)
        Zero drift (N or N m) up to a constant and, when there is load, sensitivity drift; NaN
        where either is not known.

    """
    if problem.load is None:
        return [residual[:, np.newaxis] for residual in problem.residual]
    deviation = np.std(np.concatenate([w[np.isfinite(w)] for w in problem.load]))
    return [
        _observe_windows(residual, load, problem.period_s, 0.2 * float(deviation))
        for residual, load in zip(problem.residual, problem.load, strict=True)
    ]


def _observe_windows(
    residual: FloatArray, load: FloatArray, period_s: float, min_deviation: float
) -> FloatArray:
    """Slope and zero drift of one recording, shape (N, 2)."""
    observed = np.full((len(residual), 2), np.nan)
    present = np.isfinite(residual) & np.isfinite(load)
    cells = max(round(OBSERVATION_WINDOW_S / period_s), 1)
    at = np.flatnonzero(present)
    parts = stretches(present, period_s)[at]
    starts = at[np.searchsorted(parts, parts)]  # first sample of each one's stretch
    # Windows count anew in each stretch, so none crosses a gap.
    windows = np.stack((parts, (at - starts) // cells))
    for window in np.unique(windows, axis=1).T:
        rows = at[(windows == window[:, np.newaxis]).all(axis=0)]
        w = load[rows] - load[rows].mean()
        if len(rows) > 2 and np.std(w) >= min_deviation:
            slope = float(w @ residual[rows] / (w @ w))
            observed[rows, 0] = residual[rows] - slope * load[rows]
            observed[rows, 1] = slope
    return observed
