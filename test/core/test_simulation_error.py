"""Fits on the free-run error: moments, ridge, held-out blocks and time constants."""

from collections.abc import Callable
from itertools import combinations

import numpy as np
import pytest
from scipy import optimize

from wrist_ft_comp.core import simulation_error as oe
from wrist_ft_comp.core.features import Features
from wrist_ft_comp.core.moments import Moments, accumulate, bank_inputs
from wrist_ft_comp.core.problem import (
    AxisProblem,
    cross_validation_blocks,
    pose_problem,
)
from wrist_ft_comp.core.recording import Recording

Array = np.ndarray
FEATURES = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0), degree=2)
GRID = np.array([0.0, 50.0, 150.0, 400.0, 1200.0])
CELLS = 150


@pytest.fixture(scope='module', params=[False, True], ids=['unloaded', 'loaded'])
def problem(
    request: pytest.FixtureRequest,
    make_recording: Callable[..., Recording],
    warm_up: Callable[..., Array],
) -> AxisProblem:
    """Three recordings with gaps, offsets and much noise, so that no fit is perfect."""
    rng = np.random.default_rng(0)
    recordings = []
    for i in range(3):
        temperature_c = warm_up(CELLS + 20 * i, i)
        load = 30 * rng.standard_normal(len(temperature_c))
        raw = 0.4 * temperature_c + 2 * rng.standard_normal(len(temperature_c)) + 100 * i
        raw += (1 + 1e-3 * temperature_c) * load * request.param
        raw[rng.uniform(size=len(raw)) < 0.1] = np.nan
        recordings.append(make_recording(temperature_c, {'force_z': raw}, {'force_z': load}))
    blocks = cross_validation_blocks(recordings)
    reference = 'recorded' if request.param else 'unloaded'
    made = pose_problem(recordings, 'force_z', reference, blocks)
    assert (made.load is not None) == request.param
    return made


def textbook_bank(problem: AxisProblem, taus: Array, lagged: Callable[..., Array]) -> list[Array]:
    """Every feature through every relaxation, by the loop."""
    banked = []
    for temperature_c in problem.temperature_c:
        theta = temperature_c[:, 0] - 30.0
        columns = []
        for tau in taus:
            for feature in (theta, theta**2):
                columns.append(lagged(feature, tau) if tau else feature)  # noqa: PERF401
        banked.append(np.stack(columns, axis=1))
    return banked


def textbook_system(
    problem: AxisProblem, banked: list[Array], blocks: set[int]
) -> tuple[Array, Array, int]:
    """Stacked design with one column of ones per recording, the measurements, and the width."""
    rows, targets = [], []
    for i, columns in enumerate(banked):
        for k, value in enumerate(problem.residual[i]):
            if np.isnan(value) or problem.blocks[i][k] not in blocks:
                continue
            row = list(columns[k])
            if problem.load is not None:
                w = problem.load[i][k]
                row += [w * c for c in columns[k]] + [w]
            rows.append(row + [float(i == j) for j in range(len(banked))])
            targets.append(value)
    return np.array(rows), np.array(targets), len(rows[0]) - len(banked)


def textbook_ridge(x: Array, y: Array, width: int, strength: float) -> Array:
    """Ridge whose penalty is relative to each column's variance, constants free."""
    used = x[:, width:][:, x[:, width:].any(axis=0)]  # constants of the recordings that are there
    project = np.eye(len(x)) - used @ np.linalg.pinv(used)
    columns, target = project @ x[:, :width], project @ y
    penalty = np.sqrt(strength) * np.diag(np.linalg.norm(columns, axis=0))
    stacked = np.concatenate((columns, penalty))
    return np.linalg.lstsq(stacked, np.concatenate((target, np.zeros(width))), rcond=None)[0]


def moments_of(problem: AxisProblem, taus: Array = GRID) -> Moments:
    return accumulate(problem, bank_inputs(problem, FEATURES, taus), taus)


def test_the_bank_is_the_textbook_loop(problem: AxisProblem, lagged: Callable[..., Array]) -> None:
    for found, expected in zip(
        bank_inputs(problem, FEATURES, GRID), textbook_bank(problem, GRID, lagged), strict=True
    ):
        np.testing.assert_allclose(found, expected, atol=1e-10)


def test_gains_are_least_squares_on_the_stacked_design(
    problem: AxisProblem, lagged: Callable[..., Array]
) -> None:
    taus = np.array([0.0, 150.0])
    gains, left = oe.fit_gains(problem, FEATURES, taus, 0.0)
    x, y, width = textbook_system(problem, textbook_bank(problem, taus, lagged), {0, 1, 2})
    theta, (rest,), _, _ = np.linalg.lstsq(x, y, rcond=None)
    outputs = 1 if problem.load is None else 2
    assert gains.shape == (2, 2, outputs)
    expected = theta[: 4 * outputs].reshape(outputs, 2, 2)
    for output in range(outputs):
        np.testing.assert_allclose(gains[:, :, output], expected[output], rtol=1e-6, atol=1e-9)
    assert left == pytest.approx(rest, rel=1e-8)
    assert width == (4 if outputs == 1 else 9)


