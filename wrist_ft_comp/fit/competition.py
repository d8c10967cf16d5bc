"""
Which candidate of an axis wins, what the winner has to gain, and what is stated of it.

Candidates are scored on folds that they did not see, in free run, on means over bins.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrist_ft_comp.channels import axis_unit
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.errors import TooShortError
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.fit.day_limit import day_over_blocks, expected_rms
from wrist_ft_comp.fit.folds import fold_means, hold_out, unexplained
from wrist_ft_comp.fit.result import AxisFit, Candidate, HeldOut, rms_by_fold
from wrist_ft_comp.series import FloatArray, ROUNDING

#: A candidate has to lower the mean square error by this share to be worth its complexity.
WORTHWHILE = 0.15
#: An average that lowers what is left of held-out recordings by less than this is not run, ...
_WORTH_RUNNING = 0.02
#: ... nor one that leaves this many times more of one of several recordings: it was right by
#: chance on the others. Of 144 axes on which there is nothing to learn one left 1.82 times as much
#: without this rule, with it none more than 1.1 times. Thirds of a single recording say less:
#: there an average that left 3 times more of one of them left 0.11 of another day.
HARMFUL_FOLD = 1.25

#: A model, None for "no compensation", and what had to be mended, in sentences.
Fitted = tuple[AxisModel | None, tuple[str, ...]]
#: Fits an axis, of which a fold may be held out.
Refit = Callable[[AxisData], Fitted]


def simplest_good(squares: Sequence[float]) -> int:
    """Find the simplest candidate within 15 % of the best by mean squares, the simplest first."""
    best = min(squares)
    return next(i for i, square in enumerate(squares) if square - best <= WORTHWHILE * square)


def averaged(left: HeldOut, weights: FloatArray) -> HeldOut:
    """Add the errors of an average of candidates, weights (C,)."""
    return replace(left, errors=np.column_stack((left.errors, left.errors @ weights)))


def is_worth_running(left: HeldOut, weights: FloatArray) -> bool:
    """Tell whether an average, weights (C,), leaves less of the folds than no compensation."""
    before, after = rms_by_fold(averaged(left, weights))
    several = len(np.unique(left.recording)) > 1
    harmful = several and (after > HARMFUL_FOLD * before).any()
    return bool(after.mean() < (1 - _WORTH_RUNNING) * before.mean() and not harmful)


def compete(data: AxisData, refits: Mapping[str, Refit], *, may_be_none: bool = False) -> AxisFit:
    """
    Let the simplest good candidate run, fix its constants, and state held-out errors.

    Candidates stand in order, the simplest first; no compensation is scored beside them. What is
    too long for the recordings does not compete; TooShortError is raised where nothing is left.
    """
    refits = {'none': lambda _: (None, ()), **refits}
    means = {}
    for name, refit in refits.items():
        try:
            means[name] = [
                fold_means(data, i, fold, unexplained(data, refit(data.without(fold))[0], i))
                for i, fold in data.folds_by_recording
            ]
        except TooShortError as error:  # noqa: PERF203 -- each may be refused
            too_short = error
    first = 0 if may_be_none else 1
    names = list(means)
    if not names[first:]:
        raise too_short
    cells = [cells for cells, _ in means['none']]
    by_fold = zip(*([errors for _, errors in of_one] for of_one in means.values()), strict=True)
    left = hold_out(data, cells, [np.stack(errors, axis=1) for errors in by_fold])
    squares = left.squares().mean(axis=0)[first:].tolist()
    winner = simplest_good(squares)
    chosen, best = names[first + winner], names[first + squares.index(min(squares))]
    model, notes = refits[chosen](data)
    if model is not None:
        model = anchor(data, model)
    weights = np.eye(len(names))[first + winner]
    fit = state_fit(data, model, chosen, left, names, weights, notes)
    reason = (
        f'{chosen} leaves {fit.rms_after:.3g} {fit.unit} RMS on held-out data, no compensation '
        f'{fit.rms_before:.3g} {fit.unit}. Of {len(squares)} candidates it is the simplest within '
        f'{100 * WORTHWHILE:.0f} % of the best in mean square, which is {best}.'
    )
    return replace(fit, reason=reason)


def anchor(data: AxisData, model: AxisModel) -> AxisModel:
    """Fix the constants: no zero drift when soaked at T_ref, and the gain error there, if any."""
    model = model.anchored([0.0] * model.outputs)
    if data.load is None or model.outputs == 1:
        return model
    above, below, whole = 0.0, 0.0, 0.0
    for i, load in enumerate(data.load):
        values = unexplained(data, model, i)
        rows = np.isfinite(values) & np.isfinite(load)
        if rows.any():
            w = load[rows] - load[rows].mean()
            above += float(w @ values[rows])
            below += float(w @ w)
            whole += float(load[rows] @ load[rows])
    # A load that is constant within each recording leaves the gain error at T_ref open.
    return model.anchored([0.0, above / below if below > ROUNDING * whole else 0.0])


def state_fit(  # noqa: PLR0913, PLR0917 -- what was chosen, and from what
    data: AxisData,
    model: AxisModel | None,
    chosen: str,
    left: HeldOut,
    names: Sequence[str],
    weights: FloatArray,
    notes: tuple[str, ...] = (),
) -> AxisFit:
    """
    State what an average of candidates leaves: names and weights, (C,), the first no compensation.

    Candidates of one name are stated together, in their weighted mean.
    """
    held_out = averaged(left, weights)
    squares = held_out.squares()  # (folds, C + 1)
    each = np.sqrt(squares).mean(axis=0)
    before, after = float(each[0]), float(each[-1])
    factor = day_over_blocks(data, before)
    rounding = ROUNDING * max(np.fmax.reduce(np.abs(r), initial=0.0) for r in data.residual)

    def of_a_day(rms: float) -> float:
        # What leaves less of blocks than no compensation does not leave more of a day.
        stated = max(rms, min(factor * rms, before))
        return stated if stated > rounding else 0.0

    tried = []
    for name in dict.fromkeys(names):
        members = [position for position, one in enumerate(names) if one == name]
        shares = weights[members]
        rms = np.average(each[members], weights=shares if shares.any() else None)
        tried.append(Candidate(name, of_a_day(float(rms)), float(shares.sum())))
    expected = expected_rms(data, squares[:, -1], squares[:, :-1] @ weights, squares[:, 0])
    if data.no_sensitivity:
        notes = (*notes, f'zero drift only: {data.no_sensitivity}')
    return AxisFit(
        model=model, chosen=chosen, candidates=tuple(tried), rms_before=tried[0].rms,
        rms_after=of_a_day(after), notes=notes, unit=axis_unit(data.axis),
        held_out=held_out, expected_rms=expected if after else 0.0,
        )  # fmt: skip
