"""
Limits of the correction: how large it may be, and how fast it may move.

A model knows what drift follows from a temperature; it does not know that a thermometer has come
loose. Whatever it says, the correction stays within these limits.
"""

import numpy as np

from wrist_ft_comp.model.drift_model import Drift
from wrist_ft_comp.model.signals import AXES, FloatArray

#: Limits for torques are limits for forces times this lever arm, m.
TORQUE_LEVER_M = 0.1
#: Sensitivity drift beyond this is no sensor's; it is clamped.
MAX_SENSITIVITY = 0.5
#: Nor does sensitivity move by more than this per second.
MAX_SENSITIVITY_RATE = 0.01


def axis_limits(force_limit: float) -> FloatArray:
    """Spread a limit for forces, N, over the six axes, N and N m, by TORQUE_LEVER_M."""
    return np.array(
        [force_limit * (1.0 if axis.startswith('force') else TORQUE_LEVER_M) for axis in AXES]
    )


class Limits:
    """Keeps a drift within its limits, as StreamSettings, and tells which axes they held back."""

    def __init__(self, max_drift_n: float, max_rate_n_s: float) -> None:
        #: Axes whose drift would be larger.
        self.too_large: tuple[str, ...] = ()
        #: Axes whose drift would move faster.
        self.too_fast: tuple[str, ...] = ()
        self._sizes = Drift(axis_limits(max_drift_n), np.full(len(AXES), MAX_SENSITIVITY))
        self._rates = Drift(axis_limits(max_rate_n_s), np.full(len(AXES), MAX_SENSITIVITY_RATE))

    def saturate(self, target: Drift) -> Drift:
        """
        Keep a drift from being too large.

        What is not a number, as a model of absurd numbers can make it, becomes 0.
        """
        result = Drift(
            *(
                np.clip(np.where(np.isnan(part), 0.0, part), -size, size)
                for part, size in zip(target, self._sizes, strict=True)
            )
        )
        self.too_large = _differing(target, result)
        return result

    def rate_limit(self, target: Drift, here: Drift, seconds: float) -> Drift:
        """Keep a drift from moving too fast: the nearest to the target within some seconds."""
        result = Drift(
            *(
                np.clip(part, start - rate * seconds, start + rate * seconds)
                for part, start, rate in zip(target, here, self._rates, strict=True)
            )
        )
        self.too_fast = _differing(target, result)
        return result


def _differing(wanted: Drift, allowed: Drift) -> tuple[str, ...]:
    """Name the axes on which two drifts differ."""
    differs = (wanted.zero != allowed.zero) | (wanted.sensitivity != allowed.sensitivity)
    return tuple(axis for axis, hit in zip(AXES, differs, strict=True) if hit)