@pytest.mark.parametrize('strength', [1e-6, 1e-2, 1.0])
def test_ridge_is_the_augmented_least_squares(
    problem: AxisProblem, lagged: Callable[..., Array], strength: float
) -> None:
    moments = moments_of(problem)
    products, count = moments.centred(np.ones(3, dtype=bool))
    columns = moments.columns([1, 3], 2)
    theta, left = oe.solve_ridge(products, columns, strength)
    banked = textbook_bank(problem, GRID[[1, 3]], lagged)
    x, y, width = textbook_system(problem, banked, {0, 1, 2})
    expected = textbook_ridge(x, y, width, strength)
    assert count == len(y)
    np.testing.assert_allclose(theta, expected, rtol=1e-6, atol=1e-10)
    ones = x[:, width:]
    rest = y - x[:, :width] @ expected
    rest = rest - ones @ np.linalg.lstsq(ones, rest, rcond=None)[0]
    assert float(left) == pytest.approx(rest @ rest, rel=1e-8)


def test_ridge_is_scikit_learns_on_standardised_columns() -> None:
    linear = pytest.importorskip('sklearn.linear_model', reason='scikit-learn is not installed')
    rng = np.random.default_rng(1)
    x = rng.standard_normal((80, 5)) * [1, 1e3, 1e-3, 5, 0.2]
    y = x @ rng.standard_normal(5) + rng.standard_normal(80)
    both = np.column_stack((x, y)) - np.column_stack((x, y)).mean(axis=0)
    theta, _ = oe.solve_ridge(both.T @ both, np.arange(5), 0.03)
    deviation = x.std(axis=0)
    peer = linear.Ridge(alpha=0.03 * len(x)).fit(x / deviation, y)
    np.testing.assert_allclose(theta, peer.coef_ / deviation, rtol=1e-8)


def test_many_systems_are_solved_as_one_by_one(problem: AxisProblem) -> None:
    moments = moments_of(problem)
    products, _ = moments.centred(np.ones(3, dtype=bool))
    choices = np.stack([moments.columns(pair, 1) for pair in combinations(range(1, 5), 2)])
    together, left = oe.solve_ridge(products, choices, 1e-3)
    for columns, theta, rest in zip(choices, together, left, strict=True):
        alone, alone_left = oe.solve_ridge(products, columns, 1e-3)
        np.testing.assert_allclose(theta, alone, rtol=1e-8)
        assert rest == pytest.approx(float(alone_left))


@pytest.mark.parametrize(
    ('structure', 'strength'),
    [
        (oe.Structure('static', 2), 0.0),
        (oe.Structure('static, degree 1', 1), 0.0),
        (oe.Structure('bank', 2, bank_s=(50.0, 400.0)), 0.1),
        (oe.Structure('one', 1, free_time_constants=1), 0.0),
        (oe.Structure('two', 1, free_time_constants=2), 0.0),
    ],
    ids=lambda value: getattr(value, 'name', None),
)
def test_held_out_errors_are_those_of_refitting_without_each_block(
    problem: AxisProblem, lagged: Callable[..., Array], structure: oe.Structure, strength: float
) -> None:
    found = oe.held_out_errors(*[moments_of(problem)] * 2, structure, structure.degree, strength)
    expected = []
    for block in range(3):
        if structure.bank_s:
            choices = [structure.bank_s]
        elif structure.free_time_constants:
            choices = list(combinations(GRID[1:], structure.free_time_constants))
        else:
            choices = [(0.0,)]
        fits = []
        for taus in choices:
            banked = textbook_bank(problem, np.array(taus), lagged)
            keep = [2 * k + f for k in range(len(taus)) for f in range(structure.degree)]
            banked = [columns[:, keep] for columns in banked]
            x, y, width = textbook_system(problem, banked, {0, 1, 2} - {block})
            theta = textbook_ridge(x, y, width, strength or 1e-9)
            rest = y - x[:, :width] @ theta
            rest -= x[:, width:] @ np.linalg.lstsq(x[:, width:], rest, rcond=None)[0]
            fits.append((rest @ rest, banked, theta))
        _, banked, theta = min(fits, key=lambda fit: fit[0])
        x, y, width = textbook_system(problem, banked, {block})
        error = y - x[:, :width] @ theta
        expected.append(np.mean((error - error.mean()) ** 2))
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_columns_are_numbered_by_relaxation_then_feature(problem: AxisProblem) -> None:
    moments = moments_of(problem)
    zero = [1 * 2, 3 * 2]
    expected = zero if problem.load is None else [*zero, 10 + 2, 10 + 6, 20]
    np.testing.assert_array_equal(moments.columns([1, 3], 1), expected)


