"""X and Y as they are observed, PLS by the textbook, and PCR."""

import numpy as np
import pytest

from wrist_ft_comp.fit.pls import fit_pcr, fit_pls, OBSERVATION_WINDOW_S, observe_drift


def made_up(samples, inputs, outputs):
    """Correlated inputs, outputs that depend on them with noise; centred and scaled."""
    rng = np.random.default_rng(1)
    x = rng.standard_normal((samples, inputs)) @ rng.standard_normal((inputs, inputs))
    y = x @ rng.standard_normal((inputs, outputs)) + rng.standard_normal((samples, outputs))
    return (x - x.mean(axis=0)) / x.std(axis=0), (y - y.mean(axis=0)) / y.std(axis=0)


def coefficients(outer):
    """C with Y ≈ X C (eq. 8)."""
    return (outer.rotations * outer.inner) @ outer.output_loadings.T


@pytest.mark.parametrize(
    ('inputs', 'outputs', 'latents'),
    [(m, k, r) for m, k in ((1, 1), (4, 1), (4, 2), (6, 3)) for r in range(1, m + 1)],
)
def test_scikit_learn_predicts_the_same(inputs, outputs, latents):
    cross = pytest.importorskip('sklearn.cross_decomposition', reason='no scikit-learn')
    from sklearn.decomposition import PCA  # noqa: PLC0415 -- only where it is installed

    x, y = made_up(60, inputs, outputs)
    peer = cross.PLSRegression(latents, scale=False, tol=1e-24, max_iter=20_000).fit(x, y)
    ours = x @ coefficients(fit_pls(x, y, latents))
    np.testing.assert_allclose(ours, peer.predict(x).reshape(ours.shape), atol=1e-9)
    pcr, scores = fit_pcr(x, y, latents), PCA(latents, svd_solver='full').fit_transform(x)
    np.testing.assert_allclose(np.abs(x @ pcr.rotations), np.abs(scores), atol=1e-9)
    expected = scores @ np.linalg.lstsq(scores, y, rcond=None)[0]
    np.testing.assert_allclose(x @ coefficients(pcr), expected, atol=1e-10)


@pytest.mark.parametrize('fit', [fit_pls, fit_pcr])
class TestDegenerateBlocks:
    def test_lost_rank_gives_fewer_latents_and_still_least_squares(self, fit):
        full, y = made_up(40, 3, 2)
        constant = np.insert(full, 2, 0.0, axis=1)
        repeated = np.column_stack([full, full[:, 0] - full[:, 1], 2 * full[:, 2]])
        for x in (constant, repeated):
            outer = fit(x, y, x.shape[1])
            assert len(outer.inner) == 3
            expected = x @ np.linalg.lstsq(x, y, rcond=None)[0]
            np.testing.assert_allclose(x @ coefficients(outer), expected, atol=1e-9)
        np.testing.assert_allclose(coefficients(fit(constant, y, 4))[2], 0, atol=1e-12)

    @pytest.mark.parametrize('silent', ['x', 'y', 'both'])
    def test_a_silent_block_leaves_nothing(self, fit, silent):
        x, y = made_up(40, 3, 2)
        outer = fit(x * (silent == 'y'), y * (silent == 'x'), 3)
        assert len(outer.inner) == 0
        assert coefficients(outer).shape == (3, 2)
        assert not coefficients(outer).any()

    def test_fewer_samples_than_inputs_are_fitted_exactly(self, fit):
        x, y = made_up(5, 8, 1)
        outer = fit(x, y, 8)
        assert len(outer.inner) <= 4
        np.testing.assert_allclose(x @ coefficients(outer), y, atol=1e-9)


CELLS = 400
LOAD = 30 * np.random.default_rng(0).standard_normal(CELLS)


@pytest.fixture
def observe(make_axis_data):
    """Observe the drift of a raw wrench beside a load, over a rise from 20 to 40 °C."""
    rise_c = np.linspace(20, 40, CELLS)
    return lambda raw, load: observe_drift(make_axis_data([rise_c], [raw], [load]))[0]


def test_windows_do_not_cross_gaps(observe):
    cells = round(OBSERVATION_WINDOW_S / 10.0)
    before, after = slice(0, cells // 2), slice(cells // 2 + 10, None)
    sensitivity, zero, gap = np.full(CELLS, 0.02), np.full(CELLS, 3.0), np.zeros(CELLS)
    sensitivity[after], zero[after] = -0.03, -5.0
    gap[before.stop : after.start] = np.nan
    observed = observe((1 + sensitivity) * LOAD + zero + gap, LOAD)
    seen = np.isfinite(observed).all(axis=1)
    assert (~seen).sum() <= 10 + 10  # the gap, and at most a last window of few cells
    np.testing.assert_allclose(observed[seen, 0], zero[seen], atol=1e-9)
    np.testing.assert_allclose(observed[seen, 1], sensitivity[seen], atol=1e-12)
    assert {0.02, -0.03} == set(np.round(observed[seen, 1], 9))


def test_windows_without_load_are_not_observed(observe):
    quiet = LOAD.copy()
    quiet[120:180] = 5.0
    observed = observe(1.1 * quiet, quiet)
    np.testing.assert_array_equal(np.isnan(observed[:, 1]), (quiet != LOAD))
