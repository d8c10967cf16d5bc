"""
The robust weight of an observation, the same wherever contacts or outliers must not count.

Of Geman and McClure: an observation whose error is e, in units of a width, weighs 1 / (1 + e²)²
and costs e² / (1 + e²), so that an outlier costs at most 1, however far out it is. The weight is
the derivative of the cost by e².
"""

import numpy as np

from wrist_ft_comp.signals import FloatArray


def robust_weight(square: FloatArray) -> FloatArray:
    """Weigh observations by their squared errors in units of the width squared: 1 to 0."""
    return np.asarray(1 / (1 + square) ** 2)


def robust_cost(weight: FloatArray) -> FloatArray:
    """Tell the cost of observations by their weights: 0 to 1."""
    return np.asarray(1 - np.sqrt(weight))
