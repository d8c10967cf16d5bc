"""A test in a climate chamber: plateaus of temperature, whose difference is the drift."""

from collections.abc import Sequence

import numpy as np

from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import IntArray, stretches

#: A chamber test has at least three plateaus, and at most this many.
LEAST_PLATEAUS, MOST_PLATEAUS = 3, 12
#: On a plateau temperature moves by less than this share of the smallest step between plateaus:
#: a chamber holds to a tenth of that, and a warm-up moves more between any two of its gaps.
_STILL = 0.25


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
    if not LEAST_PLATEAUS <= plateaus[-1] + 1 <= MOST_PLATEAUS:
        return None
    temperature_c = recordings[0].temperature_c
    leading = temperature_c[:, np.argmax(np.ptp(temperature_c, axis=0))]
    levels = [leading[present & (plateaus == number)] for number in range(plateaus[-1] + 1)]
    steps_k = np.abs(np.diff([np.mean(level) for level in levels]))
    return plateaus if max(map(np.ptp, levels)) < _STILL * steps_k.min() else None
