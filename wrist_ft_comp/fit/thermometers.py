"""How each thermometer is predicted from the others: ridge regressions and held-out errors."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.drift.prediction import (
    AVERAGED_BINS,
    bin_cells,
    EARLIER_BINS,
    NO_LIMIT_K,
    Prediction,
)
from wrist_ft_comp.signals import BoolArray, FloatArray, IntArray, Recording

#: Weights of errors, newest first: their average …
_AVERAGE: FloatArray = np.full(AVERAGED_BINS, 1.0 / AVERAGED_BINS)
#: … and how far it is from the average before.
_CHANGE: FloatArray = np.append(_AVERAGE, np.full(EARLIER_BINS, -1.0 / EARLIER_BINS))
#: Relaxations of the other thermometers, s: from none to what a robot's body remembers.
TIME_CONSTANTS_S: FloatArray = np.array([0.0, 60.0, 150.0, 400.0, 1000.0, 2500.0, 6000.0])
#: Strengths of the ridge, as shares of a column's variance; the best one held out is taken.
_STRENGTHS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
#: A healthy thermometer is taken to err by up to this many times the largest error held out, …
_ERROR_MARGIN = 6.0
#: … and by at least this, K.
_LEAST_LIMIT_K = 1.0
#: Its error is taken to change by up to this many times the largest change held out, and by at
#: least _LEAST_LIMIT_K: no healthy one did on 850 days of drawn worlds; by 3 times, two did.
_JUMP_MARGIN = 3.5
#: Fewer recordings have not shown how thermometers differ from day to day: of those that were
#: learnt from one, some were off by up to 6 K on healthy days of drawn worlds.
_FEWEST_RECORDINGS = 3
#: The prediction moves by at least this before one that stands still is taken for frozen, K, …
_LEAST_STILL_K = 0.5
#: … by this many times what it moved by while a healthy one stood still, and by more than its
#: error has changed. Without the latter, 4 of 1200 healthy ones of drawn worlds were replaced.
_STILL_MARGIN = 3.0
#: A thermometer is silent when it was not heard for this time, s, …
_LEAST_SILENCE_S = 600.0
#: … and for this many times its longest silence in the recordings.
_SILENCE_MARGIN = 3.0
#: Below every mean square, K², so that logarithms exist.
_TINY_K2 = 1e-12
#: Fewer bins than this cannot tell one thermometer by another.
_FEWEST_BINS = 60


def predict_each_other(
    recordings: Sequence[Recording], folds: Sequence[IntArray]
) -> Prediction | None:
    """
    Learn every thermometer from the others, on bins.

    Errors are those of folds of cells, (N_i,), that were held out. None with one thermometer, or
    where the recordings have fewer than 60 bins.
    """
    cells = bin_cells(recordings[0].period_ns)
    binned: list[FloatArray] = [_in_bins(r.temperature_c, cells).mean(axis=1) for r in recordings]
    heard_bins = [np.asarray(_in_bins(r.measured, cells).any(axis=1)) for r in recordings]
    thermometers = recordings[0].thermometers
    if thermometers < 2 or sum(map(len, binned)) < _FEWEST_BINS:
        return None
    held_out = [of_cells[::cells][: len(b)] for of_cells, b in zip(folds, binned, strict=True)]
    fold = np.concatenate(held_out)
    gains = np.zeros((thermometers, len(TIME_CONSTANTS_S), thermometers))
    learnt = Prediction(TIME_CONSTANTS_S, gains, *np.zeros((5, thermometers)))
    bin_s = cells * recordings[0].period_s
    columns = np.concatenate([relaxed(learnt, values_c, bin_s) for values_c in binned])
    values_c = np.concatenate(binned)
    ends = np.cumsum([len(b) for b in binned])[:-1]
    for j in range(thermometers):
        others = np.delete(columns, j, axis=2).reshape(len(columns), -1)
        error_k, of_others, constant_c = _fit(others, values_c[:, j], fold)
        gains[j] = np.insert(of_others.reshape(len(TIME_CONSTANTS_S), -1), j, 0.0, axis=1)
        learnt.constant_c[j] = constant_c
        errors_k = np.split(error_k, ends)
        limit_k = max(_LEAST_LIMIT_K, _ERROR_MARGIN * _largest(_AVERAGE, errors_k))
        changed_k = _largest(_CHANGE, errors_k)
        jump_k = max(_LEAST_LIMIT_K, _JUMP_MARGIN * changed_k)
        shown = len(recordings) >= _FEWEST_RECORDINGS
        learnt.limit_k[j], learnt.jump_k[j] = (limit_k, jump_k) if shown else [NO_LIMIT_K] * 2
        moved_k = max(
            _moved_while_still(bins_c[:, j], of_bins_k, heard[:, j])
            for bins_c, of_bins_k, heard in zip(binned, errors_k, heard_bins, strict=True)
        )
        learnt.still_k[j] = max(_LEAST_STILL_K, _STILL_MARGIN * moved_k, changed_k)
        silence_s = max(longest_silence(r.measured[:, j]) * r.period_s for r in recordings)
        learnt.silence_s[j] = max(_LEAST_SILENCE_S, _SILENCE_MARGIN * silence_s)
    return learnt


def _in_bins(values: NDArray[Any], cells: int) -> NDArray[Any]:
    """Cut values by cell, (N, J), into whole bins, (n, cells, J)."""
    return values[: len(values) // cells * cells].reshape(-1, cells, values.shape[1])


def relaxed(prediction: Prediction, values_c: FloatArray, bin_s: float) -> FloatArray:
    """Relax the temperatures of bins, (n, J), from rest at the first: (n, K, J)."""
    states = np.empty((len(values_c), len(prediction.time_constants_s), values_c.shape[1]))
    state = np.broadcast_to(values_c[:1], states.shape[1:]) if len(values_c) else states
    for k, bin_c in enumerate(values_c):
        states[k] = state = prediction.relax(state, bin_c, bin_s)
    return states


def _fit(
    columns: FloatArray, target_c: FloatArray, fold: IntArray
) -> tuple[FloatArray, FloatArray, float]:
    """Regress by the strength that errs least, over folds: its errors, gains and constant."""
    best = (np.inf, 0.0, target_c)
    for strength in _STRENGTHS:
        error_k = np.empty_like(target_c)
        for number in np.unique(fold):
            out = fold == number
            gains, constant_c = _ridge(columns[~out], target_c[~out], strength)
            error_k[out] = target_c[out] - constant_c - columns[out] @ gains
        squares = [np.mean(error_k[fold == number] ** 2) for number in np.unique(fold)]
        score = float(np.log(np.maximum(squares, _TINY_K2)).mean())
        if score < best[0]:
            best = score, strength, error_k
    return best[2], *_ridge(columns, target_c, best[1])


def _ridge(columns: FloatArray, target_c: FloatArray, strength: float) -> tuple[FloatArray, float]:
    """Regress on columns, (n, C), with a free constant: gains, (C,), and the constant."""
    mean, size = columns.mean(axis=0), columns.std(axis=0)
    size = np.where(size > 0, size, 1.0)
    scaled, middle_c = (columns - mean) / size, float(target_c.mean())
    gram = scaled.T @ scaled + strength * len(scaled) * np.eye(len(size))
    gains = np.linalg.solve(gram, scaled.T @ (target_c - middle_c)) / size
    return gains, middle_c - float(mean @ gains)


def _largest(weights: FloatArray, errors_k: Sequence[FloatArray]) -> float:
    """Find the largest weighted sum of recordings, or of twice the errors of too short ones."""
    sums_k = [
        np.convolve(error_k, weights, 'valid') if len(error_k) >= len(weights) else 2.0 * error_k
        for error_k in errors_k
    ]
    return float(np.abs(np.concatenate(sums_k)).max())


def _moved_while_still(values_c: FloatArray, error_k: FloatArray, heard: BoolArray) -> float:
    """Find how far the prediction moves, K, while a thermometer stands still or is silent."""
    still = (np.diff(values_c) == 0) | ~heard[1:]
    predicted_c = values_c - error_k
    moved_k = [np.ptp(predicted_c[first : last + 1]) for first, last in runs_of(still)]
    return float(max(moved_k, default=0.0))


def longest_silence(measured: BoolArray) -> int:
    """Count the cells of the longest silence."""
    return max((last - first for first, last in runs_of(~measured)), default=0)


def runs_of(marked: BoolArray) -> Iterator[tuple[int, int]]:
    """Yield begin and end of every run of marked values, (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], marked, [False])).astype(int)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
