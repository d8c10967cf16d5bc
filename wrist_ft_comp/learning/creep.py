"""
Creep and hysteresis: drift that follows the load's history, and not temperature.

Under a load F that is constant a strain gauge's reading creeps by c F (1 - exp(-t/τ)), and creeps
back when the load is gone; where there is hysteresis, a share of the largest load stays. Both are
a few hundredths of a newton where heat moves newtons. They begin and end with the load, though, on
the loaded axes and in proportion to it. So the drift that the live model leaves of a day, y,
(n, A) means over about a minute, is regressed on the load's history::

    y = Z b + c h(load) + slow + noise

    h     history: the load behind a first-order lag of τ, or its largest value up to then  (n, A)
    Z     a constant between jumps, the weight, and weight x temperature       (n, k) per axis
    slow  what heat leaves: a random walk, whose size each axis tells by maximum likelihood

All axes have one c; what their random walks have in common (heat moves all axes) is taken off by
the covariance of the whitened residuals. The standard error of c is that of generalized least
squares; on 49 simulated days without creep c was off by 1.0 to 1.4 of them (RMS).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift.drift_model import Drift
from wrist_ft_comp.learning.day import Day
from wrist_ft_comp.payload.states import medians
from wrist_ft_comp.signals import BoolArray, FloatArray, IntArray

#: Time constants of creep that are tried, s; inf is what stays. Load cells of an average data
#: sheet have 1080 s: their creep after 30 min is 0.84 of that after 60 min (Bartel and Yaniv).
TIME_CONSTANTS_S = (300.0, 900.0, 2700.0, np.inf)
#: Shortest bin, s, and most bins of a day.
_BIN_S, _MOST_BINS = 60.0, 400
#: The level without contact is the median over this time, s; presses of half of it are none.
_LEVEL_S = 6000.0
#: Cells farther from that level are pressed, in standard deviations of a cell about it.
_PRESSED_SIGMA = 6.0
#: The zero has jumped where it changes from bin to bin by more than this many usual changes.
_JUMP_RATIO = 10.0
#: A day whose zero jumps in more than this share of the bins is not judged.
_MOST_JUMPS = 0.1
#: Fewest free cells of a bin, and fewest bins of a day that is judged.
_LEAST_CELLS, _LEAST_BINS = 2, 60
#: Variances of a random walk's step that are tried, in units of the noise of a bin.
_STEP_VARIANCES = 10.0 ** np.arange(-4, 3.1, 0.5)
#: A smaller column, as a share of the largest one, depends on others; noise is larger, N, N m.
_LEAST_SIZE = 1e-9
#: Share of the covariance between axes that is not believed.
_SHRINKAGE = 0.02
#: Least standard error of a share: the day of a reading that stands still outweighs no other.
_LEAST_ERROR = 1e-5


class Share(NamedTuple):
    """The share of a load that its creep tends to, or that stays, and its standard error."""

    share: float
    error: float


def shares(day: Day, simulated: Drift) -> tuple[Share, ...]:
    """
    Estimate a day's share of the load for every TIME_CONSTANTS_S; empty for too short a day.

    ``simulated`` is the live model's drift of that day, (N, 6): without a model heat hides creep.
    """
    recording, weight = day.recording, day.drift.reference
    axes = np.isfinite(weight).any(axis=0)
    length = max(round(_BIN_S / recording.period_s), -(-len(recording) // _MOST_BINS), 1)
    cells = len(recording) // length * length
    left = recording.wrench - simulated.zero - (1 + simulated.sensitivity) * weight
    left, weight = left[:cells, axes], weight[:cells, axes]
    free: BoolArray = np.asarray(np.isfinite(day.drift.wrench[:cells, axes]).all(axis=1))
    if free.sum() < _LEAST_BINS:
        return ()
    bin_s = length * recording.period_s
    level = _level(_means(left, free, length), bin_s)
    push: FloatArray = left - np.asarray(np.repeat(level, length, axis=0))
    width = np.maximum(1.48 * np.median(np.abs(push[free]), axis=0), _LEAST_SIZE)
    pressed = np.sqrt(np.mean((push / width) ** 2, axis=1)) > _PRESSED_SIGMA
    load = np.nan_to_num(weight) + np.where(pressed[:, None], np.nan_to_num(push), 0.0)
    free &= ~pressed
    count = free.reshape(-1, length).sum(axis=1)
    rows = np.flatnonzero(count >= _LEAST_CELLS)
    if len(rows) < _LEAST_BINS:
        return ()
    warm_k = recording.temperature_c[:cells] - recording.temperature_c.mean(axis=0)
    nuisances = [weight, *(weight * column[:, None] for column in warm_k.T)]
    y, *columns = (_means(values, free, length)[rows] for values in (left, *nuisances))
    history = _history(load.reshape(-1, length, load.shape[1]), bin_s)[:, rows]
    return _regressed(rows, count[rows], y, np.stack(columns), history)


def _means(values: FloatArray, counted: BoolArray, length: int) -> FloatArray:
    """Average the cells of (N, A) that are counted over bins, (M, A); NaN where a bin has none."""
    marks = (counted & np.isfinite(values).all(axis=1)).reshape(-1, length, 1)
    total = np.where(marks, values.reshape(-1, length, values.shape[1]), 0.0).sum(axis=1)
    count = marks.sum(axis=1)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def _level(means: FloatArray, bin_s: float) -> FloatArray:
    """Compute running medians of means, (M, A), that no press of half the window moves."""
    half = round(_LEVEL_S / bin_s / 2)
    padded = np.pad(means, ((half, half), (0, 0)), constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=0)
    return medians(windows.transpose(0, 2, 1))


def _history(load: FloatArray, bin_s: float) -> FloatArray:
    """Let loads of the cells of bins, (M, B, A), pass lags, and find the largest: (K, M, A)."""
    means = load.mean(axis=1)
    peaks = np.take_along_axis(load, np.abs(load).argmax(axis=1, keepdims=True), axis=1)[:, 0]
    history = np.zeros((len(TIME_CONSTANTS_S), *means.shape))
    decay = np.exp(-bin_s / np.array(TIME_CONSTANTS_S[:-1]))[:, None]
    lagged: FloatArray = np.zeros((len(decay), means.shape[1]))
    largest: FloatArray = np.zeros(means.shape[1])
    for row, (value, peak) in enumerate(zip(means, peaks, strict=True)):
        begin = lagged
        lagged = value + (lagged - value) * decay
        largest = np.where(np.abs(peak) > np.abs(largest), peak, largest)
        history[:-1, row], history[-1, row] = (begin + lagged) / 2, largest
    return history


def _regressed(
    rows: IntArray, count: IntArray, y: FloatArray, columns: FloatArray, history: FloatArray
) -> tuple[Share, ...]:
    """Regress y, (n, A), of bins ``rows`` on histories, (K, n, A), beside columns, (k, n, A)."""
    # The zero may jump by a tare, or by a press that was not found.
    change = np.abs(np.diff(y, axis=0))
    jumps = (change > _JUMP_RATIO * np.median(change, axis=0)).any(axis=1)
    if jumps.mean() > _MOST_JUMPS:
        return ()
    constants = (np.arange(len(y))[:, None] > np.flatnonzero(jumps)).astype(float)
    constants = np.column_stack((np.ones(len(y)), constants))
    walk, noise = np.minimum.outer(rows, rows).astype(float), np.diag(count.mean() / count)
    inverses = [
        np.linalg.inv(np.linalg.cholesky(variance * walk + noise)) for variance in _STEP_VARIANCES
    ]
    whitened = [
        _whitened(inverses, np.column_stack((constants, *beside)), values, loads)
        for values, beside, loads in zip(
            y.T, columns.transpose(2, 0, 1), history.transpose(2, 0, 1), strict=True
        )
    ]
    error, clean, regressor = (np.stack(part) for part in zip(*whitened, strict=True))
    covariance = clean @ clean.T / max(np.sum(clean**2, axis=1).max(), 1e-30)
    covariance += _SHRINKAGE * (np.eye(len(clean)) - covariance)
    weighted = np.einsum('ab,bkn->akn', np.linalg.inv(covariance), regressor)
    power = np.maximum(np.einsum('akn,akn->k', weighted, regressor), 1e-30)
    share = np.einsum('akn,an->k', weighted, error) / power
    return tuple(map(Share, share.tolist(), np.maximum(power**-0.5, _LEAST_ERROR).tolist()))


def _whitened(
    inverses: Sequence[FloatArray], columns: FloatArray, y: FloatArray, history: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """
    Whiten one axis: y, (n,), y without creep, and history, (K, n).

    The likeliest of the covariances whitens, given by the ``inverses`` of their roots, and the
    columns, (n, k), are taken out of all three. Likely is what suits y without creep, of the
    second time constant and of any size on this axis, or creep would hide itself.
    """
    likeliest, found = -np.inf, (y, y, history)
    count = columns.shape[1]
    regressors = np.column_stack((columns, history[1]))
    regressors = regressors / np.maximum(np.abs(regressors).max(axis=0), 1e-30)
    for inverse in inverses:
        white = inverse @ np.column_stack((regressors, y, history.T))
        basis, triangle = np.linalg.qr(white[:, : count + 1])
        sizes = np.abs(np.diag(triangle))
        full = sizes > _LEAST_SIZE * sizes.max()
        basis = np.where(full, basis, 0.0)
        rest = white[:, count + 1 :]
        rest = rest - basis[:, :count] @ (basis[:, :count].T @ rest)
        clean = rest[:, 0] - basis[:, count] * (basis[:, count] @ rest[:, 0])
        freedom = len(y) - full.sum()
        variance = max(clean @ clean / freedom, _LEAST_SIZE**2)
        # Restricted maximum likelihood.
        likelihood = np.log(np.diag(inverse)).sum() - np.log(sizes[full]).sum()
        likelihood -= 0.5 * freedom * np.log(variance)
        if likelihood > likeliest:
            likeliest, scale = likelihood, np.sqrt(variance)
            found = rest[:, 0] / scale, clean / scale, rest[:, 1:].T / scale
    return found
