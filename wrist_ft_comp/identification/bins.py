"""
An axis' observations summed over bins of cells: all that a fit on the simulation error needs.

Features change by next to nothing within some seconds, loads do not. So a bin keeps one set of
features, and of r - w and w the sums that least squares asks for: nothing of a quickly changing
load is lost, and the work shrinks with the bin.
"""

from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.identification.problem import AxisProblem
from wrist_ft_comp.model.arx import Arx, mean_relaxation, relaxation
from wrist_ft_comp.model.signals import FloatArray, IntArray

#: A recording this long tells a slow trend, such as creep under load, from thermal drift: four
#: times the slowest time constant that is searched, s.
_LONG_S = 28800.0


@dataclass(frozen=True, eq=False)
class Sums:
    """
    Sums over the samples of each bin of one recording, arrays of shape (n,).

    Attributes
    ----------
    time : ndarray
        -1 to 1 over a recording that is long enough to tell a trend from thermal drift, else 0.
    count : ndarray
        Number of samples; a bin with 0 takes no part, whatever the other sums hold.
    load, load_square : ndarray
        Σ w and Σ w², N or N m, and squared; 0 without a reference.
    residual, residual_square : ndarray
        Σ y and Σ y² with y = r - w.
    product : ndarray
        Σ w y.

    """

    time: FloatArray
    count: FloatArray
    load: FloatArray
    load_square: FloatArray
    residual: FloatArray
    residual_square: FloatArray
    product: FloatArray


@dataclass(frozen=True, eq=False)
class BinnedProblem:
    """
    One axis over several recordings, in bins.

    Attributes
    ----------
    period_s : float
        Length of a bin, s.
    cells : int
        Cells per bin; with one, relaxations are those of the running model.
    temperature_c : tuple of ndarrays, shape (n_i, J)
        Mean temperatures of each bin, °C.
    sums : tuple of Sums
        Of each recording.
    blocks : tuple of ndarrays of int, shape (n_i,)
        Number of the cross-validation block of each bin.
    loaded, tared : bool
        Whether there is a load; as AxisProblem.tared.

    """

    period_s: float
    cells: int
    temperature_c: tuple[FloatArray, ...]
    sums: tuple[Sums, ...]
    blocks: tuple[IntArray, ...]
    loaded: bool
    tared: bool

    @property
    def longest_s(self) -> float:
        """Duration of the longest recording, s."""
        return max(len(temperature_c) for temperature_c in self.temperature_c) * self.period_s

    def without(self, block: int) -> 'BinnedProblem':
        """Hold a block out: its samples no longer count, its temperatures stay."""
        sums = tuple(
            replace(each, count=np.where(numbers == block, 0.0, each.count))
            for numbers, each in zip(self.blocks, self.sums, strict=True)
        )
        return replace(self, sums=sums)

    def without_trend(self) -> 'BinnedProblem':
        """Have temperature explain everything but a constant, also in long recordings."""
        sums = tuple(replace(each, time=np.zeros_like(each.time)) for each in self.sums)
        return replace(self, sums=sums)

    def relaxation(self, time_constant_s: float) -> Arx:
        """First-order lag of the bins' temperatures: what runs, averaged over each bin."""
        if self.cells == 1:
            return relaxation(time_constant_s, self.period_s)
        return mean_relaxation(time_constant_s, self.period_s / self.cells, self.cells)


def bin_problem(problem: AxisProblem, cells: int, *, means: bool = False) -> BinnedProblem:
    """
    Sum a problem over bins.

    Parameters
    ----------
    problem : AxisProblem
        The axis.
    cells : int
        Cells per bin.
    means : bool
        Count the mean of each bin as one sample: what is judged is drift, not noise.

    Returns
    -------
    BinnedProblem
        The last bin of a recording may hold fewer cells.

    """
    sums = []
    for i, residual in enumerate(problem.residual):
        w = np.zeros_like(residual) if problem.load is None else problem.load[i]
        present = np.isfinite(residual) & np.isfinite(w)
        y, w = np.where(present, residual, 0.0), np.where(present, w, 0.0)
        rows = [present.astype(float), w, w * w, y, y * y, w * y]
        if means:
            count, load, _, total, _, _ = (_binned(row, cells) for row in rows)
            some = np.maximum(count, 1.0)
            w, y = load / some, total / some
            rows = [(count > 0).astype(float), w, w * w, y, y * y, w * y]
        else:
            rows = [_binned(row, cells) for row in rows]
        time = _time(problem, len(residual), len(rows[0]))
        sums.append(Sums(time, *rows))
    return BinnedProblem(
        period_s=cells * problem.period_s,
        cells=cells,
        temperature_c=tuple(_bin_means(values, cells) for values in problem.temperature_c),
        sums=tuple(sums),
        blocks=tuple(numbers[::cells] for numbers in problem.blocks),
        loaded=problem.load is not None,
        tared=problem.tared,
    )


def _time(problem: AxisProblem, cells: int, bins: int) -> FloatArray:
    """Lay out the time of a recording's bins, shape (n,); 0 where it is too short."""
    if not problem.tared or cells * problem.period_s < _LONG_S:
        return np.zeros(bins)
    return np.asarray(np.linspace(-1.0, 1.0, bins), dtype=float)


def _binned(values: FloatArray, cells: int) -> FloatArray:
    """Sum over bins, shapes (N, …) to (n, …)."""
    if cells == 1:
        return values
    sums: FloatArray = np.add.reduceat(values, np.arange(0, len(values), cells), axis=0)
    return sums


def _bin_means(values: FloatArray, cells: int) -> FloatArray:
    """Average over bins, shapes (N, J) to (n, J)."""
    starts = np.arange(0, len(values), cells)
    counts = np.diff(starts, append=len(values))
    means: FloatArray = _binned(values, cells) / counts[:, np.newaxis]
    return means
