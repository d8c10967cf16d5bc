"""The paper's methods by name; held-out folds choose their number of latents."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.fit.cross_validation import (
    part_errors,
    Refit,
    refit_bins,
    simplest_good,
    unexplained,
)
from wrist_ft_comp.fit.feature_banks import build_features
from wrist_ft_comp.fit.pls_arx import identify, PaperMethod
from wrist_ft_comp.fit.result import AxisFit
from wrist_ft_comp.fit.selection import finish, Fitted
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.signals import FloatArray

_MAX_LATENTS = 8
#: Gain drift is learnt in hats when it leaves at most this share of what leaving it alone does.
_GAIN_WORTH = 0.5


def identify_paper_method(
    data: AxisData, settings: IdentificationSettings, method: PaperMethod
) -> AxisFit:
    """Let held-out folds choose the number of latents; TooShortError where an ARX has no data."""
    refits: dict[str, Refit] = {
        f'{method}, {r} latent{"s" * (r > 1)}': partial(_fit, settings, method, r)
        for r in _latents_to_try(settings, _features(data, settings), method)
    }
    return _compete(data, refits)


def identify_hats(data: AxisData, settings: IdentificationSettings) -> AxisFit:
    """Let held-out folds choose between none and piecewise linear drift."""
    # What ``auto`` does at the plateaus of a chamber test. Gain drift is left alone unless held
    # out gains come out better: between a few temperatures they are easily worse.
    hats = replace(settings, features='hats')
    every = settings.latents or len(_features(data, hats).names)
    zero, both = partial(_fit_zero, hats, every), partial(_fit, hats, 'pls', every)
    if data.load is not None and _gain_error(data, both) < _GAIN_WORTH * _gain_error(data, zero):
        return _compete(data, {'zero and gain drift in hats': both}, may_be_none=True)
    return _compete(data, {'zero drift in hats': zero}, may_be_none=True)


def _gain_error(data: AxisData, refit: Refit) -> float:
    """Root mean square difference of the gain of folds that were held out from the others'."""
    errors = []
    for fold in data.fold_numbers:
        remainders = unexplained(data, refit(data.without(fold))[0])
        gains = {each: _gains(data, remainders, each) for each in data.fold_numbers}
        others = [gain for each, own in gains.items() if each != fold for gain in own]
        if others:  # the gain at T_ref is open as yet
            errors += [gain - np.mean(others) for gain in gains[fold]]
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


def _compete(data: AxisData, refits: Mapping[str, Refit], *, may_be_none: bool = False) -> AxisFit:
    """Let the simplest good one run; no compensation is scored beside them."""
    competing = ['none', *refits] if may_be_none else list(refits)
    refits = {'none': lambda _: (None, ()), **refits}
    bins = {name: refit_bins(data, refit) for name, refit in refits.items()}
    chosen = competing[simplest_good([part_errors(bins[name]) for name in competing])]
    model, notes = refits[chosen](data)
    return finish(data, Fitted(model, notes=notes), chosen, bins, competing)


def _fit_zero(
    settings: IdentificationSettings, latents: int, part: AxisData
) -> tuple[AxisModel | None, tuple[str, ...]]:
    """Fit zero drift beside gain drift, where there are loads, and leave the gain alone."""
    model, notes = _fit(settings, 'pls', latents, part)
    return None if model is None else model.without_gain_drift(), notes


def _features(data: AxisData, settings: IdentificationSettings) -> Features:
    """Build the features of an axis, with knots only where there are samples."""
    observed = [
        temperature_c[np.isfinite(residual)]
        for temperature_c, residual in zip(data.temperature_c, data.residual, strict=True)
    ]
    return build_features(data.temperature_c, settings, observed)


def _fit(
    settings: IdentificationSettings, method: PaperMethod, latents: int, part: AxisData
) -> tuple[AxisModel | None, tuple[str, ...]]:
    """Fit one candidate to what is not held out."""
    features = _features(part, settings)
    orders = replace(settings.orders, latents=latents)
    dynamics, notes = identify(method, part, features, orders)
    return None if dynamics is None else AxisModel(features, dynamics), notes


def _latents_to_try(
    settings: IdentificationSettings, features: Features, method: PaperMethod
) -> Sequence[int]:
    """List numbers of latents; hats take all, so that every knot keeps its own coefficients."""
    if settings.latents is not None:
        return [settings.latents]
    width = features.expand(features.reference_c).shape[0]
    if method == 'filtered_pls':
        # Hats behind a bank of filters are too many and too alike for each to keep its own.
        return range(1, min(width * len(settings.orders.time_constants_s), _MAX_LATENTS) + 1)
    return [width] if features.kind == 'hats' else range(1, min(width, _MAX_LATENTS) + 1)
