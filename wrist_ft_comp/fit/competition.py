"""
Axis by axis: candidates compete on held-out folds, and the simplest good one runs.

The winner is fitted to everything, and its constants are fixed. ``arx_pls_oe`` competes by its
number of free time constants; what the paper's methods compete by is in ``paper_methods``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.fit.column_pool import (
    FreeTimeConstants,
    GRID_S,
    jackknife_errors,
    least_squares,
    time_constant_errors,
)
from wrist_ft_comp.fit.cross_validation import (
    day_over_blocks,
    Fitted,
    fold_bins,
    hold_out,
    part_errors,
    Refit,
    refit_bins,
    Scores,
    simplest_good,
    unexplained,
    WORTHWHILE,
)
from wrist_ft_comp.fit.model_building import (
    anchored,
    build_axis_model,
    build_features,
    by_relaxation,
)
from wrist_ft_comp.fit.moments import accumulate, bank_inputs, bin_axis_data, BinnedData
from wrist_ft_comp.fit.result import AxisFit, Candidate, left_of_a_day, OUTPUTS, Term
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.signals import FloatArray

#: Most free time constants that compete.
_MAX_TIME_CONSTANTS = 2
#: Errors below this share of no compensation's are those of the pool's grid, and count as equal.
_GRID_ERROR = 1e-3
#: A time constant above this share of the longest that is searched may be a longer one.
_AT_BOUND = 0.99


def compete(data: AxisData, refits: Mapping[str, Refit], *, may_be_none: bool = False) -> AxisFit:
    """Let the simplest good one run; no compensation is scored beside them."""
    competing = ['none', *refits] if may_be_none else list(refits)
    refits = {'none': lambda _: (None, ()), **refits}
    bins = {name: refit_bins(data, refit) for name, refit in refits.items()}
    chosen = competing[simplest_good([part_errors(bins[name]) for name in competing])]
    return finish(data, refits[chosen](data), chosen, bins, competing)


class LagFit(NamedTuple):
    """Drift behind free time constants, fitted."""

    #: Features of the temperatures behind one relaxation.
    features: Features
    #: Increasing, s, shape (K,); a single 0 is static.
    time_constants_s: FloatArray
    #: From the features behind each to zero and sensitivity drift, shape (K, F, M).
    gains: FloatArray
    #: None without any drift.
    model: AxisModel | None


def identify_lags(data: AxisData, settings: IdentificationSettings) -> AxisFit:
    """
    Let free time constants compete on the simulation error (eq. 16), as ``arx_pls_oe``.

    They are searched in the pool of ``auto``. Standard errors are those of the jackknife over the
    folds that were held out. A drift that goes on for longer than the recordings is refused.
    """
    features = build_features(data.temperature_c, settings)
    # What runs is fitted cell by cell, the competition goes on in bins.
    everything = fit_lags(bin_axis_data(data, 1), features, data.period_s)
    held_out = {}
    for fold in data.fold_numbers:
        binned = bin_axis_data(data.without(fold), data.bin_cells[0])
        held_out[fold] = fit_lags(binned, features, data.period_s, everything)
    bins = {'none': refit_bins(data, lambda _: (None, ()))}
    for name in everything:
        bins[name] = [
            scored
            for fold, fits in held_out.items()
            for scored in fold_bins(data, unexplained(data, fits[name].model), fold)
        ]
    competing = list(everything)
    none = part_errors(bins['none'])
    least = _GRID_ERROR**2 * none.mean()
    errors = [np.maximum(part_errors(bins[name]), least) for name in competing]
    chosen = competing[simplest_good(errors)]
    lags = everything[chosen]
    if lags.time_constants_s[-1] < data.longest_s:
        fit = finish(data, (lags.model, ()), chosen, bins, competing)
        return state_errors(fit, lags, [fits[chosen] for fits in held_out.values()])
    slow = (
        f'its slowest time constant is at least {data.longest_s:.0f} s, as long as the longest '
        'recording'
    )
    if simplest_good([none, part_errors(bins[chosen])]) == 0:
        # No drift is found, so there is none that could be too slow.
        nothing = None, (f'{chosen} was left out: {slow}',)
        return finish(data, nothing, 'none', bins, ['none', chosen])
    refusal = (
        f'{data.axis} drifts too slowly for these recordings: {chosen} explains it best, but '
        f'{slow}. Record at least {2 * data.longest_s / 3600:.1f} h from cold, or choose the '
        'method pls'
    )
    fit = finish(data, (None, ()), 'none', bins, ['none'])
    return replace(fit, reason=f'{refusal}.', refusal=refusal)


def fit_lags(
    binned: BinnedData,
    features: Features,
    period_s: float,
    starts: Mapping[str, LagFit] | None = None,
) -> dict[str, LagFit]:
    """
    Fit all candidates of ``arx_pls_oe`` to what is not held out, by name, the simplest first.

    Features are of the highest degree. Searches begin where those of ``starts`` ended, or else on
    the grid of the pool.
    """
    hats = features.kind == 'hats'
    pool = accumulate(binned, bank_inputs(binned, features, GRID_S), len(GRID_S))
    normal = pool.centred()
    fits = {}
    for count in range(_MAX_TIME_CONSTANTS + 1):
        for degree in range(1, features.degree + 1):
            lags = f'{count} time constant{"s" * (count > 1)}' if count else 'static'
            name = f'{lags}, {"hats" if hats else f"degree {degree}"}'
            of_degree = replace(features, degree=degree)
            tau_s: FloatArray = np.zeros(1)
            if count:
                inputs = len(of_degree.names)
                free = FreeTimeConstants(inputs, inputs, count)
                start = (
                    np.log(starts[name].time_constants_s)
                    if starts
                    else free.first_guess([pool], [normal])
                )
                tau_s = np.exp(np.sort(free.search([pool], [normal], start)))
            fits[name] = _fit_gains(binned, of_degree, tau_s, period_s)
    return fits


def _fit_gains(
    binned: BinnedData, features: Features, time_constants_s: FloatArray, period_s: float
) -> LagFit:
    """Fit gains for given time constants, and write what runs."""
    count = len(time_constants_s)
    inputs = bank_inputs(binned, features, time_constants_s)
    moments = accumulate(binned, inputs, count)
    normal = moments.centred()
    values = least_squares(normal)[0]
    gains = by_relaxation(values, count, moments.inputs, loaded=moments.loaded)
    model = build_axis_model(features, time_constants_s, gains, inputs, period_s)
    if model is not None and moments.loaded:
        at_rest = features.expand(features.reference_c) @ gains[:, :, 1].sum(axis=0) + values[-1]
        model = anchored(model, [0.0, float(at_rest)])
    return LagFit(features, time_constants_s, gains, model)


def state_errors(fit: AxisFit, lags: LagFit, held_out: Sequence[LagFit]) -> AxisFit:
    """Add time constants and gains, with the standard errors that fits without a fold tell."""
    tau_s = lags.time_constants_s
    errors_s = time_constant_errors(tau_s, [other.time_constants_s for other in held_out])
    errors = jackknife_errors([other.gains for other in held_out])
    terms = tuple(
        Term(output, float(tau), feature, float(lags.gains[k, f, m]), float(errors[k, f, m]))
        for m, output in enumerate(OUTPUTS[: lags.gains.shape[2]])
        for k, tau in enumerate(tau_s)
        for f, feature in enumerate(lags.features.names)
    )
    if not tau_s.any():
        return replace(fit, terms=terms)
    note = f'its slowest time constant is the longest that is searched, {GRID_S[-1]:.0f} s'
    return replace(
        fit, time_constants_s=tuple(tau_s.tolist()),
        time_constant_errors_s=tuple(errors_s.tolist()), terms=terms,
        notes=(note, *fit.notes) if tau_s[-1] > _AT_BOUND * GRID_S[-1] else fit.notes)  # fmt: skip


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
    factor = day_over_blocks(bin_axis_data(data, data.bin_cells[0]), after['none'])
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
