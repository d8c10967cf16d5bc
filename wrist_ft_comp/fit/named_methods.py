"""
The methods that a person may name, and hats: candidates compete, and the simplest good one runs.

Source: "Design of Temperature Compensation Module of the Industrial Robot Wrist Force Sensor Based
on Multivariate Regression Method", Sensors & Transducers, 2014; docs/paper.md goes through it
equation by equation. ``pcr`` and ``pls`` are static (eq. 3 to 10), ``filtered_pls`` has a filter
for each latent (eq. 11 to 14, all in ``pls``), ``arx_pls`` an ARX for each latent (eq. 15 to 22).
``arx_pls_oe`` has free time constants that minimise the error of the free run (eq. 16). What
competes are latents and their structure, or how many time constants there are, on held-out folds;
the winner is fitted to everything, and its constants are fixed.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Literal

import numpy as np
import scipy  # which loads its parts when they are used

from wrist_ft_comp.channels import axis_unit
from wrist_ft_comp.drift.arx import static_gain
from wrist_ft_comp.drift.arx_pls import ArxPls
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.errors import TooShortError
from wrist_ft_comp.fit.arx_pls import choose_orders, fit_arx_pls
from wrist_ft_comp.fit.axis_data import AxisData, build_features
from wrist_ft_comp.fit.day_limit import day_over_blocks, left_of_a_day
from wrist_ft_comp.fit.folds import (
    Fitted,
    hold_out,
    part_errors,
    Refit,
    refit_bins,
    simplest_good,
    unexplained,
    WORTHWHILE,
)
from wrist_ft_comp.fit.pls import build_xy_block, fit_filtered_pls, fit_pcr, fit_pls
from wrist_ft_comp.fit.result import AxisFit, Candidate
from wrist_ft_comp.fit.ridge_bank import (
    bin_axis_data,
    BinnedData,
    build_axis_model,
    LONG_BANK_S,
    POOL_S,
    sum_by_fold,
)
from wrist_ft_comp.fit.settings import IdentificationSettings, Orders, STATIC
from wrist_ft_comp.series import FloatArray, ROUNDING

PaperMethod = Literal['pcr', 'pls', 'filtered_pls', 'arx_pls']
#: What each latent is: its orders, or the time constant of its filter, s.
Structure = tuple[Orders | float, ...]


def identify_paper_method(
    data: AxisData, settings: IdentificationSettings, method: PaperMethod
) -> AxisFit:
    """
    Let held-out folds choose how many latents there are, and their structure.

    Each latent of arx_pls has orders of its own; all of filtered_pls have one relaxation.
    TooShortError is raised where no ARX finds enough consecutive samples.
    """
    features = build_features(data.temperature_c, settings, data.residual)
    width, orders = features.width, settings.orders
    # Hats take all latents, so that every knot keeps its own coefficients.
    fixed = settings.latents or (len(orders) if len(orders) > 1 else 0)
    fixed = fixed or (width if features.kind == 'hats' else 0)
    most = fixed or width
    structures: list[Structure] = [(STATIC,) * most]
    if method == 'filtered_pls':
        structures = [(tau_s,) * most for tau_s in LONG_BANK_S]
    elif method == 'arx_pls' and orders:
        structures = [orders if len(orders) > 1 else orders * most]
    elif method == 'arx_pls':
        structures = [choose_orders(data, build_xy_block(data, features), most)]
    refits = dict[str, Refit]()
    for r in range(fixed or 1, max(fixed, *map(len, structures)) + 1):
        for structure in structures:
            name = f'{method}, {r} latent{"s" if r > 1 else ""}'
            if method == 'filtered_pls':
                name += f', relaxation {structure[0]} s'
            refits[name] = partial(_fit_structure, settings, method, structure[:r])
    return compete(data, refits)


def _fit_structure(
    settings: IdentificationSettings, method: PaperMethod, structure: Structure, part: AxisData
) -> Fitted:
    """Fit one of the paper's methods to what is not held out."""
    features = build_features(part.temperature_c, settings, part.residual)
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
        constants_s = [tau for tau in structure if not isinstance(tau, Orders)]
        return fit_filtered_pls(block, constants_s, data.period_s)
    if method == 'arx_pls':
        return fit_arx_pls(block, [orders for orders in structure if isinstance(orders, Orders)])
    outer = (fit_pcr if method == 'pcr' else fit_pls)(block.x, block.y, len(structure))
    # u_r = b_r t_r (eq. 10)
    latents = [static_gain(gain) for gain in outer.inner]
    return block.model(outer.rotations, latents, outer.output_loadings), ()


