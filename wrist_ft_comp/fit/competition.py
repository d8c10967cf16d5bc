"""
Axis by axis: candidates compete on held-out folds, and the simplest good one runs.

The winner is fitted to everything, and its constants are fixed. What the paper's methods compete
by is in ``paper_methods``, and how many time constants a drift has in ``arx_pls_oe``.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.fit.cross_validation import (
    Fitted,
    hold_out,
    part_errors,
    Refit,
    refit_bins,
    Scores,
    simplest_good,
    unexplained,
    WORTHWHILE,
)
from wrist_ft_comp.fit.day_limit import day_over_blocks, left_of_a_day
from wrist_ft_comp.fit.model_building import anchored
from wrist_ft_comp.fit.result import AxisFit, Candidate


def compete(data: AxisData, refits: Mapping[str, Refit], *, may_be_none: bool = False) -> AxisFit:
    """Let the simplest good one run; no compensation is scored beside them."""
    competing = ['none', *refits] if may_be_none else list(refits)
    refits = {'none': lambda _: (None, ()), **refits}
    bins = {name: refit_bins(data, refit) for name, refit in refits.items()}
    chosen = competing[simplest_good([part_errors(bins[name]) for name in competing])]
    return finish(data, refits[chosen](data), chosen, bins, competing)


def finish(
    data: AxisData, winner: Fitted, chosen: str, bins: Scores, competing: Sequence[str]
) -> AxisFit:
    """
    Fix the constants of the winner, and state held-out errors.

    Scores are those of all candidates, ``none`` among them, the simplest first; competing are the
    names of those that could have been chosen.
    """
    model, notes = winner
    if data.no_sensitivity:
        notes = (*notes, f'zero drift only: {data.no_sensitivity}')
    elif model is not None and model.outputs == 1:
        notes = (*notes, 'zero drift only: gain drift held no better than none on held-out data')
    after = {
        name: float(np.mean([np.sqrt(np.mean(fold.errors**2)) for fold in left]))
        for name, left in bins.items()
    }
    factor = day_over_blocks(data, after['none'])
    rms = {name: left_of_a_day(left, after['none'], factor) for name, left in after.items()}
    time_constants_s: list[float] = []
    if model is not None:
        model = anchor(data, model)
        # Those of the real positive poles.
        lasting = model.poles.real[(np.abs(model.poles.imag) < 1e-9) & (model.poles.real > 0)]
        time_constants_s = np.unique(np.round(-data.period_s / np.log(lasting), 6)).tolist()
    return AxisFit(
        model=model, chosen=chosen,
        candidates=tuple(Candidate(name, value) for name, value in rms.items()),
        rms_before=rms['none'], rms_after=rms[chosen],
        reason=_reason(data.unit, chosen, bins, rms, competing),
        time_constants_s=tuple(time_constants_s),
        time_constant_errors_s=(float('nan'),) * len(time_constants_s), notes=notes,
        unit=data.unit, held_out=hold_out(data, bins['none'], bins[chosen]))  # fmt: skip


def anchor(data: AxisData, model: AxisModel) -> AxisModel:
    """Fix the constants: no zero drift when soaked at T_ref, and the gain error there, if any."""
    at_rest = [0.0] * model.outputs
    without_gain_error = anchored(model, at_rest)
    if data.load is None or model.outputs == 1:
        return without_gain_error
    above, below, whole = 0.0, 0.0, 0.0
    for values, load in zip(unexplained(data, without_gain_error), data.load, strict=True):
        rows = np.isfinite(values) & np.isfinite(load)
        if rows.any():
            w = load[rows] - load[rows].mean()
            above += float(w @ values[rows])
            below += float(w @ w)
            whole += float(load[rows] @ load[rows])
    # A load that is constant within each recording leaves the gain error at T_ref open.
    gain_error = above / below if below > 1e-12 * whole else 0.0
    return anchored(model, [0.0, gain_error])


def _reason(
    unit: str, chosen: str, bins: Scores, rms: Mapping[str, float], competing: Sequence[str]
) -> str:
    """Say in one sentence why a candidate was chosen."""
    outcome = f'{chosen} leaves {rms[chosen]:.3g} {unit} RMS on held-out data'
    if chosen != 'none':
        outcome += f', no compensation {rms["none"]:.3g} {unit}'
    if len(competing) == 1:
        return f'{outcome}; nothing else competed.'
    best = min(competing, key=lambda name: float(part_errors(bins[name]).mean()))
    if best == chosen:
        return f'{outcome}; of {len(competing)} candidates it is the best.'
    return (
        f'{outcome}; the best of {len(competing)}, {best}, is better by no more than chance, or '
        f'than {100 * WORTHWHILE:.0f} % in mean square, and less simple.'
    )
