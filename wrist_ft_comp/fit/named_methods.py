"""
The paper's methods, by their names, and hats: candidates compete, and the simplest good one runs.

Source: "Design of Temperature Compensation Module of the Industrial Robot Wrist Force Sensor Based
on Multivariate Regression Method", Sensors & Transducers, 2014; docs/paper.md goes through it
equation by equation. ``pcr`` and ``pls`` are static (eq. 3 to 10, ``pls``), ``filtered_pls`` has a
filter for each latent (eq. 11 to 14), ``arx_pls`` an ARX for each latent (eq. 15 to 22). What
competes is the number of latents and their structure, on held-out folds; the winner is fitted to
everything, and its constants are fixed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from wrist_ft_comp.drift.arx import static_gain
from wrist_ft_comp.drift.arx_pls import ArxPls
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.arx_least_squares import Orders, STATIC
from wrist_ft_comp.fit.arx_pls import choose_orders, fit_arx_pls
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
from wrist_ft_comp.fit.filtered_pls import choose_filters, Filter, fit_filtered_pls
from wrist_ft_comp.fit.model_building import anchored, build_features
from wrist_ft_comp.fit.pls import fit_pcr, fit_pls
from wrist_ft_comp.fit.result import AxisFit, Candidate
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.fit.xy_block import build_xy_block

#: Most latents that compete.
_MAX_LATENTS = 8
#: Gain drift is learnt in hats when it leaves at most this share of what leaving it alone does.
_GAIN_WORTH = 0.5
#: Share of rounding in a sum of squares.
_ROUNDING = 1e-12

PaperMethod = Literal['pcr', 'pls', 'filtered_pls', 'arx_pls']
#: What each latent is: its orders, or its filter; static latents are STATIC.
Structure = tuple[Filter, ...]


def identify_paper_method(
    data: AxisData, settings: IdentificationSettings, method: PaperMethod
) -> AxisFit:
    """
    Let held-out folds choose each latent's structure, then how many latents there are.

    TooShortError is raised where no ARX finds enough consecutive samples.
    """
    features = _observed_features(data, settings)
    width = len(features.names)
    # Hats take all latents, so that every knot keeps its own coefficients.
    fewest = width if features.kind == 'hats' else 1
    most = width if features.kind == 'hats' else min(width, _MAX_LATENTS)
    if settings.latents is not None:
        fewest = most = settings.latents
    elif len(settings.orders) > 1:
        fewest = most = len(settings.orders)
    structure: Structure = (STATIC,) * most
    if method == 'filtered_pls':
        structure = choose_filters(data, build_xy_block(data, features), most)
    elif method == 'arx_pls' and settings.orders:
        structure = settings.orders if len(settings.orders) > 1 else settings.orders * most
    elif method == 'arx_pls':
        structure = choose_orders(data, build_xy_block(data, features), most)
    return compete(
        data,
        {
            f'{method}, {r} latent{"s" if r > 1 else ""}': partial(
                _fit_structure, settings, method, structure[:r]
            )
            for r in range(fewest, max(fewest, len(structure)) + 1)
        },
    )


def _observed_features(data: AxisData, settings: IdentificationSettings) -> Features:
    """Build the features of an axis, with knots only where there are samples."""
    observed = [
        temperature_c[np.isfinite(residual)]
        for temperature_c, residual in zip(data.temperature_c, data.residual, strict=True)
    ]
    return build_features(data.temperature_c, settings, observed)


def _fit_structure(
    settings: IdentificationSettings, method: PaperMethod, structure: Structure, part: AxisData
) -> Fitted:
    """Fit one of the paper's methods to what is not held out."""
    features = _observed_features(part, settings)
    dynamics, notes = identify(method, part, features, structure)
    return None if dynamics is None else AxisModel(features, dynamics), notes


def identify(
    method: PaperMethod, data: AxisData, features: Features, structure: Structure
) -> tuple[ArxPls | None, tuple[str, ...]]:
    """
    Identify an axis by one of the paper's methods, with a latent for each entry of a structure.

    The model is None where the inputs explain nothing. Sentences beside it say what each latent
    is. TooShortError is raised where an ARX does not find enough consecutive samples.
    """
    block = build_xy_block(data, features)
    if not block.observed:
        return None, ()
    if method == 'filtered_pls':
        return fit_filtered_pls(block, structure, data.period_s)
    if method == 'arx_pls':
        return fit_arx_pls(block, [orders for orders in structure if isinstance(orders, Orders)])
    outer = (fit_pcr if method == 'pcr' else fit_pls)(block.x, block.y, len(structure))
    # u_r = b_r t_r (eq. 10)
    latents = [static_gain(gain) for gain in outer.inner]
    return block.model(outer.rotations, latents, outer.output_loadings), ()


