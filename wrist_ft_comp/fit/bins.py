"""An axis' observations summed over bins of cells: features hardly change within, loads do."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.drift.arx import Arx, mean_relaxation, relaxation
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.signals import FloatArray, IntArray

_TARE_S = 60.0
#: Cosines of a random walk, and what a body forgets that did not start at rest, s.
_COSINES, _TRANSIENTS_S = 16, (300.0, 1000.0, 3000.0)
#: Prior precision of what may be anything.
_FREE = 1e-9
#: Prior variance of a transient over that of the mean of all noise.
TRANSIENT_VARIANCE = 30.0


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums of w, r - w and their products over a recording's bins, (n,); no part where 0 count."""

    count: FloatArray
    load: FloatArray
    load_square: FloatArray
    residual: FloatArray
    residual_square: FloatArray
    product: FloatArray


@dataclass(frozen=True, eq=False)
class BinnedData:
    """One axis over several recordings, in bins; as AxisData, with the sums of each recording."""

    # The period is that of a bin, s, of so many cells; with one, relaxations are those of the
    # running model. Temperatures are the means of each bin, °C, shape (n_i, J).

    period_s: float
    cells: int
    temperature_c: tuple[FloatArray, ...]
    sums: tuple[Sums, ...]
    folds: tuple[IntArray, ...]
    steps: tuple[tuple[int, ...], ...]
    loaded: bool
    tared: bool

    @property
    def longest_s(self) -> float:
        """Duration of the longest recording, s."""
        return max(len(temperature_c) for temperature_c in self.temperature_c) * self.period_s

    def nuisances(self, recording: int) -> FloatArray:
        """Draw what no temperature has to explain in a recording, shape (n, N)."""
        # A constant; where a fold has one of its own, also a random walk in cosines, so that slow
        # errors are not taken for many independent witnesses, the transients of a start that was
        # not soaked, and a constant more from every step on.
        bins = len(self.sums[recording].count)
        middle = (np.arange(bins) + 0.5)[:, np.newaxis]
        if not self.tared:
            return np.ones((bins, 1))
        walk = np.cos(np.pi * middle / bins * np.arange(_COSINES + 1))
        steps = np.full(self._most_steps, bins * self.cells)
        steps[: len(self.steps[recording])] = self.steps[recording]
        after = middle * self.cells > steps
        return np.concatenate(
            (walk, start_transients(middle[:, 0] * self.period_s), after), axis=1
        )

    @property
    def _most_steps(self) -> int:
        """Count the steps of the recording that has most."""
        return max(len(each) for each in self.steps)

    def nuisance_precision(self, *, soaked: bool = False) -> FloatArray:
        """Prior precision of each nuisance, over that of all cells of its recording, (N,)."""
        if not self.tared:
            return np.zeros(1)
        start = 1e12 if soaked else 1.0 / TRANSIENT_VARIANCE
        walk, steps = np.arange(_COSINES + 1) ** 2.0, np.full(self._most_steps, _FREE)
        return np.concatenate((walk, np.full(len(_TRANSIENTS_S), start), steps))

    def relaxation(self, time_constant_s: float) -> Arx:
        """First-order lag of the bins' temperatures: what runs, averaged over each bin."""
        if self.cells == 1:
            return relaxation(time_constant_s, self.period_s)
        return mean_relaxation(time_constant_s, self.period_s / self.cells, self.cells)


def bin_axis_data(data: AxisData, cells: int) -> BinnedData:
    """Sum an axis over bins of some cells."""
    sums = []
    for i, residual in enumerate(data.residual):
        w = np.zeros_like(residual) if data.load is None else data.load[i]
        present = np.isfinite(residual) & np.isfinite(w)
        y, w = np.where(present, residual, 0.0), np.where(present, w, 0.0)
        rows = [present.astype(float), w, w * w, y, y * y, w * y]
        sums.append(Sums(*(_sum_bins(row, cells) for row in rows)))
    return BinnedData(
        period_s=cells * data.period_s, cells=cells,
        temperature_c=tuple(_mean_bins(values, cells) for values in data.temperature_c),
        sums=tuple(sums), folds=tuple(folds[::cells] for folds in data.folds),
        steps=data.steps, loaded=data.load is not None, tared=data.tared)  # fmt: skip


def start_transients(time_s: NDArray[np.floating[Any]]) -> FloatArray:
    """Draw what a body that did not start at rest forgets, (n, 3), from times since then, (n,)."""
    return np.asarray(np.exp(-time_s[:, np.newaxis] / np.array(_TRANSIENTS_S)))


def tare(values: FloatArray, period_s: float) -> FloatArray:
    """Zero what is left of a held-out fold, (n, …), on its first minute, as people do."""
    return np.asarray(values - values[: max(1, round(_TARE_S / period_s))].mean(axis=0))


def _sum_bins(values: FloatArray, cells: int) -> FloatArray:
    """Sum over bins, shapes (N, …) to (n, …)."""
    if cells == 1:
        return values
    return np.asarray(np.add.reduceat(values, np.arange(0, len(values), cells), axis=0))


def _mean_bins(values: FloatArray, cells: int) -> FloatArray:
    """Average over bins, shapes (N, J) to (n, J)."""
    counts = np.diff(np.arange(0, len(values), cells), append=len(values))
    return np.asarray(_sum_bins(values, cells) / counts[:, np.newaxis])
