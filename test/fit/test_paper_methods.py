"""The named methods on an axis: truths that are found, degenerate data, free time constants."""

import numpy as np
import pytest

from wrist_ft_comp.fit.paper_methods import fit_structure, identify_paper_method
from wrist_ft_comp.fit.settings import IdentificationSettings, Orders

#: A structure of one latent and of three, by method.
LAG = Orders(1, 1, 0, direct=True)
STRUCTURE = {
    'pcr': [0.0] * 3, 'pls': [0.0] * 3, 'filtered_pls': [0.0, 300.0, 1000.0],
    'arx_pls': [LAG] * 3,
}  # fmt: skip
every_method = pytest.mark.parametrize('method', STRUCTURE)
CELLS = 400


@pytest.fixture(scope='module')
def temperatures(warm_up):
    return [np.stack([warm_up(CELLS, i), warm_up(CELLS, 50 + i)], axis=1) for i in range(3)]


def fit(method, data, degree=2, latents=slice(None)):
    settings = IdentificationSettings(method, degree=degree)
    return fit_structure(settings, STRUCTURE[method][latents], data)[0]


def free_run(model, temperature_c):
    return model.run(model.start(temperature_c[0]), temperature_c)[1]


@every_method
@pytest.mark.parametrize('loaded', [False, True])
def test_units_change_nothing(make_axis_data, temperatures, lagged, method, loaded):
    rng = np.random.default_rng(0)
    loads = [30 * rng.standard_normal(CELLS) for _ in temperatures]
    drifts = [
        0.5 * lagged(t[:, 0], 300.0)
        + 100.0 * i
        + (1 + 1e-3 * t[:, 1]) * load * loaded
        + 0.01 * rng.standard_normal(CELLS)
        for i, (t, load) in enumerate(zip(temperatures, loads, strict=True))
    ]
    runs = []
    for unit in (1.0, 1000.0):
        known = [unit * load for load in loads] if loaded else None
        problem = make_axis_data(temperatures, [unit * drift for drift in drifts], known)
        assert (problem.load is not None) == loaded
        runs.append(free_run(fit(method, problem), temperatures[0]))
    newton, millinewton = runs
    assert newton.shape == (CELLS, 1 + loaded)
    assert np.ptp(newton[:, 0]) > 1
    millinewton[:, 0] /= 1000
    np.testing.assert_allclose(millinewton, newton, rtol=1e-5, atol=1e-6)


@every_method
def test_a_constant_thermometer_does_not_matter(make_axis_data, temperatures, lagged, method):
    one = [t[:, :1] for t in temperatures]
    both = [np.column_stack((t, np.full(CELLS, 25.0))) for t in one]
    drifts = [0.5 * lagged(t[:, 0], 300.0) + 100.0 * i for i, t in enumerate(one)]
    alone, beside = (
        free_run(fit(method, make_axis_data(columns, drifts), 1, slice(-1, None)), columns[0])
        for columns in (one, both)
    )
    np.testing.assert_allclose(beside, alone, atol=1e-6)


@every_method
@pytest.mark.parametrize('value', [3.0, np.nan])
def test_no_drift_or_nothing_observed_gets_no_model(make_axis_data, temperatures, method, value):
    drifts = [np.full(CELLS, value + 100.0 * i) for i, _ in enumerate(temperatures)]
    assert fit(method, make_axis_data(temperatures, drifts)) is None


@pytest.fixture
def pose_lags(simulate, axis_data):
    """Drift of N/K behind each time constant, with a square and noise."""

    def make(truth, *, noise=0.05, days=2):
        known = {'cells': 300, 'noise': noise, 'square': 0.02}
        return axis_data([simulate(40 + i, truth, **known) for i in range(days)])

    return make


@pytest.mark.parametrize(('given', 'words'), [
    ((Orders(2, 2, 1), LAG), ('n 2, m 2, d 1', 'n 1, m 1, d 0, direct')),
    ((Orders(1, 2, 0),), ('n 1, m 2, d 0', 'n 1, m 2, d 0')),
])  # fmt: skip
def test_orders_are_given_once_for_all_latents_or_once_per_latent(pose_lags, given, words):
    settings = IdentificationSettings('arx_pls', orders=given)
    fit = identify_paper_method(pose_lags({300.0: 0.5}), settings)
    assert len(given) == 1 or fit.chosen.startswith('arx_pls, 2 latents')
    for r, (note, orders) in enumerate(zip(fit.notes, words, strict=False), 1):
        assert note.startswith(f'latent {r}: {orders}; J_{r} = ')


@pytest.mark.parametrize(('truth', 'chosen'), [
    ({300.0: 0.5}, '1 time constant'), ({120.0: 0.5, 1200.0: -0.5}, '2 time constant'),
    ({1e-3: 0.5}, 'static, degree '),
], ids=str)  # fmt: skip
def test_time_constants_are_found_within_their_standard_errors(pose_lags, truth, chosen):
    fit = identify_paper_method(pose_lags(truth, days=3), IdentificationSettings('arx_pls_oe'))
    assert fit.chosen.startswith(chosen)
    assert fit.rms_after < 0.07
    lags_s = [tau_s for tau_s in truth if tau_s > 1]
    for true, tau_s, error_s in zip(
        lags_s, fit.time_constants_s, fit.time_constant_errors_s, strict=True
    ):
        assert abs(tau_s - true) < 3 * error_s < 0.2 * true


def test_a_drift_that_lasts_longer_than_the_recordings_is_refused_with_numbers(pose_lags):
    problem = pose_lags({1e5: 20.0}, noise=0.01)
    fit = identify_paper_method(problem, IdentificationSettings('arx_pls_oe'))
    assert (fit.model, fit.chosen) == (None, 'none')
    assert 'its slowest time constant, 6000 s, is more than half of the longest' in fit.refusal
    assert 'Record at least 3.3 h from cold' in fit.refusal
    assert fit.rms_after == fit.rms_before
