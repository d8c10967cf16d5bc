"""How each thermometer is predicted from the others: ridge regressions and held-out errors."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.drift.arx import free_run, relaxation
from wrist_ft_comp.drift.thermometer_prediction import ThermometerPrediction
from wrist_ft_comp.signals import BoolArray, FloatArray, IntArray, Recording

#: Relaxations of the other thermometers, s: from none to what a robot's body remembers.
TIME_CONSTANTS_S: FloatArray = np.array([0.0, 60.0, 150.0, 400.0, 1000.0, 2500.0, 6000.0])
#: Strengths of the ridge, as shares of a column's variance; the one that errs least is taken.
_STRENGTHS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
#: Temperatures and relaxed temperatures are averaged over this time for the fit, s.
_MEAN_S = 60.0
#: Fewer means than this cannot tell one thermometer by another.
_FEWEST_MEANS = 60
#: Errors are averaged over this time before they say what is usual, s.
_ERROR_MEAN_S = 300.0
#: An averaged error changes within this time; the largest change in the recordings is usual, s.
_ERROR_CHANGE_S = 600.0
#: The prediction moves by at least this before one that stands still is taken for frozen, K ...
_LEAST_STILL_K = 0.5
#: ... by this many times what it moved by while a healthy one stood still, and by more than the
#: largest change of its error. Without the latter, 4 of 1200 healthy ones of drawn worlds were
#: replaced.
_STILL_MARGIN = 3.0
#: A thermometer is silent for at least this time before it is taken for dead, s ...
_LEAST_SILENCE_S = 600.0
#: ... and for this many times its longest silence in the recordings.
_SILENCE_MARGIN = 3.0
#: One that was replaced agrees again within this many times the largest averaged error ...
_AGREE_MARGIN = 2.5
#: ... and within this, K.
_LEAST_AGREE_K = 0.5
#: Fewer recordings have not shown how thermometers differ from day to day ...
_FEWEST_RECORDINGS = 3
#: ... then it agrees within this, K: learnt from one day of drawn worlds, predictions of healthy
#: thermometers were off by up to as much on other days.
_AGREE_UNSHOWN_K = 6.0
#: Below every mean square, K², so that logarithms exist.
_TINY_K2 = 1e-12


def predict_each_other(
    recordings: Sequence[Recording], folds: Sequence[IntArray]
) -> ThermometerPrediction | None:
    """
    Learn every thermometer from the others, on means over a minute.

    Errors are those of folds of cells, (N_i,), that were held out. None with one thermometer, or
    where the recordings have fewer than 60 means.
    """
    period_s, thermometers = recordings[0].period_s, recordings[0].thermometers
    cells = max(1, round(_MEAN_S / period_s))
    means_c = [_in_parts(r.temperature_c, cells).mean(axis=1) for r in recordings]
    if thermometers < 2 or sum(map(len, means_c)) < _FEWEST_MEANS:
        return None
    heard: list[BoolArray] = [
        np.asarray(_in_parts(r.measured, cells).any(axis=1)) for r in recordings
    ]
    filters = [relaxation(time_constant_s, period_s) for time_constant_s in TIME_CONSTANTS_S]
    # Relaxed cell by cell and then averaged, (n, K, J), as what it is compared with.
    relaxed_c = np.concatenate(
        [
            np.stack(
                [_in_parts(free_run(h, r.temperature_c), cells).mean(axis=1) for h in filters],
                axis=1,
            )
            for r in recordings
        ]
    )
    fold = np.concatenate([f[::cells][: len(m)] for f, m in zip(folds, means_c, strict=True)])
    target_c, ends = np.concatenate(means_c), np.cumsum(list(map(len, means_c)))[:-1]
    mean_s = cells * period_s
    gains = np.zeros((thermometers, len(filters), thermometers))
    constant_c, still_k, silence_s, agree_k = np.zeros((4, thermometers))
    for j in range(thermometers):
        others = np.delete(relaxed_c, j, axis=2).reshape(len(relaxed_c), -1)
        error_k, of_others, constant_c[j] = _fit(others, target_c[:, j], fold)
        gains[j] = np.insert(of_others.reshape(len(filters), -1), j, 0.0, axis=1)
        errors_k = np.split(error_k, ends)
        moved_k = max(
            _moved_while_still(means[:, j], error, any_heard[:, j])
            for means, error, any_heard in zip(means_c, errors_k, heard, strict=True)
        )
        largest_k, changed_k = _largest_error(errors_k, mean_s)
        still_k[j] = max(_LEAST_STILL_K, _STILL_MARGIN * moved_k, changed_k)
        least_k = _LEAST_AGREE_K if len(recordings) >= _FEWEST_RECORDINGS else _AGREE_UNSHOWN_K
        agree_k[j] = max(least_k, _AGREE_MARGIN * largest_k)
        silent_s = max(longest_silence(r.measured[:, j]) * period_s for r in recordings)
        silence_s[j] = max(_LEAST_SILENCE_S, _SILENCE_MARGIN * silent_s)
    return ThermometerPrediction(TIME_CONSTANTS_S, gains, constant_c, still_k, silence_s, agree_k)


def _in_parts(values: NDArray[Any], cells: int) -> NDArray[Any]:
    """Cut values by cell, (N, J), into whole parts, (n, cells, J)."""
    return values[: len(values) // cells * cells].reshape(-1, cells, values.shape[1])


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


def _largest_error(errors_k: Sequence[FloatArray], mean_s: float) -> tuple[float, float]:
    """Find the largest averaged error, K, and its largest change; of means of some length, s."""
    size = max(1, round(_ERROR_MEAN_S / mean_s))
    apart = max(1, round(_ERROR_CHANGE_S / mean_s))
    largest_k = changed_k = 0.0
    for error_k in errors_k:
        averaged_k = np.convolve(error_k, np.full(size, 1 / size), 'valid')
        if len(error_k) < size:  # too short to be averaged
            averaged_k = error_k
        largest_k = max(largest_k, float(np.abs(averaged_k).max(initial=0.0)))
        change_k = averaged_k[apart:] - averaged_k[:-apart]
        changed_k = max(changed_k, float(np.abs(change_k).max(initial=0.0)))
    return largest_k, changed_k


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
