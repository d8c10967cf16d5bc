"""Methods ``auto`` and ``arx_pls_oe``: relaxations in competition, the simplest good one runs."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrist_ft_comp.calibration.candidates import build_candidate_data, CandidateData, structures
from wrist_ft_comp.calibration.cross_validation import (
    cross_validate,
    CvScore,
    hold_out,
    part_errors,
    simplest_good,
    uncompensated_bins,
)
from wrist_ft_comp.calibration.features import build_features
from wrist_ft_comp.calibration.result import AxisFit, OUTPUTS, Term
from wrist_ft_comp.calibration.selection import finish, Fitted
from wrist_ft_comp.calibration.settings import IdentificationSettings
from wrist_ft_comp.identification.axis_data import AxisData
from wrist_ft_comp.identification.bins import bin_axis_data
from wrist_ft_comp.identification.output_error import fit_columns, Structure
from wrist_ft_comp.identification.standard_errors import by_relaxation, fit_gains, GainFit
from wrist_ft_comp.identification.time_constants import search_time_constants
from wrist_ft_comp.model.arx import relaxation, static_gain
from wrist_ft_comp.model.arx_pls import from_gains
from wrist_ft_comp.model.axis_model import AxisModel
from wrist_ft_comp.model.features import Features
from wrist_ft_comp.model.signals import FloatArray

#: Drift that ranges this many times wider where no wrench was recorded has run away.
_RUNAWAY = 3.0
#: A time constant within this share of its bound is not determined by the recordings.
_AT_BOUND = 0.01
#: A substitute for a candidate that is too slow may leave this many times its mean square error.
_SUBSTITUTE = 2.0
#: … or this share of what no compensation leaves: a tenth of the drift.
_SMALL = 0.01
#: A time constant whose standard error is this many times its value says nothing.
_UNDETERMINED = 1.0
_TREND_SET_ASIDE = 'a slow trend that temperature does not explain was set aside'


def identify_relaxations(data: AxisData, settings: IdentificationSettings) -> AxisFit:
    """
    Let none, static, free and banked relaxations compete, fitted on the simulation error.

    ``auto`` tries all of them, ``arx_pls_oe`` free time constants only. A drift slower than the
    recordings are long is refused when nothing simpler explains it.
    """
    features = build_features(data.temperature_c, settings)
    candidate_data = choose_trend(build_candidate_data(data, features))
    grid = candidate_data.fitted_moments.time_constants_s
    scores = {
        structure.name: cross_validate(candidate_data, structure)
        for structure in structures(settings, features, grid)
    }
    bins = {'none': uncompensated_bins(candidate_data)}
    bins |= {name: score.bins for name, score in scores.items()}
    errors = {name: part_errors(each) for name, each in bins.items()}
    competing = list(errors) if settings.method == 'auto' else list(scores)
    fit = _choose(candidate_data, scores, errors, competing)
    detrended = any(sums.time.any() for sums in candidate_data.judged.sums)
    held_out = hold_out(data, bins['none'], bins[fit.chosen], detrended=detrended)
    return replace(fit, held_out=held_out)


def choose_trend(data: CandidateData) -> CandidateData:
    """
    Set a slow trend, such as creep under load, aside where that helps on held-out data.

    That is in a long recording whose temperatures go up and down. In others it is mistaken for
    thermal drift as easily as the other way round.
    """
    plain = data.without_trend()
    if not data.trend:
        return plain
    bank = Structure('any', 1, 0, tuple(data.fitted_moments.time_constants_s.tolist()), 'ridge')
    errors = [part_errors(cross_validate(each, bank).bins) for each in (plain, data)]
    return (plain, data)[simplest_good(errors)]


def _choose(
    data: CandidateData,
    scores: Mapping[str, CvScore],
    errors: Mapping[str, FloatArray],
    competing: Sequence[str],
) -> AxisFit:
    """Find the simplest good candidate that may run, and fit it to everything."""
    axis_data = data.axis_data
    notes: tuple[str, ...] = (_TREND_SET_ASIDE,) if data.trend else ()
    doubts: tuple[str, ...] = ()
    while True:
        chosen = competing[simplest_good([errors[name] for name in competing])]
        if chosen == 'none':
            nothing = Fitted(None, notes=notes, doubts=doubts)
            return finish(axis_data, nothing, chosen, errors, competing)
        fitted = replace(_fit(data, scores[chosen]), notes=notes, doubts=doubts)
        slow = _why_too_slow(axis_data, fitted)
        why_not = slow or _why_unsafe(axis_data, fitted)
        if not why_not or (len(competing) == 1 and not slow):
            return finish(axis_data, fitted, chosen, errors, competing)
        left_out = f'{chosen} was left out: {why_not}'
        if not slow:
            competing = [name for name in competing if name != chosen]
            notes = (*notes, left_out)
            continue
        # Richer candidates would only hide behind many gains that the drift goes on.
        substitutes = _good_substitutes(competing, chosen, errors)
        if not substitutes and simplest_good([errors['none'], errors[chosen]]) == 0:
            # What a person named finds no drift, so there is none that could be too slow.
            nothing = Fitted(None, notes=(*notes, left_out), doubts=doubts)
            return finish(axis_data, nothing, 'none', errors, ['none', chosen])
        if not substitutes:
            return _refuse(axis_data, chosen, slow, errors)
        competing = substitutes
        doubts = (*doubts, left_out)


def _fit(data: CandidateData, score: CvScore) -> Fitted:
    """Fit a candidate to all samples, its time constants refined on them."""
    axis_data, moments, structure = data.axis_data, data.fitted_moments, score.structure
    features, inputs = data.features_of(structure), data.inputs(structure)
    if structure.bank_s:
        _, coefficients = fit_columns(moments, structure, moments.everything, inputs)
        bank: FloatArray = np.array(structure.bank_s)
        gains = by_relaxation(
            coefficients[score.strength], len(bank), inputs, loaded=moments.loaded
        )
        return Fitted(_to_model(axis_data, features, bank, gains))
    cells = bin_axis_data(axis_data, 1)
    if not data.trend:
        cells = cells.without_trend()
    tau_s: FloatArray = np.zeros(1)
    if score.time_constants_s is not None:
        tau_s = search_time_constants(cells, features, score.time_constants_s)
    return _determined(axis_data, features, fit_gains(cells, features, tau_s))


def _determined(data: AxisData, features: Features, fit: GainFit) -> Fitted:
    """Turn a fit with standard errors into a candidate."""
    free = fit.time_constants_s > 0
    return Fitted(
        model=_to_model(data, features, fit.time_constants_s, fit.gains),
        time_constants_s=tuple(fit.time_constants_s[free].tolist()),
        time_constant_errors_s=tuple(fit.time_constant_errors_s[free].tolist()),
        terms=tuple(
            Term(
                output,
                float(tau),
                feature,
                float(fit.gains[k, f, m]),
                float(fit.gain_errors[k, f, m]),
            )
            for m, output in zip(range(fit.gains.shape[2]), OUTPUTS, strict=False)
            for k, tau in enumerate(fit.time_constants_s)
            for f, feature in enumerate(features.names)
        ),
    )


def _why_too_slow(data: AxisData, fitted: Fitted) -> str:
    """Say that the recordings are too short for a time constant, or nothing when they are not."""
    if max(fitted.time_constants_s, default=0.0) < (1 - _AT_BOUND) * data.longest_s:
        return ''
    return (
        f'its slowest time constant is at least {data.longest_s:.0f} s, as long as the longest '
        'recording'
    )


def _good_substitutes(
    competing: Sequence[str], chosen: str, errors: Mapping[str, FloatArray]
) -> list[str]:
    """List the simpler candidates, when one of them does nearly as well."""
    simpler = list(competing[: competing.index(chosen)])
    enough = max(_SUBSTITUTE * float(errors[chosen].mean()), _SMALL * float(errors['none'].mean()))
    return simpler if any(float(errors[name].mean()) <= enough for name in simpler) else []


def _refuse(data: AxisData, chosen: str, why: str, errors: Mapping[str, FloatArray]) -> AxisFit:
    """Leave an axis without model whose drift is slower than the recordings can show."""
    refusal = (
        f'{data.axis} drifts too slowly for these recordings: {chosen} explains it best, but '
        f'{why}. Record at least {2 * data.longest_s / 3600:.1f} h from cold, or choose the '
        'method pls'
    )
    fit = finish(data, Fitted(None), 'none', errors, ['none'])
    return replace(fit, reason=f'{refusal}.', refusal=refusal)


def _why_unsafe(data: AxisData, fitted: Fitted) -> str:
    """Say why a fit must not run although it scored well, or nothing when it may."""
    pairs = list(zip(fitted.time_constants_s, fitted.time_constant_errors_s, strict=True))
    if any(error > _UNDETERMINED * tau for tau, error in pairs):
        stated = ', '.join(f'{tau:.0f} ± {error:.0f} s' for tau, error in pairs)
        return f'the recordings do not determine its time constants ({stated})'
    model = fitted.model
    if model is None:
        return ''
    for temperature_c, residual in zip(data.temperature_c, data.residual, strict=True):
        drift = model.run(model.start(temperature_c[0]), temperature_c)[1]
        seen = np.isfinite(residual)
        if seen.any() and (np.ptp(drift, axis=0) > _RUNAWAY * np.ptp(drift[seen], axis=0)).any():
            return 'its drift runs away where no wrench was recorded'
    return ''


def _to_model(
    data: AxisData, features: Features, time_constants_s: FloatArray, gains: FloatArray
) -> AxisModel | None:
    """
    Write fitted gains, shape (K, F, M), in the form that runs.

    Relaxations become filters, K·J filtered temperatures one set of features; None without gains.
    """
    count = len(time_constants_s)
    joined = replace(
        features,
        reference_c=np.tile(features.reference_c, count),
        lower_c=np.tile(features.lower_c, count),
        upper_c=np.tile(features.upper_c, count),
        knots_c=features.knots_c * count,
    )
    if features.kind == 'powers':
        # by relaxation, power, thermometer -> by power, relaxation, thermometer
        shape = (count, features.degree, features.thermometers, gains.shape[2])
        gains = np.moveaxis(gains.reshape(shape), 1, 0)
    flat = gains.reshape(-1, gains.shape[-1])
    inputs = np.concatenate(
        [joined.expand(np.tile(temperature_c, count)) for temperature_c in data.temperature_c]
    )
    deviation = inputs.std(axis=0)
    dynamics = from_gains(
        [static_gain()],
        flat[np.newaxis],
        inputs.mean(axis=0),
        1.0 / np.where(deviation > 0, deviation, 1.0),
        np.ones(flat.shape[1]),
    )
    if dynamics is None:
        return None
    bank = tuple(relaxation(float(tau), data.period_s) for tau in time_constants_s)
    return AxisModel(joined, dynamics, bank if time_constants_s.any() else ())
