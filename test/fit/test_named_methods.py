"""The paper's methods on an axis: truths that are found, and data that are degenerate."""

import numpy as np
import pytest

from wrist_ft_comp.fit.named_methods import fit_structure
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


@pytest.fixture(scope='module')
def pose(make_axis_data):
    """Build a problem from drifts; every recording gets an offset of its own."""

    def make(temperatures, drifts, loads=None):
        raws = [drift + 100.0 * i for i, drift in enumerate(drifts)]
        return make_axis_data(temperatures, raws, loads)

    return make


def fit(method, data, degree=2, latents=slice(None)):
    settings = IdentificationSettings(method, degree=degree)
    return fit_structure(settings, STRUCTURE[method][latents], data)[0]


def free_run(model, temperature_c):
    return model.run(model.start(temperature_c[0]), temperature_c)[1]


@every_method
@pytest.mark.parametrize('loaded', [False, True])
def test_units_change_nothing(pose, temperatures, lagged, method, loaded):
    """In mN instead of N the zero drift is a thousandfold and the sensitivity drift the same."""
    rng = np.random.default_rng(0)
    loads = [30 * rng.standard_normal(CELLS) for _ in temperatures]
    drifts = [
        0.5 * lagged(t[:, 0], 300.0)
        + (1 + 1e-3 * t[:, 1]) * load * loaded
        + 0.01 * rng.standard_normal(CELLS)
        for t, load in zip(temperatures, loads, strict=True)
    ]
    runs = []
    for unit in (1.0, 1000.0):
        problem = pose(
            temperatures,
            [unit * drift for drift in drifts],
            [unit * load for load in loads] if loaded else None,
        )
        assert (problem.load is not None) == loaded
        runs.append(free_run(fit(method, problem), temperatures[0]))
    newton, millinewton = runs
    assert newton.shape == (CELLS, 1 + loaded)
    assert np.ptp(newton[:, 0]) > 1
    millinewton[:, 0] /= 1000
    np.testing.assert_allclose(millinewton, newton, rtol=1e-5, atol=1e-6)


@every_method
class TestDegenerateData:
    def test_a_constant_thermometer_does_not_matter(self, pose, temperatures, lagged, method):
        one = [t[:, :1] for t in temperatures]
        both = [np.column_stack((t, np.full(CELLS, 25.0))) for t in one]
        drifts = [0.5 * lagged(t[:, 0], 300.0) for t in one]
        alone, beside = (
            free_run(fit(method, pose(columns, drifts), 1, slice(-1, None)), columns[0])
            for columns in (one, both)
        )
        np.testing.assert_allclose(beside, alone, atol=1e-6)

    @pytest.mark.parametrize('value', [3.0, np.nan])
    def test_no_drift_or_nothing_observed_gets_no_model(self, pose, temperatures, method, value):
        drifts = [np.full(CELLS, value) for _ in temperatures]
        assert fit(method, pose(temperatures, drifts)) is None
