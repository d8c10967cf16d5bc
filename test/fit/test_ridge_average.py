"""Method ``auto``: what it finds, what it leaves alone, and that it says what it does."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.fit.result import HeldOut, rms_by_fold
from wrist_ft_comp.fit.ridge_average import COMBINATION, identify_auto, weigh
from wrist_ft_comp.fit.settings import IdentificationSettings

CELLS = 300
LINE = IdentificationSettings(degree=1)


@pytest.fixture(scope='module')
def pose(make_axis_data, warm_up, lagged):
    """Pose an axis: drift in N/K behind a lag of 300 s, in recordings that all axes share."""

    def make(gain, *, days=2, noise=0.01, load_n=0.0, seed=0):
        rng = np.random.default_rng([seed, 3])
        temperatures = [warm_up(CELLS, i) for i in range(days)]
        loads = [load_n * rng.standard_normal(CELLS) for _ in temperatures]
        raws = []
        for i, (temperature_c, load) in enumerate(zip(temperatures, loads, strict=True)):
            drift = gain * (lagged(temperature_c, 300.0) - 30)
            raw = drift + (1.02 + 2e-3 * drift) * load + 50.0 * i
            raws.append(raw + noise * rng.standard_normal(CELLS))
        return make_axis_data(temperatures, raws, loads if load_n else None)

    return make


def run(model, temperature_c):
    return model.run(model.start(temperature_c[0]), temperature_c)[1]


class TestWhatIsFound:
    def test_an_axis_that_never_changes_has_a_drift_of_0(self, pose):
        still = pose(0.0, noise=0.0)
        still = replace(still, residual=tuple(r + 0.1 for r in still.residual))  # no sum is exact
        single = identify_auto(still, LINE)
        assert (single.chosen, single.rms_before, single.rms_after) == ('none', 0.0, 0.0)

    def test_a_day_that_drifts_much_decides_what_another_day_is_expected_to_keep(self, pose):
        """Two calm days, and a hot one that keeps what no thermometer sees."""
        made = pose(0.5, days=3)
        unseen = 2.0 * np.sin(np.arange(CELLS) / 15)
        calm = [0.2 * residual for residual in made.residual[:2]]
        unequal = replace(made, residual=(*calm, made.residual[2] + unseen))
        single = identify_auto(unequal, IdentificationSettings())
        kept = rms_by_fold(single.held_out).after
        assert kept[2] > 1.2
        assert 0.7 * kept[2] < single.expected_rms < 1.1 * kept[2]
        assert single.expected_rms > 1.1 * single.rms_after

    def test_a_single_lag_is_found_and_the_heaviest_fits_are_named(self, pose):
        single = identify_auto(pose(0.5, days=3), IdentificationSettings())
        assert single.chosen == COMBINATION
        assert single.rms_after < 1.3 * 0.01
        assert single.rms_before > 100 * single.rms_after
        weights = {fit.name: fit.weight for fit in single.candidates}
        assert sum(weights.values()) == pytest.approx(1.0)
        heaviest = max(weights, key=weights.get)
        share = 100 * weights[heaviest] / (1 - weights['none'])
        assert f'The largest shares: {heaviest} ({share:.0f} %)' in single.reason

    def test_of_noise_next_to_nothing_is_learnt(self, pose):
        """And mostly nothing: one day in many seems to be foretold by chance."""
        fits = []
        for seed, days in enumerate((1, 2, 1, 2)):
            problem = pose(0.0, days=days, noise=1.0, seed=seed)
            fits.append(identify_auto(problem, IdentificationSettings()))
        none = [fit for fit in fits if fit.model is None]
        assert len(none) >= 3
        for fit in none:
            assert (fit.chosen, fit.candidates[0].weight) == ('none', 1)
            assert fit.reason.startswith('No fit was better than none on data')
        assert all(0.95 < fit.rms_after / fit.rms_before <= 1 for fit in fits)


def test_the_model_is_anchored_at_rest(pose):
    """No drift at rest at T_ref but the gain error of the loaded axis."""
    loaded = identify_auto(pose(0.5, load_n=20.0), LINE)
    plain = identify_auto(pose(-1.0, seed=1), LINE)
    for fit in (loaded, plain):
        at_rest = run(fit.model, fit.model.reference_c[np.newaxis])[0]
        assert at_rest[0] == pytest.approx(0.0, abs=1e-12)
    gain_error = run(loaded.model, loaded.model.reference_c[np.newaxis])[0, 1]
    drift_at_rest = 2e-3 * 0.5 * (loaded.model.reference_c[0] - 30)
    assert gain_error == pytest.approx(0.02 + drift_at_rest, abs=3e-3)


class TestWeights:
    @staticmethod
    def weigh(*left):
        """Weigh fits that leave some RMS of every fold, where no compensation leaves 1."""
        errors = np.tile([1.0, *left], (40, 1)) * np.where(np.arange(40) % 2, 1, -1)[:, np.newaxis]
        fold = np.repeat([0, 1, 2], 40)
        held = HeldOut(0 * fold, fold, 1.0 * fold, np.tile(errors, (3, 1)), 10.0, tared=True)
        return weigh(held, [np.array([1.0, *left]) ** 2] * 3)

    def test_a_weight_falls_with_the_eighth_power_of_what_is_left(self):
        none, *weights = self.weigh(0.5, 0.25)
        assert none == 0
        assert weights[1] / weights[0] == pytest.approx(2.0**8)
        assert sum(weights) == pytest.approx(1.0)

    @pytest.mark.parametrize(('left', 'runs'), [(1.1, False), (0.99, False), (0.97, True)])
    def test_what_hardly_gains_is_not_run(self, left, runs):
        np.testing.assert_array_equal(self.weigh(left), [1 - runs, runs])
