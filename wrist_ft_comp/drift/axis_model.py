"""
The drift of one axis: dynamic filters, features, and the outer and inner model behind them.

    T'(k) = H_1(T), …, H_K(T)     (K·J,)  dynamic filter before the outer model (eq. 11)
    x(k)  = features of T'        (F,)
    y(k)  = ARX-PLS of x          (M,)    eq. 15
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wrist_ft_comp.drift.arx_pls import Arx, ArxPls, static_gain
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.errors import check_part
from wrist_ft_comp.series import FloatArray

#: A static gain is 1 as far as files round it.
_UNIT_GAIN_TOLERANCE = 1e-6
#: Smallest calibrated range of a thermometer that counts: one that hardly moved during the
#: calibration is not outside its range for a hundredth of a degree, K.
LEAST_RANGE_K = 1.0


@dataclass(frozen=True, eq=False)
class AxisModel:
    """What runs for one axis."""

    #: From J temperatures, or with filters K·J filtered ones (filter by filter), to F features.
    features: Features
    #: From F features to one output (zero drift) or two (zero drift, sensitivity drift).
    dynamics: ArxPls
    #: H_k, of static gain 1, each applied to every thermometer; empty passes them as they are.
    filters: tuple[Arx, ...] = ()

    def __post_init__(self) -> None:
        check_part(self.features.width == len(self.dynamics.input_mean), 'number of features')
        check_part(self.outputs in (1, 2), 'number of outputs')
        remainder = self.features.thermometers % max(len(self.filters), 1)
        check_part(remainder == 0, 'number of filters')
        for dynamics in self.filters:
            check_part(abs(dynamics.gain - 1.0) <= _UNIT_GAIN_TOLERANCE, 'gain of a filter')
        _ = self._filter_bank  # refuses unstable filters now, not in the first step

    @property
    def thermometers(self) -> int:
        """Number of thermometers J."""
        return self.features.thermometers // max(len(self.filters), 1)

    @property
    def reference_c(self) -> FloatArray:
        """T_ref of each thermometer, °C, shape (J,)."""
        return self.features.reference_c[: self.thermometers]

    @property
    def outputs(self) -> int:
        """Number of outputs M: 1 is zero drift, 2 is zero and sensitivity drift."""
        return len(self.dynamics.output_mean)

    def without_gain_drift(self) -> 'AxisModel':
        """Keep the zero drift only."""
        names = 'output_loadings', 'output_weight', 'output_mean'
        first = {name: getattr(self.dynamics, name)[:1] for name in names}
        return replace(self, dynamics=replace(self.dynamics, **first))

    def anchored(self, at_rest: Sequence[float]) -> 'AxisModel':
        """Shift the constants so that soaked at T_ref it gives these outputs, (M,)."""
        soaked_c = self.reference_c
        resting = self.run(self.start(soaked_c), soaked_c[np.newaxis])[1][0]
        mean = self.dynamics.output_mean - resting + np.array(at_rest)
        return replace(self, dynamics=replace(self.dynamics, output_mean=mean))

    @property
    def poles(self) -> FloatArray:
        """Poles of all filters and latents, complex, shape (poles,)."""
        parts = (*self.filters, *self.dynamics.latents)
        return np.concatenate([part.poles for part in parts])

    @cached_property
    def _filter_bank(self) -> ArxPls:
        """Write the filters, or else a gain of 1, as latents whose loadings only copy."""
        thermometers, filtered = self.thermometers, self.features.thermometers
        filters = self.filters or (static_gain(),)
        return ArxPls(
            input_mean=np.zeros(thermometers), input_weight=np.ones(thermometers),
            rotations=np.tile(np.eye(thermometers), len(filters)),  # (J, K·J)
            latents=tuple(dynamics for dynamics in filters for _ in range(thermometers)),
            output_loadings=np.eye(filtered), output_weight=np.ones(filtered),
            output_mean=np.zeros(filtered))  # fmt: skip

    def start(self, temperature_c: FloatArray) -> FloatArray:
        """State of a soaked sensor, shape (S,): that of the filters, then that of the latents."""
        clamped = self.features.clamp(temperature_c)
        x = self.features.expand(np.tile(clamped, max(len(self.filters), 1)))
        states = self._filter_bank.start(clamped), self.dynamics.start(x)
        return np.concatenate([state.ravel() for state in states])

    def run(self, state: FloatArray, temperature_c: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Advance by N cells, temperatures (N, J), drift (N, M)."""
        before, behind = self._split(state)
        # Temperatures are clamped before a filter remembers them.
        before, filtered = self._filter_bank.run(before, self.features.clamp(temperature_c))
        behind, outputs = self.dynamics.run(behind, self.features.expand(filtered))
        return np.concatenate((before.ravel(), behind.ravel())), outputs

    def skip(self, state: FloatArray, temperature_c: FloatArray, cells: int = 1) -> FloatArray:
        """Advance by N temperatures, (N, J), each for some cells; the state alone, quickly."""
        before, behind = self._split(state)
        if before.size and behind.size:  # the latents need every cell of the filters
            return self.run(state, np.repeat(temperature_c, cells, axis=0))[0]
        clamped = self.features.clamp(temperature_c)
        before = self._filter_bank.skip(before, clamped, cells)
        if behind.size:
            behind = self.dynamics.skip(behind, self.features.expand(clamped), cells)
        return np.concatenate((before.ravel(), behind.ravel()))

    def _split(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Split a state into those of the filters and of the latents, (R, L) each."""
        shape = self._filter_bank.state_shape
        size = int(np.prod(shape))
        return state[:size].reshape(shape), state[size:].reshape(self.dynamics.state_shape)

    @property
    def range_c(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest calibrated temperature of each thermometer, °C, (J,)."""
        features, count = self.features, self.thermometers
        return features.lower_c[:count], features.upper_c[:count]

    def beyond_range(self, temperature_c: FloatArray) -> FloatArray:
        """Distance of each thermometer from its calibrated range, in ranges, (..., J)."""
        low_c, high_c = self.range_c
        excess_k = temperature_c - np.clip(temperature_c, low_c, high_c)
        return np.asarray(np.abs(excess_k) / np.maximum(high_c - low_c, LEAST_RANGE_K))
