"""
What a held-out block looks like: the errors behind a held-out figure, one by one.

Pictures of a calibration are drawn from these, so that they show what its figures say and not how
well a model repeats what it was fitted to.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.core.problem import AxisProblem
from wrist_ft_comp.core.recording import FloatArray, IntArray


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
