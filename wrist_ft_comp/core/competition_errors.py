"""The errors behind a candidate's score, bin by bin."""

from dataclasses import replace

import numpy as np

from wrist_ft_comp.core import simulation_error as oe
from wrist_ft_comp.core.binned import Sums
from wrist_ft_comp.core.competition import Competition, Entry, left_out_time_constants
from wrist_ft_comp.core.held_out import BlockBins
from wrist_ft_comp.core.moments import accumulate, bank_inputs
from wrist_ft_comp.core.recording import BoolArray, FloatArray


def left_out_bins(competition: Competition, entry: Entry | None, block: int) -> list[BlockBins]:
    """
    Fit a candidate to all blocks but one, and keep its errors there.

    Parameters
    ----------
    competition : Competition
        What it is fitted from and scored on.
    entry : Entry or None
        The candidate; None is "no compensation".
    block : int
        Which block.

    Returns
    -------
    list of BlockBins
        Of the recordings that have samples in the block.

    """
    judged = competition.judged
    left = [of.residual for of in judged.sums]
    if entry is not None:
        left = _left(competition, entry, block)
    cells = judged.period_s / competition.problem.period_s
    found = []
    for i, (errors, of, number) in enumerate(zip(left, judged.sums, judged.blocks, strict=True)):
        present = of.count > 0
        held = (number == block) & present
        if held.any():
            basis = held if judged.tared else ~held & present
            level = _level(errors, of.time, basis)
            middles = (np.flatnonzero(held) + 0.5) * cells - 0.5
            last = len(competition.problem.residual[i]) - 1
            found.append(BlockBins(i, np.minimum(middles, last), (errors - level)[held]))
    return found


def _level(errors: FloatArray, time: FloatArray, basis: BoolArray) -> FloatArray:
    """Fit what no temperature has to explain: a constant, and a trend where time is not 0."""
    one_and_time = np.stack((np.ones_like(time), time), axis=1)
    level = np.linalg.lstsq(one_and_time[basis], errors[basis], rcond=None)[0]
    return np.asarray(one_and_time @ level, dtype=float)


def _left(competition: Competition, entry: Entry, block: int) -> list[FloatArray]:
    """Leave of r - w what a fit to the other blocks does not explain, shapes (n_i,)."""
    features = competition.features_of(entry.structure)
    tau_s = left_out_time_constants(competition, entry, block)
    structure = replace(entry.structure, free_time_constants=0, bank_s=tuple(tau_s))
    fitted, judged = competition.fitted, competition.judged
    moments = accumulate(fitted, bank_inputs(fitted, features, tau_s), tau_s)
    columns, coefficients = oe.fit_columns(
        moments, structure, moments.block != block, moments.inputs
    )
    theta = np.zeros(moments.sums.shape[1] - 1)
    theta[columns] = coefficients[entry.strength]
    return [
        of.residual - _design(x, of, loaded=judged.loaded) @ theta
        for x, of in zip(bank_inputs(judged, features, tau_s), judged.sums, strict=True)
    ]


def _design(x: FloatArray, of: Sums, *, loaded: bool) -> FloatArray:
    """
    Draw the regressors of the equation in simulation_error, without the constant.

        [ x_f(H_τ T) … | w x_f(H_τ T) … | w ]     with load
        [ x_f(H_τ T) … ]                          without
    """
    w = of.load[:, np.newaxis]
    return np.concatenate((x, w * x, w), axis=1) if loaded else x
