"""Method ``arx_pls_oe``: relaxations with free time constants; the simplest good one runs."""

from collections.abc import Mapping
from dataclasses import replace

from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.fit.bins import bin_axis_data
from wrist_ft_comp.fit.cross_validation import (
    build_candidate_data,
    CandidateData,
    cross_validate,
    part_errors,
    refit_bins,
    Scores,
    simplest_good,
)
from wrist_ft_comp.fit.feature_banks import build_features
from wrist_ft_comp.fit.gains import build_axis_model
from wrist_ft_comp.fit.moments import bank_inputs
from wrist_ft_comp.fit.regression import Structure
from wrist_ft_comp.fit.result import AxisFit, OUTPUTS, Term
from wrist_ft_comp.fit.selection import finish, Fitted
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.fit.standard_errors import fit_gains
from wrist_ft_comp.fit.time_constants import search_time_constants
from wrist_ft_comp.signals import FloatArray

#: A time constant within this share of its bound is not determined by the recordings.
_AT_BOUND = 0.01


def identify_free_relaxations(data: AxisData, settings: IdentificationSettings) -> AxisFit:
    """Let free time constants compete on the simulation error (eq. 16); refuse slow drift."""
    features = build_features(data.temperature_c, settings)
    candidate_data = build_candidate_data(data, features)
    bins, found = {'none': refit_bins(data, lambda _: (None, ()))}, {}
    for structure in _structures(settings, features):
        bins[structure.name], tau_s = cross_validate(candidate_data, structure)
        found[structure.name] = structure, tau_s
    return _choose(candidate_data, found, bins)


def _structures(settings: IdentificationSettings, features: Features) -> list[Structure]:
    """List the candidates, simplest first."""
    hats = features.kind == 'hats'
    degrees = [1] if hats else list(range(1, settings.highest_degree + 1))
    return [
        Structure(
            f'{count} time constant{"s" * (count > 1)}, {"hats" if hats else f"degree {degree}"}',
            degree,
            count,
        )
        for count in (1, 2, 3)
        for degree in degrees
        if count < 3 or degree == 1
    ]


def _choose(
    data: CandidateData, found: Mapping[str, tuple[Structure, FloatArray]], bins: Scores
) -> AxisFit:
    """Fit the simplest good candidate to everything."""
    competing = list(found)
    errors = {name: part_errors(each) for name, each in bins.items()}
    chosen = competing[simplest_good([errors[name] for name in competing])]
    fitted, longest_s = _fit(data, *found[chosen]), data.axis_data.longest_s
    if max(fitted.time_constants_s, default=0.0) < (1 - _AT_BOUND) * longest_s:
        return finish(data.axis_data, fitted, chosen, bins, competing)
    slow = (
        f'its slowest time constant is at least {longest_s:.0f} s, as long as the longest '
        'recording'
    )
    if simplest_good([errors['none'], errors[chosen]]) == 0:
        # What a person named finds no drift, so there is none that could be too slow.
        nothing = Fitted(None, notes=(f'{chosen} was left out: {slow}',))
        return finish(data.axis_data, nothing, 'none', bins, ['none', chosen])
    return _refuse(data.axis_data, chosen, slow, bins)


def _fit(data: CandidateData, structure: Structure, start_s: FloatArray) -> Fitted:
    """Fit a candidate to all samples, its time constants refined on them, with standard errors."""
    axis_data, features = data.axis_data, data.features_of(structure)
    cells = bin_axis_data(axis_data, 1)
    tau_s = search_time_constants(cells, features, start_s)
    fit = fit_gains(cells, features, tau_s)
    inputs = bank_inputs(cells, features, tau_s)
    model = build_axis_model(features, tau_s, fit.gains, inputs, axis_data.period_s)
    times_s, errors_s = fit.time_constants_s.tolist(), fit.time_constant_errors_s.tolist()
    gains, gain_errors = fit.gains.tolist(), fit.gain_errors.tolist()
    terms = tuple(
        Term(output, tau, feature, gains[k][f][m], gain_errors[k][f][m])
        for m, output in zip(range(fit.gains.shape[2]), OUTPUTS, strict=False)
        for k, tau in enumerate(times_s)
        for f, feature in enumerate(features.names)
    )
    return Fitted(model, tuple(times_s), tuple(errors_s), terms)


def _refuse(data: AxisData, chosen: str, why: str, bins: Scores) -> AxisFit:
    """Leave an axis without model whose drift is slower than the recordings can show."""
    refusal = (
        f'{data.axis} drifts too slowly for these recordings: {chosen} explains it best, but '
        f'{why}. Record at least {2 * data.longest_s / 3600:.1f} h from cold, or choose the '
        'method pls'
    )
    fit = finish(data, Fitted(None), 'none', bins, ['none'])
    return replace(fit, reason=f'{refusal}.', refusal=refusal)
