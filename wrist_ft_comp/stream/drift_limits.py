"""Bounds the correction, whatever a model says: how large it is, and how fast it moves."""

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.drift_model import Drift
from wrist_ft_comp.series import FloatArray

#: Limits for torques are limits for forces times this lever arm, m.
TORQUE_LEVER_M = 0.1
#: Sensitivity drift beyond this is no sensor's; it is clamped.
MAX_SENSITIVITY = 0.5
#: Nor does sensitivity move by more than this per second.
MAX_SENSITIVITY_RATE = 0.01


def axis_limits(force_limit: float) -> FloatArray:
    """Spread a limit for forces, N, over the six axes, N and N m, by TORQUE_LEVER_M."""
    return np.repeat([force_limit, TORQUE_LEVER_M * force_limit], 3)


class Limits:
    """Keeps a drift within the limits of StreamSettings, and names the axes that are limited."""

    def __init__(self, max_drift_n: float, max_rate_n_s: float) -> None:
        #: Axes whose drift would be larger.
        self.too_large: tuple[str, ...] = ()
        #: Axes whose drift would move faster.
        self.too_fast: tuple[str, ...] = ()
        # Zero drift and sensitivity drift, shape (2, 6).
        self._sizes = np.stack((axis_limits(max_drift_n), np.full(len(AXES), MAX_SENSITIVITY)))
        self._rates = np.stack(
            (axis_limits(max_rate_n_s), np.full(len(AXES), MAX_SENSITIVITY_RATE))
        )

    def saturate(self, target: Drift) -> Drift:
        """Keep a drift from being too large; what is not a number becomes 0."""
        wanted = np.stack(target)
        allowed = np.clip(np.where(np.isnan(wanted), 0.0, wanted), -self._sizes, self._sizes)
        self.too_large = _differing(wanted, allowed)
        return Drift(*allowed)

    def rate_limit(self, target: Drift, present: Drift, seconds: float) -> Drift:
        """Keep a drift from moving too fast: the nearest to the target after some seconds."""
        wanted, start, reach = np.stack(target), np.stack(present), self._rates * seconds
        allowed = np.clip(wanted, start - reach, start + reach)
        self.too_fast = _differing(wanted, allowed)
        return Drift(*allowed)


def _differing(wanted: FloatArray, allowed: FloatArray) -> tuple[str, ...]:
    return tuple(AXES[i] for i in np.flatnonzero((wanted != allowed).any(axis=0)))