def identify_hats(data: AxisData, settings: IdentificationSettings) -> AxisFit:
    """
    Let held-out folds choose between none and piecewise linear zero drift.

    This is what ``auto`` does at the plateaus of a chamber test. Gain drift is left alone: between
    a few temperatures it is easily worse than none. ``pls`` in hats learns it.
    """
    hats = replace(settings, features='hats')
    features = build_features(data.temperature_c, hats, data.residual)
    latents = settings.latents or features.width

    def fit_zero(part: AxisData) -> Fitted:
        model, notes = _fit_structure(hats, 'pls', (STATIC,) * latents, part)
        return None if model is None else model.without_gain_drift(), notes

    return compete(data, {'zero drift in hats': fit_zero}, may_be_none=True)


def identify_lags(data: AxisData, settings: IdentificationSettings) -> AxisFit:
    """
    Let none, one or two free time constants compete on the error of the free run.

    A drift that goes on for longer than the recordings is refused.
    """
    features = build_features(data.temperature_c, settings)
    refits: dict[str, Refit] = {}
    for count, lags in enumerate(('static', '1 time constant', '2 time constants')):
        for degree in range(1, features.degree + 1):
            name = 'hats' if features.kind == 'hats' else f'degree {degree}'
            refits[f'{lags}, {name}'] = partial(fit_lags, replace(features, degree=degree), count)
    fit = compete(data, refits)
    if fit.model is None or not fit.model.filters:
        return fit
    tau_s = _time_constants_s(fit.model, data.period_s)
    if tau_s[-1] >= data.longest_s:
        refusal = (
            f'{data.axis} drifts too slowly for these recordings: {fit.chosen} explains it best, '
            f'but its slowest time constant is at least {data.longest_s:.0f} s, as long as the '
            f'longest recording. Record at least {2 * data.longest_s / 3600:.1f} h from cold, or '
            'choose the method pls'
        )
        return replace(
            compete(data, {}, may_be_none=True), candidates=fit.candidates, refusal=refusal,
            reason=f'{refusal}.')  # fmt: skip
    # The jackknife: how far the fits scatter that were made without each fold in turn.
    others = [refits[fit.chosen](data.without(fold))[0] for fold in data.fold_numbers]
    others_s = [_time_constants_s(model, data.period_s) for model in others if model]
    errors_s = np.sqrt((len(others_s) - 1) * np.var(others_s, axis=0))
    return replace(
        fit, time_constants_s=tuple(tau_s.tolist()),
        time_constant_errors_s=tuple(errors_s.tolist()))  # fmt: skip


def _time_constants_s(model: AxisModel, period_s: float) -> FloatArray:
    """Give the time constants of a bank of relaxations, s."""
    return -period_s / np.log([-lag.a[0] for lag in model.filters])


def fit_lags(features: Features, count: int, data: AxisData) -> Fitted:
    """
    Fit drift behind free time constants; poles are relaxations, since heat conducts by no others.

    For given time constants every gain is linear, so ln τ alone is searched (variable projection),
    from the best of the relaxations of ``auto``, or of their pairs: above the shortest of them,
    because no sensor is known to lag less, and below twice the longest recording.
    """
    bins, tau_s = bin_axis_data(data, data.bin_cells[0]), np.zeros(1)
    if count:
        tried = [np.array(some) for some in combinations(POOL_S[1:], count)]
        start_s = min(tried, key=lambda some_s: _behind(bins, features, some_s)[0])
        found = scipy.optimize.minimize(
            lambda logs: np.log(_behind(bins, features, np.exp(logs))[0]), np.log(start_s),
            method='Nelder-Mead', bounds=[np.log((POOL_S[1], 2 * data.longest_s))] * count,
            options={'xatol': 1e-5, 'fatol': 1e-9})  # fmt: skip
        tau_s = np.exp(np.sort(found.x))
    # What runs is fitted cell by cell.
    _, gains, columns = _behind(bin_axis_data(data, 1), features, tau_s)
    return build_axis_model(features, tau_s, gains, columns, data.period_s), ()


