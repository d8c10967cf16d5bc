"""
The methods that a person may name, and hats: candidates compete, and the simplest good one runs.

Candidates are scored on folds that they did not see, in free run, on means over bins.

Source: "Design of Temperature Compensation Module of the Industrial Robot Wrist Force Sensor Based
on Multivariate Regression Method", Sensors & Transducers, 2014; docs/paper.md goes through it
equation by equation. ``pcr`` and ``pls`` are static (eq. 3 to 10), ``filtered_pls`` has a filter
for each latent (eq. 11 to 14, all in ``pls``), ``arx_pls`` an ARX for each latent (eq. 15 to 22).
``arx_pls_oe`` has free time constants that minimise the error of the free run (eq. 16). Last come
the paper's performance indices of a sensor over temperature: K_s (eq. 23) and A (eq. 24).
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
import scipy  # which loads its parts when they are used

from wrist_ft_comp.drift.arx_pls import static_gain
from wrist_ft_comp.drift.drift_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.errors import SettingsError, TooShortError
from wrist_ft_comp.fit import auto_method as ridges
from wrist_ft_comp.fit.arx_pls import choose_orders, fit_arx_pls
from wrist_ft_comp.fit.axis_data import AxisData, build_features
from wrist_ft_comp.fit.day_limit import state_fit
from wrist_ft_comp.fit.folds import fold_means, hold_out, simplest_good
from wrist_ft_comp.fit.pls import build_xy_block, fit_filtered_pls, fit_pcr, stack
from wrist_ft_comp.fit.result import AxisFit
from wrist_ft_comp.fit.settings import IdentificationSettings, STATIC
from wrist_ft_comp.series import FloatArray, ROUNDING

#: A model, None for "no compensation", and what had to be mended, in sentences.
Fitted = tuple[AxisModel | None, tuple[str, ...]]
#: Fits an axis, of which a fold may be held out.
Refit = Callable[[AxisData], Fitted]
#: What each latent is: its orders, or the time constant of its filter, s.
Structure = tuple[Any, ...]


def identify_paper_method(data: AxisData, settings: IdentificationSettings) -> AxisFit:
    """
    Let held-out folds choose how many latents there are, and their structure.

    Each latent of arx_pls has orders of its own; all of filtered_pls have one relaxation.
    TooShortError is raised where no ARX finds enough consecutive samples. Hats of ``auto`` and the
    time constants of arx_pls_oe have rules of their own.
    """
    if settings.method == 'auto':
        return identify_hats(data, settings)
    if settings.method == 'arx_pls_oe':
        return identify_lags(data, settings)
    features = build_features(data.temperature_c, settings, data.residual)
    method, orders = settings.method, settings.orders
    # Hats take all latents, so that every knot keeps its own coefficients.
    fixed = features.width if features.kind == 'hats' else 0
    fixed = len(orders) if len(orders) > 1 else fixed
    most = fixed or features.width
    structures: dict[str, Structure] = {'': (0.0,)}
    if method == 'filtered_pls':
        bank_s = ridges.shown_by(data.longest_s, ridges.LONG_BANK_S)
        structures = {f', relaxation {tau_s} s': (tau_s,) for tau_s in bank_s}
    elif method == 'arx_pls':
        block = None if orders else build_xy_block(data, features)
        orders = orders if block is None else choose_orders(data, block, most)
        structures = {'': orders or (STATIC,)}
        most = max(fixed, len(orders)) if len(orders) > 1 else most
    refits = dict[str, Refit]()
    for r in range(fixed or 1, most + 1):
        for of_structure, structure in structures.items():
            name = f'{method}, {r} latent{"s" if r > 1 else ""}{of_structure}'
            of_latents = structure[:r] if len(structure) > 1 else structure * r
            refits[name] = partial(fit_structure, settings, of_latents)
    return compete(data, refits)


def fit_structure(settings: IdentificationSettings, latents: Structure, data: AxisData) -> Fitted:
    """
    Fit one of the paper's methods with these latents.

    The model is None where nothing was observed or the inputs explain nothing. Sentences beside it
    say what each latent is. TooShortError is raised where an ARX does not find enough consecutive
    samples.
    """
    features = build_features(data.temperature_c, settings, data.residual)
    block = build_xy_block(data, features)
    if block is None:
        return None, ()
    notes: tuple[str, ...] = ()
    if settings.method == 'arx_pls':
        dynamics, notes = fit_arx_pls(block, latents)
    elif settings.method == 'pcr':
        outer = fit_pcr(block.x, block.y, len(latents))
        # u_r = b_r t_r (eq. 10)
        dynamics = block.model(outer, [static_gain(gain) for gain in outer.inner])
    else:
        dynamics, notes = fit_filtered_pls(block, latents, data.period_s)
    return None if dynamics is None else AxisModel(features, dynamics), notes


def identify_hats(data: AxisData, settings: IdentificationSettings) -> AxisFit:
    """
    Let held-out folds choose between none and piecewise linear zero drift.

    This is what ``auto`` does at the plateaus of a chamber test. Gain drift is left alone: between
    a few temperatures it is easily worse than none. ``pls`` in hats learns it.
    """
    hats = replace(settings, method='pls', features='hats')
    width = build_features(data.temperature_c, hats, data.residual).width

    def fit_zero(part: AxisData) -> Fitted:
        model, notes = fit_structure(hats, (0.0,) * width, part)
        if model is None:
            return None, notes
        names = 'output_loadings', 'output_weight', 'output_mean'
        of_zero = {name: getattr(model.dynamics, name)[:1] for name in names}
        return replace(model, dynamics=replace(model.dynamics, **of_zero)), notes

    return compete(data, {'zero drift in hats': fit_zero}, may_be_none=True)


def identify_lags(data: AxisData, settings: IdentificationSettings) -> AxisFit:
    """
    Let none, one or two free time constants compete on the error of the free run.

    A time constant above half of the longest recording is refused: there it looks like a trend.
    """
    features = build_features(data.temperature_c, settings, data.residual)
    refits: dict[str, Refit] = {}
    for count, lags in enumerate(('static', '1 time constant', '2 time constants')):
        for degree in range(1, features.degree + 1):
            name = 'hats' if features.kind == 'hats' else f'degree {degree}'
            refits[f'{lags}, {name}'] = partial(fit_lags, replace(features, degree=degree), count)
    fit = compete(data, refits)
    if fit.model is None or not fit.model.filters:
        return fit
    tau_s = _time_constants_s(fit.model, data.period_s)
    if tau_s[-1] > data.longest_s / 2:
        refusal = (
            f'{data.axis} drifts too slowly for these recordings: {fit.chosen} explains it best, '
            f'but its slowest time constant, {tau_s[-1]:.0f} s, is more than half of the longest '
            f'recording. Record at least {2 * tau_s[-1] / 3600:.1f} h from cold, or choose the '
            'method pls'
        )
        none = compete(data, {}, may_be_none=True)
        return replace(none, candidates=fit.candidates, refusal=refusal)
    # The jackknife: how far the fits scatter that were made without each fold in turn.
    others = [refits[fit.chosen](data.without(fold))[0] for _, fold in data.folds_by_recording]
    others_s = [_time_constants_s(model, data.period_s) for model in others if model]
    errors_s = np.sqrt((len(others_s) - 1) * np.var(others_s, axis=0))
    return replace(
        fit, time_constants_s=tuple(tau_s.tolist()),
        time_constant_errors_s=tuple(errors_s.tolist()))  # fmt: skip


def _time_constants_s(model: AxisModel, period_s: float) -> FloatArray:
    return -period_s / np.log([-lag.a[0] for lag in model.filters])


def fit_lags(features: Features, count: int, data: AxisData) -> Fitted:
    """
    Fit drift behind free time constants; poles are relaxations, since heat conducts by no others.

    For given time constants every gain is linear, so ln τ alone is searched (variable projection),
    from the best of the relaxations of ``auto``, or of their pairs: above the shortest of them,
    because no sensor is known to lag less, and below twice the longest recording.
    """
    bins, tau_s = ridges.bin_axis_data(data, data.bin_cells), np.zeros(1)
    if count:
        tried = [np.array(some) for some in combinations(ridges.POOL_S[1:], count)]
        start_s = min(tried, key=lambda some_s: _behind(bins, features, some_s)[0])
        found = scipy.optimize.minimize(
            lambda logs: np.log(_behind(bins, features, np.exp(logs))[0]), np.log(start_s),
            method='Nelder-Mead', bounds=[np.log((ridges.POOL_S[1], 2 * data.longest_s))] * count,
            options={'xatol': 1e-5, 'fatol': 1e-9})  # fmt: skip
        tau_s = np.exp(np.sort(found.x))
    # What runs is fitted cell by cell.
    _, gains = _behind(ridges.bin_axis_data(data, 1), features, tau_s)
    return ridges.build_axis_model(features, tau_s, gains, data.period_s), ()


def _behind(
    data: ridges.BinnedData, features: Features, time_constants_s: FloatArray
) -> tuple[float, FloatArray]:
    """
    Fit r - w by features behind relaxations (eq. 11), each segment around its mean.

    Gives the squares that are left, and gains of all columns but r - w, (P - 1,).
    """
    relaxed_c = data.relaxed(time_constants_s)
    sums = ridges.sum_by_fold(data, [features.expand(c).reshape(len(c), -1) for c in relaxed_c])
    products = sums.centred(sums.fold >= -1)
    size = 1 / np.sqrt(np.where(np.diagonal(products) > 0, np.diagonal(products), np.inf))
    scaled = products * np.outer(size, size)
    gains = np.linalg.lstsq(scaled[:-1, :-1], scaled[:-1, -1], rcond=ROUNDING)[0]
    rest = products[-1, -1] * (1 - gains @ scaled[:-1, -1])
    gains = np.divide(gains * size[:-1], size[-1], out=np.zeros_like(gains), where=size[-1] > 0)
    return max(float(rest), 1e-300), gains


def compete(data: AxisData, refits: Mapping[str, Refit], *, may_be_none: bool = False) -> AxisFit:
    """
    Let the simplest good candidate run, fix its constants, and state held-out errors.

    Candidates stand in order, the simplest first; no compensation is scored beside them. What is
    too long for the recordings does not compete; TooShortError is raised where nothing is left.
    """
    refits = {'none': lambda _: (None, ()), **refits}
    columns = {}
    for name, refit in refits.items():
        try:
            means = [
                fold_means(data, i, fold, unexplained(data, refit(data.without(fold))[0], i))
                for i, fold in data.folds_by_recording
            ]
            columns[name] = np.concatenate([errors for _, errors in means])
        except TooShortError as error:  # noqa: PERF203 -- each may be refused
            too_short = error
    first = 0 if may_be_none else 1
    names = list(columns)
    if not names[first:]:
        raise too_short
    cells = [cells for cells, _ in means]  # of every candidate the same
    left = hold_out(data, cells, np.column_stack([*columns.values()]))
    winner = first + simplest_good(left.squares().mean(axis=0)[first:].tolist())
    chosen = names[winner]
    model, notes = refits[chosen](data)
    if model is not None:
        model = anchor(data, model)
    return state_fit(data, model, chosen, left, names, np.eye(len(names))[winner], notes)


def unexplained(data: AxisData, model: AxisModel | None, recording: int) -> FloatArray:
    """Subtract a model's free run from r - w of a recording, (N_i,), up to a constant."""
    residual, temperature_c = data.residual[recording], data.temperature_c[recording]
    if model is None:
        return residual
    _, drift = model.run(model.start(temperature_c[0]), temperature_c)
    explained = drift[:, 0]
    if data.load is not None and drift.shape[1] > 1:
        explained = explained + drift[:, 1] * data.load[recording]
    return np.asarray(residual - explained)


