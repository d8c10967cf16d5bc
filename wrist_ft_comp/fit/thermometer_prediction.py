"""
How each thermometer is predicted from the others: ridge regressions and held-out errors.

The others stand behind the longest bank of relaxations of ``auto``, with its ridge of middle
strength.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from wrist_ft_comp.drift.arx_pls import free_run, relaxation
from wrist_ft_comp.drift.drift_model import DriftModel, ThermometerPrediction
from wrist_ft_comp.fit.auto_method import LONG_BANK_S, STRENGTHS
from wrist_ft_comp.fit.data_checks import LONG_SILENCE_S, runs_of
from wrist_ft_comp.fit.folds import assign_folds, mean_over
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray, IntArray
from wrist_ft_comp.stream.drift_of_recordings import exchange_doubts

#: Temperatures and relaxed temperatures are averaged over this time for the fit, s.
_MEAN_S = 60.0
#: No healthy thermometer is called frozen that reads within this of its prediction, K, and none is
#: believed again that does not. From one or two recordings predictions of healthy thermometers of
#: drawn worlds were off by up to twelve times this on other days.
_NEAR_K = 0.5
#: What is unusual is this many times what was usual in the recordings. Of 1200 healthy ones of
#: drawn worlds, 4 were replaced where a change of the error did not count as usual, too.
UNUSUAL = 3.0


def predict_each_other(
    recordings: Sequence[Recording], folds: Sequence[IntArray]
) -> ThermometerPrediction | None:
    """
    Learn every thermometer from the others, on means over a minute.

    Errors are those of folds of cells, (N_i,), that were held out. They are averaged over half of
    LONG_SILENCE_S before they say what is usual, and change within that time. None with one
    thermometer, or where the recordings last less than an hour, six times that.
    """
    period_s, thermometers = recordings[0].period_s, recordings[0].thermometers
    cells = max(1, round(_MEAN_S / period_s))
    mean_s = cells * period_s
    whole_means = sum(len(recording) // cells for recording in recordings)
    if thermometers < 2 or whole_means * mean_s < 6 * LONG_SILENCE_S:
        return None
    # Relaxed cell by cell and then averaged, (n_i, K, J), as what it is compared with.
    filters = [relaxation(tau, period_s) for tau in LONG_BANK_S]
    relaxed = [
        np.stack([mean_over(free_run(h, r.temperature_c), cells) for h in filters], axis=1)[
            : len(r) // cells
        ]
        for r in recordings
    ]
    means_c = [of_recording[:, 0] for of_recording in relaxed]  # the first has no memory
    relaxed_c, target_c = np.concatenate(relaxed), np.concatenate(means_c)
    fold = np.concatenate([f[::cells][: len(m)] for f, m in zip(folds, means_c, strict=True)])
    if len(np.unique(fold)) < 2:  # all but one recording are shorter than a mean
        return None
    gains = np.zeros((thermometers, len(filters), thermometers))
    constant_c, error_k = np.zeros(thermometers), np.empty_like(target_c)
    for j in range(thermometers):
        others = np.delete(relaxed_c, j, axis=2).reshape(len(relaxed_c), -1)
        for number in np.unique(fold):
            out = fold == number
            from_rest, rest_c = _ridge(others[~out], target_c[~out, j])
            error_k[out, j] = target_c[out, j] - rest_c - others[out] @ from_rest
        of_others, constant_c[j] = _ridge(others, target_c[:, j])
        gains[j] = np.insert(of_others.reshape(len(filters), -1), j, 0.0, axis=1)
    # What is usual: how far the prediction moves while the thermometer stands still or is silent,
    # how large the averaged error gets, how much it changes, how long silence lasts.
    moved_k, largest_k, changed_k, silent_s = np.zeros((4, thermometers))
    averaged, apart = (max(1, round(s / mean_s)) for s in (LONG_SILENCE_S / 2, LONG_SILENCE_S))
    errors_k = np.split(error_k, np.cumsum(list(map(len, means_c)))[:-1])
    for recording, mean_c, error in zip(recordings, means_c, errors_k, strict=True):
        if not len(error):  # shorter than a mean
            continue
        size = averaged if len(error) >= averaged else 1
        mean_k = sliding_window_view(error, size, axis=0).mean(axis=-1)
        largest_k = np.maximum(largest_k, np.abs(mean_k).max(axis=0))
        change_k = np.abs(mean_k[apart:] - mean_k[:-apart])
        changed_k = np.maximum(changed_k, change_k.max(axis=0, initial=0.0))
        heard = np.asarray(mean_over(recording.measured.astype(float), cells)[: len(error)] > 0)
        still = (np.diff(mean_c, axis=0) == 0) | ~heard[1:]
        for j in range(thermometers):
            for first, last in runs_of(still[:, j]):
                moved_k[j] = max(moved_k[j], np.ptp((mean_c - error)[first : last + 1, j]))
            for first, last in runs_of(~recording.measured[:, j]):
                silent_s[j] = max(silent_s[j], (last - first) * period_s)
    near_k = _NEAR_K if len(recordings) > 2 else 12 * _NEAR_K
    return ThermometerPrediction(
        np.array(LONG_BANK_S), gains, constant_c,
        # What is predicted badly says little of small moves, either.
        still_k=np.maximum(_NEAR_K, np.max([UNUSUAL * moved_k, changed_k, largest_k / 2], axis=0)),
        silence_s=np.maximum(LONG_SILENCE_S, UNUSUAL * silent_s),
        agree_k=np.maximum(near_k, UNUSUAL * largest_k))  # fmt: skip


def _ridge(columns: FloatArray, target_c: FloatArray) -> tuple[FloatArray, float]:
    """Regress on columns, (n, C), with a free constant: gains, (C,), and the constant."""
    mean, size = columns.mean(axis=0), columns.std(axis=0)
    size = np.where(size > 0, size, 1.0)
    scaled, middle_c = (columns - mean) / size, float(target_c.mean())
    # The middle one: the strongest errs more in drawn worlds, and the weakest no less.
    gram = scaled.T @ scaled + STRENGTHS[1] * len(scaled) * np.eye(len(size))
    gains = np.linalg.solve(gram, scaled.T @ (target_c - middle_c)) / size
    return gains, middle_c - float(mean @ gains)


def exchanged_days(recordings: Sequence[Recording], model: DriftModel) -> Iterator[str]:
    """Name thermometers that read what those of two or more other days expect of each other."""
    for i, recording in enumerate(recordings if len(recordings) > 2 else ()):
        others = [*recordings[:i], *recordings[i + 1 :]]
        judge = replace(model, prediction=predict_each_other(others, assign_folds(others)))
        yield from (f'In {recording.name}, {said}.' for said in exchange_doubts(judge, recording))
