"""What is usual today, and other ways to learn drift: from recordings to a predictor."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise

import numpy as np
from scenarios import drift, part
from sklearn.cross_decomposition import PLSRegression
from sklearn.linear_model import Ridge

from wrist_ft_comp.drift.arx import free_run, relaxation
from wrist_ft_comp.signals import FloatArray, Recording

#: Predicts the drift that loads w meet: zero drift plus sensitivity drift times w, shape (N,).
Predictor = Callable[[Recording], FloatArray]
Method = Callable[[Sequence[Recording]], Predictor]

BANK_S = (0.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)
STRENGTHS = 10.0 ** np.arange(-7.0, 0.5, 0.5)


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
        steps = np.arange(20) * round(120 / each.period_s)
        rows = np.maximum(np.arange(len(each))[:, np.newaxis] - steps, 0)
        return np.concatenate([column[rows] for column in each.temperature_c.T], axis=1)

    return regression(recordings, lagged, PLSRegression(n_components=6))


def banked(each: Recording) -> FloatArray:
    """Pass every temperature and its square through a bank of relaxations."""
    theta = each.temperature_c - 25.0
    inputs = np.concatenate((theta, theta**2), axis=1)
    return np.concatenate(
        [free_run(relaxation(tau, each.period_s), inputs) for tau in BANK_S], axis=1
    )


def ridge_bank(recordings: Sequence[Recording]) -> Predictor:
    """Fit ridge on the bank, its strength by leaving a recording (or a third of it) out."""
    parts = list(recordings) if len(recordings) > 1 else thirds(recordings[0])
    errors = []
    for strength in STRENGTHS:
        total = 0.0
        for out in range(len(parts)):
            others = [part for i, part in enumerate(parts) if i != out]
            predict = regression(others, banked, Ridge(strength), scale=True)
            error = drift(parts[out]) - predict(parts[out])
            total += float(np.nanvar(error))
        errors.append(total)
    strength = float(STRENGTHS[int(np.argmin(errors))])
    return regression(recordings, banked, Ridge(strength), scale=True)


def thirds(each: Recording) -> list[Recording]:
    """Cut a recording into three."""
    edges = np.linspace(0, len(each), 4).astype(int)
    return [part(each, int(first), int(last)) for first, last in pairwise(edges)]


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


PEERS: dict[str, Method] = {
    'tare only': tare_only,
    'straight line': partial(polynomial, 1),
    'cubic': partial(polynomial, 3),
    'PLS on lags': lagged_pls,
    'ridge bank': ridge_bank,
}
