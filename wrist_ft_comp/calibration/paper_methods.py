"""The paper's methods by name; held-out folds choose their number of latents."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from wrist_ft_comp.calibration.cross_validation import (
    hold_out,
    part_errors,
    Refit,
    refit_bins,
    simplest_good,
)
from wrist_ft_comp.calibration.features import build_features
from wrist_ft_comp.calibration.result import AxisFit
from wrist_ft_comp.calibration.selection import finish, Fitted
from wrist_ft_comp.calibration.settings import IdentificationSettings
from wrist_ft_comp.identification.axis_data import AxisData
from wrist_ft_comp.identification.pls_arx import identify, PaperMethod
from wrist_ft_comp.model.axis_model import AxisModel
from wrist_ft_comp.model.features import Features

_MAX_LATENTS = 8


def identify_paper_method(
    data: AxisData,
    settings: IdentificationSettings,
    methods: Sequence[PaperMethod | Literal['none']],
) -> AxisFit:
    """
    Let held-out folds choose among the paper's methods and their numbers of latents.

    "none" among the methods stands for no compensation. An ARX without enough consecutive samples
    is a TooShortError.
    """
    refits: dict[str, Refit] = {'none': lambda _: (None, ())}
    for method in methods:
        if method != 'none':
            for r in _latents_to_try(settings, _features(data, settings), method):
                name = f'{method}, {r} latent{"s" * (r > 1)}'
                refits[name] = partial(_fit, settings, method, r)
    bins = {name: refit_bins(data, refit) for name, refit in refits.items()}
    errors = {name: part_errors(each) for name, each in bins.items()}
    competing = [name for name in refits if name != 'none' or 'none' in methods]
    chosen = competing[simplest_good([errors[name] for name in competing])]
    model, notes = refits[chosen](data)
    result = finish(data, Fitted(model, notes=notes), chosen, errors, competing)
    return replace(result, held_out=hold_out(data, bins['none'], bins[chosen]))


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
