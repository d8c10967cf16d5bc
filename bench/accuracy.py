"""
Residual drift on recordings that the fit never saw, against what is usual today.

``python bench/accuracy.py [SEEDS]``, 6 by default. Per scenario and method: median and worst
residual over the seeds, in % of the uncompensated drift, both tared on the first minute and
averaged over 10 s.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
from sklearn.cross_decomposition import PLSRegression
from sklearn.linear_model import Ridge

from wrist_ft_comp import WristFtCompError
from wrist_ft_comp.core import simulated_run, thermal_sensor
from wrist_ft_comp.core.arx import free_run, relaxation
from wrist_ft_comp.core.calibration import CalibrationSettings, calibrate
from wrist_ft_comp.core.evaluation import simulate_drift
from wrist_ft_comp.core.identification import IdentificationSettings
from wrist_ft_comp.core.recording import AXES, NANOSECONDS, FloatArray, Recording

Z = AXES.index('force_z')
#: Predicts the drift that loads w meet: zero drift plus sensitivity drift times w, shape (N,).
Predictor = Callable[[Recording], FloatArray]
Method = Callable[[Sequence[Recording]], Predictor]
Scenario = Callable[[int], tuple[list[Recording], Recording]]

BANK_S = (0.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)
STRENGTHS = 10.0 ** np.arange(-7.0, 0.5, 0.5)


def recording(temperature_c: FloatArray, raw: FloatArray, true: FloatArray) -> Recording:
    """Make a recording of force z with cells of 1 s."""
    wrench, reference = (np.full((len(raw), len(AXES)), np.nan) for _ in range(2))
    wrench[:, Z], reference[:, Z] = raw, true
    measured = np.ones(temperature_c.shape, dtype=bool)
    return Recording('simulated', NANOSECONDS, 0, temperature_c, measured, wrench, reference)


def lag(values: FloatArray, tau_s: float) -> FloatArray:
    """Pass a series through a first-order lag."""
    return free_run(relaxation(tau_s, 1.0), values)


def two_lags(seed: int, hours: float) -> Recording:
    """Two hidden lags of 300 s and 1500 s, quadratic zero drift, 0.04 %/K gain drift, loads."""
    rng = np.random.default_rng(seed)
    cells = int(hours * 3600)
    drive = np.repeat(rng.uniform(0, 30, cells // 900 + 1), 900)[:cells]
    temperature = 22 + lag(drive, 600.0)
    fast, slow = lag(temperature - 22, 300.0), lag(temperature - 22, 1500.0)
    zero = 2.0 * fast - 1.2 * slow + 0.01 * slow**2
    true = np.repeat(rng.normal(0, 20, cells // 5 + 1), 5)[:cells]
    raw = (1 - 0.0004 * slow) * true + zero + rng.normal(0, 0.1, cells)
    return recording((temperature + rng.normal(0, 0.02, cells))[:, np.newaxis], raw, true)


def wrist(seed: int, run: int, thermometers: int, *, loaded: bool) -> Recording:
    """Warm the heat-conducting wrist up for 2.5 h, with duty cycles that change every 20 min."""
    rng = np.random.default_rng([seed, run])
    sensor = thermal_sensor.build_sensor(thermal_sensor.ThermalSensorSettings(), seed)
    starts = np.arange(0.0, 9000.0, 1200.0)
    levels = rng.uniform(0, 1, len(starts)) * (rng.random(len(starts)) > 0.35)
    settings = simulated_run.RunSettings(
        duty_start_s=tuple(starts),
        duty_level=tuple(levels),
        force_n=20.0 if loaded else 0.0,
        torque_nm=1.0 if loaded else 0.0,
    )
    drawn = simulated_run.draw_run(settings, rng)
    elapsed_s: FloatArray = np.arange(9000, dtype=float) + 0.5
    true = simulated_run.true_wrench(drawn, elapsed_s)
    drive = simulated_run.drive(drawn, elapsed_s)
    start = thermal_sensor.start(sensor, float(drive[0, 1]))
    result = thermal_sensor.simulate(sensor, start, drive, true, (rng, rng))
    return recording(result.temperature_c[:, :thermometers], result.wrench[:, Z], true[:, Z])


def still(seed: int, run: int, noise_n: float) -> Recording:
    """Record a sensor without drift in a room that warms up: noise only."""
    rng = np.random.default_rng([seed, run])
    temperature = 22 + lag(np.repeat(rng.uniform(0, 20, 10), 720), 600.0)
    raw = rng.normal(0, noise_n, len(temperature))
    return recording(temperature[:, np.newaxis], raw, np.zeros_like(raw))


def tare_only(_: Sequence[Recording]) -> Predictor:
    """Predict no drift: re-zeroing at the start is all that is done."""
    return lambda each: np.zeros(len(each))


def polynomial(degree: int, recordings: Sequence[Recording]) -> Predictor:
    """Fit powers of the first thermometer's temperature, as the drone autopilots do."""
    return regression(
        recordings,
        lambda each: (each.temperature_c[:, :1] - 25.0) ** np.arange(1, degree + 1),
        Ridge(1e-9),
    )


def lagged_pls(recordings: Sequence[Recording]) -> Predictor:
    """Fit scikit-learn's PLS on 20 temperatures of the last 40 minutes of every thermometer."""

    def lagged(each: Recording) -> FloatArray:
        steps = np.arange(20) * 120
        rows = np.maximum(np.arange(len(each))[:, np.newaxis] - steps, 0)
        return np.concatenate([column[rows] for column in each.temperature_c.T], axis=1)

    return regression(recordings, lagged, PLSRegression(n_components=6))


