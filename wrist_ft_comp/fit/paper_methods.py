"""
The paper's methods, by their names: the number of latents and their structure compete.

Source: "Design of Temperature Compensation Module of the Industrial Robot Wrist Force Sensor Based
on Multivariate Regression Method", Sensors & Transducers, 2014; docs/paper.md goes through it
equation by equation. ``pcr`` and ``pls`` are static (eq. 3 to 10, ``pls``), ``filtered_pls`` has a
filter for each latent (eq. 11 to 14), ``arx_pls`` an ARX for each latent (eq. 15 to 22).
"""

from collections.abc import Callable, Sequence
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
from wrist_ft_comp.fit.competition import compete
from wrist_ft_comp.fit.cross_validation import (
    Fitted,
    Refit,
    unexplained,
)
from wrist_ft_comp.fit.filtered_pls import choose_filters, Filter, fit_filtered_pls
from wrist_ft_comp.fit.model_building import build_features
from wrist_ft_comp.fit.pls import fit_pcr, fit_pls
from wrist_ft_comp.fit.result import AxisFit
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.fit.xy_block import build_xy_block, XyBlock
from wrist_ft_comp.signals import FloatArray

#: Most latents that compete.
_MAX_LATENTS = 8
#: Gain drift is learnt in hats when it leaves at most this share of what leaving it alone does.
_GAIN_WORTH = 0.5

PaperMethod = Literal['pcr', 'pls', 'filtered_pls', 'arx_pls']
#: What each latent is: its orders, or its filter; static latents are STATIC.
Structure = tuple[Filter, ...]


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
    return _fit_static(method, block, len(structure)), ()


def _fit_static(method: PaperMethod, block: XyBlock, latents: int) -> ArxPls | None:
    """Fit PLS or PCR: u_r = b_r t_r (eq. 10)."""
    outer = (fit_pcr if method == 'pcr' else fit_pls)(block.x, block.y, latents)
    if not outer.latents:
        return None
    return ArxPls(
        input_mean=block.input_mean, input_weight=block.input_weight, rotations=outer.rotations,
        latents=tuple(static_gain(gain) for gain in outer.inner),
        output_loadings=outer.output_loadings, output_weight=block.output_weight,
        output_mean=np.zeros(len(block.output_weight)))  # fmt: skip


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
    fit: Callable[[Structure, AxisData], Fitted] = partial(_fit_structure, settings, method)
    structure: Structure = (STATIC,) * most
    if method == 'filtered_pls':
        structure = choose_filters(data, build_xy_block(data, features), most)
    elif method == 'arx_pls' and settings.orders:
        structure = settings.orders if len(settings.orders) > 1 else settings.orders * most
    elif method == 'arx_pls':
        structure = choose_orders(data, build_xy_block(data, features), most)
    refits: dict[str, Refit] = {
        f'{method}, {r} latent{"s" if r > 1 else ""}': partial(fit, structure[:r])
        for r in range(fewest, max(fewest, len(structure)) + 1)
    }
    return compete(data, refits)


def _fit_structure(
    settings: IdentificationSettings, method: PaperMethod, structure: Structure, part: AxisData
) -> Fitted:
    """Fit one of the paper's methods to what is not held out."""
    features = _observed_features(part, settings)
    dynamics, notes = identify(method, part, features, structure)
    return None if dynamics is None else AxisModel(features, dynamics), notes


def _observed_features(data: AxisData, settings: IdentificationSettings) -> Features:
    """Build the features of an axis, with knots only where there are samples."""
    observed = [
        temperature_c[np.isfinite(residual)]
        for temperature_c, residual in zip(data.temperature_c, data.residual, strict=True)
    ]
    return build_features(data.temperature_c, settings, observed)


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
        remainders = unexplained(data, refit(data.without(held_out))[0])
        gains = {fold: _gains(data, remainders, fold) for fold in data.fold_numbers}
        others = [gain for fold, found in gains.items() if fold != held_out for gain in found]
        if others:  # the gain at T_ref is open as yet
            errors += [gain - np.mean(others) for gain in gains[held_out]]
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else 0.0


def _gains(data: AxisData, remainders: Sequence[FloatArray], fold: int) -> list[float]:
    """Regress what is left in a fold on the load, in each recording where that varies."""
    gains = []
    for left, load, folds in zip(remainders, data.load or (), data.folds, strict=True):
        rows = (folds == fold) & np.isfinite(left) & np.isfinite(load)
        w = load[rows] - load[rows].mean() if rows.any() else load[rows]
        if w.any():
            gains.append(float(w @ left[rows]) / float(w @ w))
    return gains
