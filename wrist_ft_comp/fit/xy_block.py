"""What the paper's methods are fitted to: X and Y of one axis (eq. 3 and 5)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wrist_ft_comp.drift.arx import Arx
from wrist_ft_comp.drift.arx_pls import ArxPls
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.series import BoolArray, FloatArray, IntArray, stretches

#: Longest stretch of constant sensitivity assumed when it is observed directly, s.
OBSERVATION_WINDOW_S = 300.0
#: A window shows sensitivity when its load varies by this share of the load's whole deviation.
_LOADED_SHARE = 0.2


@dataclass(frozen=True, eq=False)
class XyBlock:
    """Input and output block, recording by recording; X is the input (3.2 swaps the words)."""

    #: Inputs of every cell, (N_i, F), neither centred nor scaled.
    inputs: tuple[FloatArray, ...]
    #: What was observed, (N_i, M), up to a constant of each recording; NaN where nothing was.
    outputs: tuple[FloatArray, ...]

    @cached_property
    def valid(self) -> tuple[BoolArray, ...]:
        """Cells in which all outputs were observed, (N_i,)."""
        return tuple(np.all(np.isfinite(y), axis=1) for y in self.outputs)

    @property
    def observed(self) -> bool:
        """Whether any cell is valid; of none there is neither X nor Y."""
        return any(valid.any() for valid in self.valid)

    @cached_property
    def input_mean(self) -> FloatArray:
        """x̄ over the valid cells, shape (F,)."""
        return np.asarray(self._valid_inputs.mean(axis=0))

    @cached_property
    def input_weight(self) -> FloatArray:
        """Diagonal of W_x: one over the inputs' deviation, shape (F,); 0 for constant inputs."""
        deviation = self._valid_inputs.std(axis=0)
        constant = deviation <= 1e-9 * np.abs(self._valid_inputs).max(axis=0)
        return np.where(constant, 0.0, 1.0 / np.where(constant, 1.0, deviation))

    @cached_property
    def output_weight(self) -> FloatArray:
        """Diagonal of W_y: one over the outputs' deviation, shape (M,); 1 for constant outputs."""
        deviation = np.std(self.stack(self.outputs), axis=0)
        return np.asarray(1.0 / np.where(deviation > 0, deviation, 1.0))

    @cached_property
    def x(self) -> FloatArray:
        """X of eq. 3, shape (N, F): all recordings, each centred by itself, scaled by W_x."""
        return self.stack(self.inputs) * self.input_weight

    @cached_property
    def y(self) -> FloatArray:
        """Y of eq. 5, shape (N, M), scaled by W_y."""
        return self.stack(self.outputs) * self.output_weight

    @cached_property
    def scaled_inputs(self) -> tuple[FloatArray, ...]:
        """E_0 of every cell, (N_i, F): centred by x̄, scaled by W_x."""
        return tuple((x - self.input_mean) * self.input_weight for x in self.inputs)

    @cached_property
    def scaled_outputs(self) -> tuple[FloatArray, ...]:
        """F_0 of every cell, (N_i, M), scaled by W_y."""
        return tuple(y * self.output_weight for y in self.outputs)

    def without(self, folds: Sequence[IntArray], held_out: int) -> 'XyBlock':
        """Hold a fold out: its outputs become NaN. Folds are the number of each cell's, (N_i,)."""
        outputs = (
            np.where((numbers == held_out)[:, np.newaxis], np.nan, y)
            for numbers, y in zip(folds, self.outputs, strict=True)
        )
        return XyBlock(self.inputs, tuple(outputs))

    def stack(self, series: Sequence[FloatArray]) -> FloatArray:
        """Join the valid cells of (N_i, K), each recording centred for its unknown offset."""
        parts = [values[rows] for values, rows in zip(series, self.valid, strict=True)]
        return np.concatenate([part - part.mean(axis=0) for part in parts if len(part)])

    def model(
        self, rotations: FloatArray, latents: Sequence[Arx], output_loadings: FloatArray
    ) -> ArxPls | None:
        """Put an identified model together, in the block's units; None without any latent."""
        if not len(latents):
            return None
        return ArxPls(
            input_mean=self.input_mean, input_weight=self.input_weight, rotations=rotations,
            latents=tuple(latents), output_loadings=output_loadings,
            output_weight=self.output_weight,
            output_mean=np.zeros(len(self.output_weight)))  # fmt: skip

    @cached_property
    def _valid_inputs(self) -> FloatArray:
        return np.concatenate([x[rows] for x, rows in zip(self.inputs, self.valid, strict=True)])


def build_xy_block(data: AxisData, features: Features) -> XyBlock:
    """Expand the temperatures of an axis to features, and observe its drift."""
    inputs = tuple(features.expand(temperature_c) for temperature_c in data.temperature_c)
    return XyBlock(inputs, tuple(observe_drift(data)))


def observe_drift(data: AxisData) -> list[FloatArray]:
    """
    Observe zero drift and, when there is load, sensitivity drift directly in r - w, (N_i, M).

    Sensitivity is a least-squares slope over windows of at most OBSERVATION_WINDOW_S that do not
    cross gaps: "coefficients recorded at discrete temperatures" (the paper's 3.2). Observations
    hold up to a constant of each recording, and are NaN where either is not known.
    """
    if data.load is None:
        return [residual[:, np.newaxis] for residual in data.residual]
    deviation = float(np.std(np.concatenate([w[np.isfinite(w)] for w in data.load])))
    cells = max(round(OBSERVATION_WINDOW_S / data.period_s), 1)
    drifts = list[FloatArray]()
    for residual, load in zip(data.residual, data.load, strict=True):
        observed = np.full((len(residual), 2), np.nan)
        present = np.isfinite(residual) & np.isfinite(load)
        at = np.flatnonzero(present)
        parts = stretches(present, data.period_s)[at]
        starts = at[np.searchsorted(parts, parts)]  # first cell of the stretch that a cell is in
        # Windows count anew in each stretch, so none crosses a gap.
        windows = np.stack((parts, (at - starts) // cells))
        for window in np.unique(windows, axis=1).T:
            rows = at[(windows == window[:, np.newaxis]).all(axis=0)]
            w = load[rows] - load[rows].mean()
            if len(rows) > 2 and np.std(w) >= _LOADED_SHARE * deviation:
                slope = float(w @ residual[rows] / (w @ w))
                observed[rows] = np.stack((residual[rows] - slope * load[rows], 0 * w + slope), 1)
        drifts.append(observed)
    return drifts
