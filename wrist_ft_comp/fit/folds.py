"""Which stretches of recordings are held out in turn, and the bins in which they are judged."""

from collections.abc import Sequence

import numpy as np

from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import IntArray, NANOSECONDS, stretches

#: Candidates are fitted to sums over bins of this length, and errors are stated as means over it:
#: features hardly change within it, s.
FITTED_BIN_S = 10.0
#: Errors are averaged over this time before they are judged: drift is slow, noise is not, s.
JUDGED_BIN_S = 3 * FITTED_BIN_S
#: In a short recording bins are shorter, so that a fold still has this many.
BINS_PER_FOLD = 8
#: Stretches that a single recording is divided into, to be held out in turn. A fit to the
#: others interpolates a short one, which says little of another day: with four instead of three,
#: 1.1 times as much drift was left there, and with two as well.
FOLDS = 3
#: Fewer cells with a wrench than this cannot be divided into folds worth holding out.
MIN_SAMPLES = FOLDS * BINS_PER_FOLD
#: A chamber test has at least as many plateaus as there are folds, and at most this many.
MOST_PLATEAUS = 12
#: On a plateau temperature moves by less than this share of the smallest step between plateaus:
#: a chamber holds to a tenth of that, and a warm-up moves more between any two of its gaps.
_STILL = 0.25


def assign_folds(recordings: Sequence[Recording]) -> list[IntArray]:
    """Assign each cell, (N_i,), to a fold: recordings, plateaus, or else stretches of one."""
    if len(recordings) > 1:
        return [np.full(len(recording), i) for i, recording in enumerate(recordings)]
    plateaus = find_plateaus(recordings)
    if plateaus is not None:
        return [plateaus]
    # Half by time, half by kelvin: by time alone the first third of a warm-up holds nearly all of
    # its drift, and nothing that is learnt without it can tell whether it would hold there.
    temperature_c = recordings[0].temperature_c
    cells = np.arange(len(temperature_c))
    blocks = np.array_split(cells, min(len(cells), FOLDS * BINS_PER_FOLD))
    # Means, because noise would go far, too; and the ends, where most happens.
    parts = [cells[:1], *blocks, cells[-1:]]
    means_c = np.array([temperature_c[part].mean(axis=0) for part in parts])
    travel_k = np.cumsum(np.abs(np.diff(means_c, axis=0, prepend=means_c[:1])).sum(axis=1))
    travelled_k = np.interp(cells, [part.mean() for part in parts], travel_k)
    passed = (cells / len(cells) + travelled_k / (travel_k[-1] or 1.0)) / 2
    # Folds end at whole bins, so that no bin that is judged holds samples of two folds.
    width = bin_cells(len(cells), recordings[0].period_s)[1]
    return [np.floor(passed[cells // width * width] * FOLDS).astype(int)]


def bin_cells(longest: int, period_s: float) -> tuple[int, int]:
    """Cells per bin that is fitted, and per bin that is judged: a multiple of the former."""
    longest_bin = max(longest // (FOLDS * BINS_PER_FOLD), 1)
    judged = min(max(round(JUDGED_BIN_S / period_s), 1), longest_bin)
    fitted = max(min(round(FITTED_BIN_S / period_s), judged // 3), 1)
    return fitted, judged - judged % fitted


def find_plateaus(recordings: Sequence[Recording]) -> IntArray | None:
    """
    Count the plateaus of a chamber test, shape (N,); None unless there are 3 to 12.

    A plateau is a stretch of wrenches in which temperature stands still; between plateaus it
    moves. A warm-up with gaps has none.
    """
    if len(recordings) > 1:
        return None
    present = np.any(np.isfinite(recordings[0].wrench), axis=1)
    plateaus = stretches(present, recordings[0].period_s)
    if not FOLDS <= plateaus[-1] + 1 <= MOST_PLATEAUS:
        return None
    temperature_c = recordings[0].temperature_c
    leading = temperature_c[:, np.argmax(np.ptp(temperature_c, axis=0))]
    levels = [leading[present & (plateaus == number)] for number in range(plateaus[-1] + 1)]
    steps_k = np.abs(np.diff([np.mean(level) for level in levels]))
    return plateaus if max(map(np.ptp, levels)) < _STILL * steps_k.min() else None


def averaged_cells(period_s: float) -> int:
    """Count the thermal cells of the means that limits are stated of, and days are judged by."""
    return max(1, round(FITTED_BIN_S / period_s))


def averaged_s(model: DriftModel) -> float:
    """Compute how long these means last, s."""
    period_s = model.period_ns / NANOSECONDS
    return averaged_cells(period_s) * period_s