def anchor(data: AxisData, model: AxisModel) -> AxisModel:
    """Fix the constants: no zero drift when soaked at T_ref, and the gain error there, if any."""
    model = model.anchored([0.0] * model.outputs)
    if data.load is None or model.outputs == 1:
        return model
    left = [unexplained(data, model, i) for i in range(len(data.load))]
    both = [np.stack(pair, axis=1) for pair in zip(data.load, left, strict=True)]
    w, error = stack(both, both).T
    # A load that is constant within each recording leaves the gain error at T_ref open.
    is_open = w @ w <= ROUNDING * sum(np.nansum(load**2) for load in data.load)
    return model.anchored([0.0, 0.0 if is_open else float(w @ error / (w @ w))])


def thermal_sensitivity_drift(
    temperature_c: FloatArray, zero_output: FloatArray, full_scale_output: FloatArray,
    reference_c: float,
) -> FloatArray:  # fmt: skip
    """
    Compute the coefficient of thermal sensitivity drift K_s (eq. 23), % of full scale per °C.

        K_s(T_i) = (Y_f(T_i) - Y_0(T_i) - Y_f(T) + Y_0(T)) / ((T_i - T)(Y_f(T) - Y_0(T))) · 100

    Takes T_i, °C, and the output there without load, Y_0, and under full load, Y_f, in any unit,
    all of shape (P,), and T, one of the temperatures. Gives K_s, shape (P,), NaN at T itself.
    SettingsError when T is none of the temperatures, or load does not change the output there.
    """
    at_reference = np.flatnonzero(temperature_c == reference_c)
    spans = full_scale_output - zero_output
    if len(at_reference) != 1 or spans[at_reference[0]] == 0:
        raise SettingsError(
            f'The reference temperature of K_s must be one of {temperature_c.tolist()} °C, where '
            f'zero and full load read differently; got {reference_c:g} °C.'
        )
    span = spans[at_reference[0]]
    distance = np.where(temperature_c == reference_c, np.nan, temperature_c - reference_c)
    return np.asarray(100 * (spans - span) / (distance * span))


def accuracy(output: FloatArray, expected: FloatArray, full_scale: float) -> float:
    """
    Compute the accuracy A: the largest absolute error, in % of full scale (eq. 24).

    Takes what was measured, in any unit, NaN where nothing was, what should have been, of a shape
    that broadcasts with it, and the output of full load over that without; SettingsError at 0.
    """
    if full_scale == 0:
        raise SettingsError('The full scale of A must not be 0.')
    return float(100 * np.nanmax(np.abs(output - expected)) / abs(full_scale))
