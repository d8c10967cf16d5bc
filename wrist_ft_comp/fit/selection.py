"""From the candidate that was chosen to the result of an axis: its constants, and the reason."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.fit.bins import bin_axis_data
from wrist_ft_comp.fit.cross_validation import (
    day_over_blocks,
    hold_out,
    part_errors,
    Scores,
    unexplained,
    WORTHWHILE,
)
from wrist_ft_comp.fit.gains import anchored
from wrist_ft_comp.fit.result import AxisFit, Candidate, left_of_a_day, Term


@dataclass(frozen=True, eq=False)
class Fitted:
    """A candidate, fitted up to constants; None is "no compensation". As AxisFit names them."""

    model: AxisModel | None
    time_constants_s: tuple[float, ...] = ()
    time_constant_errors_s: tuple[float, ...] = ()
    terms: tuple[Term, ...] = ()
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


def finish(
    data: AxisData,
    winner: Fitted,
    chosen: str,
    bins: Scores,
    competing: Sequence[str],
) -> AxisFit:
    """Fix what the fit leaves open, and state held-out errors, simplest candidate first."""
    notes = winner.notes
    if data.no_sensitivity:
        notes = (*notes, f'zero drift only: {data.no_sensitivity}')
    elif winner.model is not None and winner.model.outputs == 1:
        notes = (*notes, 'zero drift only: gain drift held no better than none on held-out data')
    after = {
        name: float(np.mean([np.sqrt(np.mean(each.errors**2)) for each in left]))
        for name, left in bins.items()
    }
    factor = day_over_blocks(bin_axis_data(data, data.bin_cells[0]), after['none'])
    rms = {name: left_of_a_day(each, after['none'], factor) for name, each in after.items()}
    model = None if winner.model is None else anchor(data, winner.model)
    time_constants_s, stated_errors_s = winner.time_constants_s, winner.time_constant_errors_s
    if model is not None and not time_constants_s:
        # of the real positive poles
        lasting = model.poles.real[(np.abs(model.poles.imag) < 1e-9) & (model.poles.real > 0)]
        time_constants_s = tuple(np.unique(np.round(-data.period_s / np.log(lasting), 6)).tolist())
        stated_errors_s = (float('nan'),) * len(time_constants_s)
    return AxisFit(
        model=model, chosen=chosen,
        candidates=tuple(Candidate(name, value) for name, value in rms.items()),
        rms_before=rms['none'], rms_after=rms[chosen],
        reason=_reason(data.unit, chosen, bins, rms, competing), time_constants_s=time_constants_s,
        time_constant_errors_s=stated_errors_s, terms=winner.terms, notes=notes,
        doubts=winner.doubts, unit=data.unit,
        held_out=hold_out(data, bins['none'], bins[chosen]))  # fmt: skip


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