def banked(each: Recording) -> FloatArray:
    """Pass every temperature and its square through a bank of relaxations."""
    theta = each.temperature_c - 25.0
    inputs = np.concatenate((theta, theta**2), axis=1)
    return np.concatenate([free_run(relaxation(tau, 1.0), inputs) for tau in BANK_S], axis=1)


def ridge_bank(recordings: Sequence[Recording]) -> Predictor:
    """Fit ridge on the bank, its strength by leaving a recording (or a third of it) out."""
    parts = list(recordings) if len(recordings) > 1 else thirds(recordings[0])
    errors = []
    for strength in STRENGTHS:
        left = 0.0
        for out in range(len(parts)):
            others = [part for i, part in enumerate(parts) if i != out]
            predict = regression(others, banked, Ridge(strength), scale=True)
            error = drift(parts[out]) - predict(parts[out])
            left += float(np.nanvar(error))
        errors.append(left)
    strength = float(STRENGTHS[int(np.argmin(errors))])
    return regression(recordings, banked, Ridge(strength), scale=True)


def thirds(each: Recording) -> list[Recording]:
    """Cut a recording into three."""
    edges = np.linspace(0, len(each), 4).astype(int)
    return [
        replace(
            each,
            first_cell=int(a),
            temperature_c=each.temperature_c[a:b],
            measured=each.measured[a:b],
            wrench=each.wrench[a:b],
            reference=each.reference[a:b],
        )
        for a, b in pairwise(edges)
    ]


def drift(each: Recording) -> FloatArray:
    """Raw minus true wrench of force z, shape (N,)."""
    return each.wrench[:, Z] - each.reference[:, Z]


def regression(
    recordings: Sequence[Recording],
    inputs: Callable[[Recording], FloatArray],
    estimator: Ridge | PLSRegression,
    *,
    scale: bool = False,
) -> Predictor:
    """Fit an estimator to the zero drift, every recording centred by itself."""
    x = [inputs(each) for each in recordings]
    y = [drift(each) for each in recordings]
    rows = [np.isfinite(values) for values in y]
    stacked = np.concatenate([a[r] - a[r].mean(axis=0) for a, r in zip(x, rows, strict=True)])
    target = np.concatenate([b[r] - b[r].mean() for b, r in zip(y, rows, strict=True)])
    weight = 1.0 / (np.std(stacked, axis=0) * np.sqrt(len(stacked))) if scale else 1.0
    estimator.fit(stacked * weight, target)
    return lambda each: np.asarray(estimator.predict(inputs(each) * weight)).ravel()


def ours(method: str, recordings: Sequence[Recording]) -> Predictor:
    """Calibrate with one of the package's methods; a refusal leaves the sensor as it is."""
    settings = CalibrationSettings(
        reference='recorded',
        identification=IdentificationSettings(method=method),  # type: ignore[arg-type] # a name
    )
    try:
        model = calibrate(recordings, settings).model
    except WristFtCompError:
        return tare_only(recordings)

    def predict(each: Recording) -> FloatArray:
        simulated = simulate_drift(model, each)
        return np.asarray(
            simulated.zero[:, Z] + simulated.sensitivity[:, Z] * each.reference[:, Z]
        )

    return predict


def residual(each: Recording, predicted: FloatArray) -> float:
    """Root mean square of what is left, tared on the first minute, in bins of 10 s."""
    left = drift(each) - predicted
    left = left - left[:60].mean()
    bins = left[: len(left) // 10 * 10].reshape(-1, 10).mean(axis=1)
    return float(np.sqrt(np.mean(bins**2)))


METHODS: dict[str, Method] = {
    'straight line': partial(polynomial, 1),
    'cubic': partial(polynomial, 3),
    'PLS on lags': lagged_pls,
    'ridge bank': ridge_bank,
    'arx_pls': partial(ours, 'arx_pls'),
    'auto': partial(ours, 'auto'),
}


def wrists(thermometers: int, loaded: bool, seed: int) -> tuple[list[Recording], Recording]:
    """Four recordings to learn from, a fifth to judge."""
    runs = [wrist(seed, run, thermometers, loaded=loaded) for run in range(5)]
    return runs[:4], runs[4]


SCENARIOS: dict[str, Scenario] = {
    'two lags': lambda seed: (
        [two_lags(100 * seed + 1, 2.0), two_lags(100 * seed + 2, 2.0)],
        two_lags(100 * seed + 3, 3.0),
    ),
    'wrist, 1 thermometer': partial(wrists, 1, False),
    'wrist, 1, loaded': partial(wrists, 1, True),
    'wrist, 2 thermometers': partial(wrists, 2, False),
    'wrist, 2, loaded': partial(wrists, 2, True),
    'noise only': lambda seed: ([still(seed, run, 0.1) for run in range(3)], still(seed, 3, 0.1)),
    'no drift': lambda seed: ([still(seed, run, 1e-3) for run in range(3)], still(seed, 3, 1e-3)),
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('seeds', nargs='?', type=int, default=6)
    seeds = range(parser.parse_args().seeds)
    print(f'residual drift, % of uncompensated: median (worst) of {len(seeds)} seeds')
    print(f'{"":22}' + ''.join(f'{name:>18}' for name in METHODS))
    for title, scenario in SCENARIOS.items():
        shares: dict[str, list[float]] = {name: [] for name in METHODS}
        for seed in seeds:
            training, test = scenario(seed)
            before = residual(test, np.zeros(len(test)))
            for name, method in METHODS.items():
                shares[name].append(100 * residual(test, method(training)(test)) / before)
        cells = (f'{np.median(s):.1f} ({max(s):.1f})' for s in shares.values())
        print(f'{title:22}' + ''.join(f'{cell:>18}' for cell in cells), flush=True)


if __name__ == '__main__':
    main()
