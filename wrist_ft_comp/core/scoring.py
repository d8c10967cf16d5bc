"""What a model leaves of an axis' drift, and how much that is on a held-out block."""

from collections.abc import Sequence

import numpy as np

from wrist_ft_comp.core.axis_model import AxisModel
from wrist_ft_comp.core.held_out import BlockBins
from wrist_ft_comp.core.problem import AxisProblem, JUDGED_PARTS
from wrist_ft_comp.core.recording import FloatArray, IntArray


def unexplained(problem: AxisProblem, model: AxisModel | None) -> list[FloatArray]:
    """
    Subtract a model's free run, from the steady state of the first cell, from r - w.

    Parameters
    ----------
    problem : AxisProblem
        The axis; residuals that are held out stay NaN.
    model : AxisModel or None
        The model; None leaves everything.

    Returns
    -------
    list of ndarrays, shape (N_i,)
        r - w - o - s w, N or N m, up to the unknown constant of each recording.

    """
    if model is None:
        return list(problem.residual)
    left = []
    for i, temperature_c in enumerate(problem.temperature_c):
        _, drift = model.run(model.start(temperature_c[0]), temperature_c)
        explained = drift[:, 0]
        if problem.load is not None and drift.shape[1] > 1:
            explained = explained + drift[:, 1] * problem.load[i]
        left.append(problem.residual[i] - explained)
    return left


def bin_means(values: FloatArray, cells: IntArray, bin_cells: int) -> FloatArray:
    """
    Average samples over bins of consecutive cells.

    Parameters
    ----------
    values : ndarray, shape (n, ...)
        One entry per sample, at least one.
    cells : ndarray of int, shape (n,)
        Their cells, increasing.
    bin_cells : int
        Cells per bin.

    Returns
    -------
    ndarray, shape (bins that hold samples, ...)
        Means.

    """
    if bin_cells <= 1:
        return values
    bins = cells // bin_cells
    starts = np.flatnonzero(np.diff(bins, prepend=bins[0] - 1))
    counts = np.diff(starts, append=len(bins))
    sums = np.add.reduceat(values, starts, axis=0)
    return np.asarray(sums / counts.reshape(-1, *[1] * (values.ndim - 1)))


def block_bins(problem: AxisProblem, left: Sequence[FloatArray], block: int) -> list[BlockBins]:
    """
    Average what is left in a block over bins, around each recording's constant.

    Parameters
    ----------
    problem : AxisProblem
        For the block numbers.
    left : sequence of ndarrays, shape (N_i,)
        From unexplained.
    block : int
        Which block.

    Returns
    -------
    list of BlockBins
        Of the recordings that have samples in the block.

    """
    found = []
    for i, (number, values) in enumerate(zip(problem.blocks, left, strict=True)):
        finite = np.isfinite(values)
        rows = np.flatnonzero((number == block) & finite)
        if len(rows):
            inside = bin_means(values[rows], rows, problem.bin_cells[1])
            constant = (inside if problem.tared else values[(number != block) & finite]).mean()
            cells = bin_means(rows.astype(float), rows, problem.bin_cells[1])
            found.append(BlockBins(i, cells, inside - constant))
    return found


def block_errors(problem: AxisProblem, left: Sequence[FloatArray], block: int) -> list[float]:
    """
    Score a block: mean squares of bin means around each recording's constant.

    Parameters
    ----------
    problem, left, block
        As for block_bins.

    Returns
    -------
    list of float
        One per part of the block.

    """
    errors = []
    for bins in block_bins(problem, left, block):
        parts = np.array_split(bins.errors**2, min(JUDGED_PARTS, len(bins.errors)))
        errors += [float(part.mean()) for part in parts]
    return errors