def identify_hats(data: AxisData, settings: IdentificationSettings) -> AxisFit:
    """
    Let held-out folds choose between none and piecewise linear drift.

    This is what ``auto`` does at the plateaus of a chamber test. Gain drift is left alone unless
    held-out gains come out better: between a few temperatures they are easily worse.
    """
    hats = replace(settings, features='hats')
    latents = settings.latents or len(_observed_features(data, hats).names)
    both: Refit = partial(_fit_structure, hats, 'pls', (STATIC,) * latents)

    def zero(part: AxisData) -> Fitted:
        """Fit zero drift beside gain drift, where there are loads, and leave the gain alone."""
        model, notes = both(part)
        return None if model is None else model.without_gain_drift(), notes

    if data.load is not None and _gain_error(data, both) < _GAIN_WORTH * _gain_error(data, zero):
        return compete(data, {'zero and gain drift in hats': both}, may_be_none=True)
    return compete(data, {'zero drift in hats': zero}, may_be_none=True)


def _gain_error(data: AxisData, refit: Refit) -> float:
    """Root mean square difference of the gain of folds that were held out from the others'."""
    errors = []
    for held_out in data.fold_numbers:
        inside, others = list[float](), list[float]()
        remainders = unexplained(data, refit(data.without(held_out))[0])
        for fold in data.fold_numbers:
            # Regress what is left on the load, in each recording where that varies.
            for left, load, folds in zip(remainders, data.load or (), data.folds, strict=True):
                rows = (folds == fold) & np.isfinite(left) & np.isfinite(load)
                w = load[rows] - load[rows].mean() if rows.any() else load[rows]
                if w.any():
                    gain = float(w @ left[rows]) / float(w @ w)
                    (inside if fold == held_out else others).append(gain)
        if others:  # the gain at T_ref is open as yet
            errors += [gain - np.mean(others) for gain in inside]
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else 0.0


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
    time_constants_s: list[float] = []
    if model is not None:
        model = anchor(data, model)
        # Those of the real positive poles.
        lasting = model.poles.real[(np.abs(model.poles.imag) < 1e-9) & (model.poles.real > 0)]
        time_constants_s = np.unique(np.round(-data.period_s / np.log(lasting), 6)).tolist()
    after = {
        name: float(np.mean([np.sqrt(np.mean(fold.errors**2)) for fold in left]))
        for name, left in bins.items()
    }
    factor = day_over_blocks(data, after['none'])
    rms = {name: left_of_a_day(left, after['none'], factor) for name, left in after.items()}
    reason = f'{chosen} leaves {rms[chosen]:.3g} {data.unit} RMS on held-out data'
    if chosen != 'none':
        reason += f', no compensation {rms["none"]:.3g} {data.unit}'
    best = min(competing, key=lambda name: float(part_errors(bins[name]).mean()))
    if len(competing) == 1:
        reason += '; nothing else competed.'
    elif best == chosen:
        reason += f'; of {len(competing)} candidates it is the best.'
    else:
        reason += (
            f'; the best of {len(competing)}, {best}, is better by no more than chance, or than '
            f'{100 * WORTHWHILE:.0f} % in mean square, and less simple.'
        )
    held_out = hold_out(
        [
            (none.recording, none.fold, none.cells, none.errors, compensated.errors)
            for none, compensated in zip(bins['none'], bins[chosen], strict=True)
        ],
        data.bin_cells[0] * data.period_s,
        tared=data.tared,
    )
    return AxisFit(
        model=model, chosen=chosen,
        candidates=tuple(Candidate(name, value) for name, value in rms.items()),
        rms_before=rms['none'], rms_after=rms[chosen], reason=reason,
        time_constants_s=tuple(time_constants_s),
        time_constant_errors_s=(float('nan'),) * len(time_constants_s), notes=notes,
        unit=data.unit, held_out=held_out)  # fmt: skip


def anchor(data: AxisData, model: AxisModel) -> AxisModel:
    """Fix the constants: no zero drift when soaked at T_ref, and the gain error there, if any."""
    without_gain_error = anchored(model, [0.0] * model.outputs)
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
    gain_error = above / below if below > _ROUNDING * whole else 0.0
    return anchored(model, [0.0, gain_error])
