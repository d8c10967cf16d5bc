"""The relaxations that ``auto`` and ``arx_pls_oe`` try, and what all of them are fitted from."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from wrist_ft_comp.calibration.settings import IdentificationSettings
from wrist_ft_comp.identification.axis_data import AxisData
from wrist_ft_comp.identification.bins import bin_axis_data, BinnedData
from wrist_ft_comp.identification.moments import accumulate, bank_inputs, Moments
from wrist_ft_comp.identification.output_error import Structure
from wrist_ft_comp.model.features import Features
from wrist_ft_comp.model.signals import FloatArray

_GRID_POINTS = 13
_SHORTEST_TAU_S = 20.0
_LONGEST_TAU_S = 7200.0
_REGULARISED: tuple[Literal['PLS', 'ridge'], ...] = ('PLS', 'ridge')


@dataclass(frozen=True, eq=False)
class CandidateData:
    """
    What all candidates of an axis are fitted from and scored on.

    Features are those of one relaxation's temperatures, of the highest degree; moments and judged
    inputs, (n_i, K·F), hold all of them behind a grid of time constants. A slow trend that no
    temperature has to explain may be set aside in the fit; it never counts against a candidate.
    """

    axis_data: AxisData
    features: Features
    fitted: BinnedData
    judged: BinnedData
    fitted_moments: Moments
    judged_inputs: list[FloatArray]
    trend: bool

    def inputs(self, structure: Structure) -> int:
        """Count the features of a structure: powers up to its degree, or all hats."""
        if self.features.kind == 'powers':
            return structure.degree * self.features.thermometers
        return sum(len(knots) for knots in self.features.knots_c)

    def features_of(self, structure: Structure) -> Features:
        """Features of one relaxation's temperatures."""
        if self.features.kind == 'hats':
            return self.features
        return replace(self.features, degree=structure.degree)

    def without_trend(self) -> 'CandidateData':
        """Have temperature explain everything but a constant."""
        fitted, moments = self.fitted.without_trend(), self.fitted_moments.without_trend()
        return replace(self, fitted=fitted, fitted_moments=moments, trend=False)


def build_candidate_data(data: AxisData, features: Features) -> CandidateData:
    """Pass the temperatures through the grid of time constants, and sum."""
    grid = time_constant_grid(data)
    fitted_cells, judged_cells = data.bin_cells
    fitted = bin_axis_data(data, fitted_cells)
    judged = bin_axis_data(data, judged_cells, means=True)
    moments = accumulate(fitted, bank_inputs(fitted, features, grid), grid)
    judged_inputs = bank_inputs(judged, features, grid)
    trend = bool(moments.nuisance_gram[:, 1].any())
    return CandidateData(data, features, fitted, judged, moments, judged_inputs, trend)


def time_constant_grid(data: AxisData) -> FloatArray:
    """Lay out the time constants that are tried: 0 (static), then evenly in their logarithm, s."""
    low = max(_SHORTEST_TAU_S, 2 * data.period_s)
    high = max(min(_LONGEST_TAU_S, data.longest_s / 2), 2 * low)
    return np.concatenate(([0.0], np.geomspace(low, high, _GRID_POINTS)))


def structures(
    settings: IdentificationSettings, features: Features, grid: FloatArray
) -> list[Structure]:
    """List the candidates, simplest first, without "none": all for ``auto``, else free ones."""
    hats = features.kind == 'hats'
    degrees = [1] if hats else list(range(1, settings.degree + 1))
    suffix = {degree: 'hats' if hats else f'degree {degree}' for degree in degrees}
    free = [
        Structure(f'{count} time constant{"s" * (count > 1)}, {suffix[d]}', d, count)
        for count in (1, 2, 3)
        for d in degrees
        if count < 3 or d == 1
    ]
    if settings.method != 'auto':
        return free
    bank = tuple(float(tau) for tau in grid[::2])
    return [
        *(Structure(f'static, {suffix[d]}', d) for d in degrees),
        *free,
        *(
            Structure(f'{regression} on a bank, {suffix[d]}', d, 0, bank, regression)
            for regression in _REGULARISED
            for d in degrees
        ),
    ]
