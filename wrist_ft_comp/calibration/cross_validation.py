"""What a model leaves of an axis' drift, and how much that is on a held-out block."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.identification.problem import AxisProblem, JUDGED_PARTS
from wrist_ft_comp.model.axis_model import AxisModel
from wrist_ft_comp.model.signals import FloatArray, IntArray


class BlockBins(NamedTuple):
    """
    Errors of one recording in one block, averaged over bins.

    Attributes
    ----------
    recording : int
        Which recording, counted from 0.
    cells : ndarray, shape (n,)
        Mean number of each bin's cells.
    errors : ndarray, shape (n,)
        N or N m, around the constant that the block is judged by.

    """

    recording: int
    cells: FloatArray
    errors: FloatArray


#: Given a block, the errors in it of a model that never saw it, recording by recording.
LeftOutRun = Callable[[int], Sequence[BlockBins]]


@dataclass(frozen=True, eq=False)
class HeldOut:
    """
    Errors of one axis on held-out blocks, averaged over bins.

    Both errors are counted from the same constant: that of the block, as if the sensor had been
    tared in it, or, for plateaus of a chamber test, that of the other plateaus.

    Attributes
    ----------
    recording : ndarray of int, shape (n,)
        Which recording, counted from 0.
    block : ndarray of int, shape (n,)
        Which block was held out.
    cell : ndarray, shape (n,)
        Mean number of the bin's cells, counted from the recording's first.
    before, after : ndarray, shape (n,)
        Error without compensation, and of the chosen candidate fitted to the other blocks, N or
        N m.
    bin_s : float
        Length of a bin, s.
    tared : bool
        Whether the constant is the block's own.
    detrended : bool
        Whether errors are counted from a slow trend, too.

    """

    recording: IntArray
    block: IntArray
    cell: FloatArray
    before: FloatArray
    after: FloatArray
    bin_s: float
    tared: bool
    detrended: bool


class BlockErrors(NamedTuple):
    """
    Root mean square errors block by block.

    Attributes
    ----------
    before, after : ndarray, shape (blocks,)
        N or N m.

    """

    before: FloatArray
    after: FloatArray


def hold_out(
    problem: AxisProblem, before: LeftOutRun, after: LeftOutRun, *, detrended: bool = False
) -> HeldOut:
    """
    Hold every block out in turn and keep the errors on it.

    Parameters
    ----------
    problem : AxisProblem
        The axis.
    before, after : callable
        Errors without compensation, and of the chosen candidate, in the same bins.
    detrended : bool
        As in HeldOut.

    Returns
    -------
    HeldOut
        By recording and time.

    """
    rows: list[FloatArray] = []
    for block in problem.block_numbers:
        for raw, compensated in zip(before(block), after(block), strict=True):
            count = len(raw.cells)
            number, held = np.full(count, raw.recording), np.full(count, block)
            rows.append(np.stack((number, held, raw.cells, raw.errors, compensated.errors)))
    recording, held_out, cell, errors_before, errors_after = np.concatenate(rows, axis=1)
    order = np.lexsort((cell, recording))
    return HeldOut(
        recording=recording[order].astype(np.int64),
        block=held_out[order].astype(np.int64),
        cell=cell[order],
        before=errors_before[order],
        after=errors_after[order],
        bin_s=problem.bin_cells[1] * problem.period_s,
        tared=problem.tared,
        detrended=detrended,
    )


def rms_by_block(held_out: HeldOut) -> BlockErrors:
    """
    Sum held-out errors up, block by block.

    Parameters
    ----------
    held_out : HeldOut
        Errors.

    Returns
    -------
    BlockErrors
        In increasing order of the block's number.

    """
    blocks = np.unique(held_out.block)
    before, after = (
        np.array([np.sqrt(np.mean(errors[held_out.block == block] ** 2)) for block in blocks])
        for errors in (held_out.before, held_out.after)
    )
    return BlockErrors(before, after)


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