def _behind(
    data: BinnedData, features: Features, time_constants_s: FloatArray
) -> tuple[float, FloatArray, list[FloatArray]]:
    """
    Fit r - w by features behind relaxations (eq. 11), each segment around its mean.

    Gives the squares that are left, gains, (p,), and the features by relaxation, (n_i, K·F).
    """
    columns: list[FloatArray] = [
        features.expand_within(relaxed_c).reshape(len(relaxed_c), -1)
        for relaxed_c in data.relaxed(time_constants_s)
    ]
    sums = sum_by_fold(data, columns)
    normal = sums.centred(sums.fold >= -1)
    size = 1 / np.sqrt(np.where(np.diagonal(normal) > 0, np.diagonal(normal), np.inf))
    scaled = normal * np.outer(size, size)
    gains = np.linalg.lstsq(scaled[:-1, :-1], scaled[:-1, -1], rcond=ROUNDING)[0]
    rest = normal[-1, -1] * (1 - gains @ scaled[:-1, -1])
    gains = np.divide(gains * size[:-1], size[-1], out=np.zeros_like(gains), where=size[-1] > 0)
    return max(float(rest), 1e-300), gains, columns


def compete(data: AxisData, refits: Mapping[str, Refit], *, may_be_none: bool = False) -> AxisFit:
    """
    Let the simplest good candidate run, fix its constants, and state held-out errors.

    Candidates stand in order, the simplest first; no compensation is scored beside them. What is
    too long for the recordings does not compete; TooShortError is raised where nothing is left.
    """
    bins, refits = {}, {'none': lambda _: (None, ()), **refits}
    for name, refit in refits.items():
        try:
            bins[name] = refit_bins(data, refit)
        except TooShortError as error:  # noqa: PERF203 -- each may be refused
            too_short = error
    competing = [name for name in bins if may_be_none or name != 'none']
    if not competing:
        raise too_short
    scores = [part_errors(bins[name]) for name in competing]
    chosen = competing[simplest_good(scores)]
    model, notes = refits[chosen](data)
    if data.no_sensitivity:
        notes = (*notes, f'zero drift only: {data.no_sensitivity}')
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
    factor, unit = day_over_blocks(data, after['none']), axis_unit(data.axis)
    rms = {name: left_of_a_day(left, after['none'], factor) for name, left in after.items()}
    reason = f'{chosen} leaves {rms[chosen]:.3g} {unit} RMS on held-out data'
    if chosen != 'none':
        reason += f', no compensation {rms["none"]:.3g} {unit}'
    best = competing[int(np.argmin([score.mean() for score in scores]))]
    if len(competing) == 1:
        reason += '; nothing else competed.'
    elif best == chosen:
        reason += f'; of {len(competing)} candidates it is the best.'
    else:
        reason += (
            f'; of {len(competing)} candidates {best} is better, but by less than chance or '
            f'{100 * WORTHWHILE:.0f} % in mean square, and it is less simple.'
        )
    errors = [
        (none.recording, none.fold, none.cells, none.errors, compensated.errors)
        for none, compensated in zip(bins['none'], bins[chosen], strict=True)
    ]
    held_out = hold_out(errors, data.bin_cells[0] * data.period_s, tared=data.tared)
    return AxisFit(
        model=model, chosen=chosen,
        candidates=tuple(Candidate(name, value) for name, value in rms.items()),
        rms_before=rms['none'], rms_after=rms[chosen], reason=reason,
        time_constants_s=tuple(time_constants_s),
        time_constant_errors_s=(float('nan'),) * len(time_constants_s), notes=notes,
        unit=unit, held_out=held_out)  # fmt: skip


def anchor(data: AxisData, model: AxisModel) -> AxisModel:
    """Fix the constants: no zero drift when soaked at T_ref, and the gain error there, if any."""
    without_gain_error = model.anchored([0.0] * model.outputs)
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
    gain_error = above / below if below > ROUNDING * whole else 0.0
    return model.anchored([0.0, gain_error])
