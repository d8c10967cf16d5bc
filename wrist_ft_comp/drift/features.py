"""Features of temperatures: powers of θ_j = T_j - T_ref,j, or hat functions (the paper's 3.2)."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from wrist_ft_comp.errors import check_part, check_range
from wrist_ft_comp.series import FloatArray

#: Features follow temperatures up to this share of the calibrated span beyond it: farther out is a
#: faulty thermometer, or another robot.
_FAR_MARGIN = 3.0
#: Squares keep their curvature for this share of the calibrated span before they become tangents.
_CURVED_SHARE = 0.33
#: Highest power of a file's features.
_HIGHEST_DEGREE = 10

FeatureKind = Literal['powers', 'hats']


@dataclass(frozen=True, eq=False)
class Features:
    """
    How J temperatures become F features.

    Outside [lower_c, upper_c], the range that was calibrated, powers go on as tangents at its
    edge, squares curved for a third of the range, and temperatures are held from three ranges on.
    Hats, which have no slope beyond their last knot, stay constant from there.
    """

    #: Powers of θ_j up to ``degree``, or one hat function per knot.
    kind: FeatureKind
    #: T_ref, °C, shape (J,).
    reference_c: FloatArray
    #: Calibrated range, °C, shape (J,).
    lower_c: FloatArray
    upper_c: FloatArray
    #: Highest power; unused for hats.
    degree: int = 1
    #: Increasing knot temperatures of each thermometer, °C; empty for powers.
    knots_c: tuple[FloatArray, ...] = field(default=())

    def __post_init__(self) -> None:
        check_range('degree', self.degree, 1, _HIGHEST_DEGREE)
        for name in ('reference_c', 'lower_c', 'upper_c'):
            check_part(getattr(self, name).shape == (len(self.reference_c),), f'length of {name}')
        if self.kind == 'hats':
            check_part(len(self.knots_c) == len(self.reference_c), 'length of knots_c')
            for knots in self.knots_c:
                check_part(len(knots) > 1 and bool((np.diff(knots) > 0).all()), 'knots_c')
        check_part(bool((self.lower_c <= self.upper_c).all()), 'the calibrated range')

    @property
    def thermometers(self) -> int:
        """Number of thermometers J."""
        return len(self.reference_c)

    @property
    def width(self) -> int:
        """Number of features F."""
        return len(self.expand(self.reference_c))

    def clamp(self, temperature_c: FloatArray) -> FloatArray:
        """Hold temperatures of the first thermometers, °C, (..., J), near the calibrated range."""
        count = temperature_c.shape[-1]
        lower_c, upper_c = self.lower_c[:count], self.upper_c[:count]
        margin = _FAR_MARGIN * (upper_c - lower_c)
        return np.asarray(np.clip(temperature_c, lower_c - margin, upper_c + margin))

    def expand(self, temperature_c: FloatArray) -> FloatArray:
        """
        Compute the features, shape (..., F), of temperatures that were clamped, °C, (..., J).

        Powers: θ_1 … θ_J, then their squares, and so on (K, K² …). Hats: those of thermometer 1,
        then those of thermometer 2, and so on, all between 0 and 1.
        """
        if self.kind == 'powers':
            theta = temperature_c - self.reference_c
            low, high = self.lower_c - self.reference_c, self.upper_c - self.reference_c
            inside = np.minimum(np.maximum(theta, low), high)
            excess = theta - inside
            powers, lower = [], np.ones_like(inside)
            for p in range(1, self.degree + 1):
                power = lower * inside  # a product: pow() takes most of a calibration's time
                powers.append(power + p * lower * excess)
                lower = power
            if self.degree > 1:
                curved = _CURVED_SHARE * (high - low)
                near = np.minimum(np.maximum(excess, -curved), curved)
                powers[1] = powers[1] + near * (2 * excess - near)
            return np.concatenate(powers, axis=-1)
        hats = [
            np.interp(temperature_c[..., j, np.newaxis], knots, unit)[..., 0]
            for j, knots in enumerate(self.knots_c)
            for unit in np.eye(len(knots))
        ]
        return np.stack(hats, axis=-1)