class TestConstantColumns:
    def test_one_that_only_differs_between_recordings_gets_no_gain(
        self, make_recording: Callable[..., Recording], warm_up: Callable[..., Array]
    ) -> None:
        """A room thermometer that read 21.3, 24.7 and 22.9 °C explains nothing within a run."""
        recordings = []
        for i, room in enumerate((21.3, 24.7, 22.9)):
            temperature_c = np.stack([warm_up(CELLS, i), np.full(CELLS, room)], axis=1)
            raw = 0.5 * temperature_c[:, 0] + 7.0 * i
            recordings.append(make_recording(temperature_c, {'force_z': raw}))
        problem = pose_problem(
            recordings, 'force_z', 'unloaded', cross_validation_blocks(recordings)
        )
        features = Features('powers', np.full(2, 23.0), np.zeros(2), np.full(2, 99.0))
        gains, _ = oe.fit_gains(problem, features, np.array([0.0, 300.0]), 1e-9)
        np.testing.assert_array_equal(gains[:, 1], 0.0)
        np.testing.assert_allclose(gains[:, 0].sum(), 0.5, rtol=1e-4)


@pytest.fixture(scope='module')
def temperatures(warm_up: Callable[..., Array]) -> list[Array]:
    return [warm_up(360, 10 + i) for i in range(2)]


class TestTimeConstants:
    def pose(
        self,
        make_recording: Callable[..., Recording],
        temperatures: list[Array],
        drifts: list[Array],
    ) -> AxisProblem:
        recordings = [
            make_recording(temperature_c, {'force_z': drift_n + 50.0 * i})
            for i, (temperature_c, drift_n) in enumerate(zip(temperatures, drifts, strict=True))
        ]
        blocks = cross_validation_blocks(recordings)
        return pose_problem(recordings, 'force_z', 'unloaded', blocks)

    @pytest.mark.parametrize(
        ('true', 'start'), [((300.0,), (150.0,)), ((200.0, 1300.0), (120.0, 900.0))]
    )
    def test_noise_free_ones_are_found(
        self,
        make_recording: Callable[..., Recording],
        lagged: Callable[..., Array],
        temperatures: list[Array],
        true: tuple[float, ...],
        start: tuple[float, ...],
    ) -> None:
        drifts = [
            sum(g * lagged(t - 30, tau) for g, tau in zip((0.5, -0.8), true, strict=False))
            for t in temperatures
        ]
        features = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0))
        problem = self.pose(make_recording, temperatures, drifts)
        found = oe.refine_time_constants(problem, features, start)
        np.testing.assert_allclose(found, true, rtol=5e-3)
        gains, left = oe.fit_gains(problem, features, found, 1e-12)
        np.testing.assert_allclose(gains[:, 0, 0], [0.5, -0.8][: len(true)], rtol=2e-2)
        assert left < 1e-4 * sum(np.sum((d - d.mean()) ** 2) for d in drifts)

    def test_a_noisy_one_is_found_within_four_standard_errors(
        self,
        make_recording: Callable[..., Recording],
        lagged: Callable[..., Array],
        temperatures: list[Array],
    ) -> None:
        sigma, true = 0.2, 400.0
        rng = np.random.default_rng(3)
        clean = [0.5 * lagged(t - 30, true) for t in temperatures]
        drifts = [drift_n + sigma * rng.standard_normal(len(drift_n)) for drift_n in clean]
        features = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0))
        problem = self.pose(make_recording, temperatures, drifts)
        (found,) = oe.refine_time_constants(problem, features, (200.0,))

        def run(parameters: Array) -> Array:
            gain, log_tau, *constants = parameters
            return np.concatenate(
                [
                    gain * lagged(t - 30, np.exp(log_tau)) + constant
                    for t, constant in zip(temperatures, constants, strict=True)
                ]
            )

        at = np.array([0.5, np.log(true), 0.0, 0.0])
        jacobian = optimize.approx_fprime(at, run, 1e-6)
        covariance = sigma**2 * np.linalg.inv(jacobian.T @ jacobian)
        standard_error = np.sqrt(covariance[1, 1])
        assert standard_error < 0.1
        assert abs(np.log(found / true)) < 4 * standard_error

    @pytest.mark.parametrize('true', [1e6, 1e9])
    def test_one_beyond_the_recording_does_not_run_away(
        self,
        make_recording: Callable[..., Recording],
        lagged: Callable[..., Array],
        temperatures: list[Array],
        true: float,
    ) -> None:
        """All that is seen is an integral; a time constant of years would fit it and explode."""
        drifts = [true / 1000 * lagged(t - 30, true) for t in temperatures]
        features = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0))
        problem = self.pose(make_recording, temperatures, drifts)
        (found,) = oe.refine_time_constants(problem, features, (1500.0,))
        assert found <= 360 * 10.0 * 1.001
