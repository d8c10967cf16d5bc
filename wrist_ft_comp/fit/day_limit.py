"""What is expected of another day, RMS, and the limit that its largest error stays below."""

from collections.abc import Sequence

import numpy as np

from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.fit.axis_data import AxisData, FOLDS
from wrist_ft_comp.fit.folds import averaged_cells, bin_means, tared_means
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray

#: What another day is expected to keep is stated of a day of at least this length, s.
DAY_S = 10800.0
#: On 9 of 10 days the largest error of an axis is below this many times the RMS that is stated
#: of it, where it was learnt from one recording: tuned to 95 of 100 (bench/accuracy/worlds.py
#: --dev); on worlds that nobody looked at it was below on 92 ...
_LIMIT_OF_ONE = 9.0
#: ... and from several.
_LIMIT_OF_SEVERAL = 6.0


def expected_rms(
    data: AxisData, average: FloatArray, members: FloatArray, uncompensated: FloatArray
) -> float:
    """
    Root mean square that an average of fits is expected to leave of another day.

    Mean squares on held-out folds, (folds,), are those of the average, those of its members in
    their weighted mean, and those without compensation. Half of the members' spread around the
    average is added, because what they disagree about is not known. Of several recordings each
    counts by how much it drifts uncompensated, because another day may be like the one that
    drifted most; and what is learnt from all of them leaves less than what each was held out from.
    """
    left = (average + members) / 2
    if data.recordings > 1:
        # What n recordings leave, by what n - 1 of them leave: the median of 1270 axes that were
        # learnt from two to six drawn days kept 0.86 of what was expected with this power.
        learnt_more = (1 - 1 / len(left)) ** (1 / 3)
        return float(
            learnt_more * np.sqrt(np.average(left, weights=uncompensated + np.finfo(float).tiny))
        )
    before = float(np.sqrt(uncompensated).mean())
    return day_over_blocks(data, before, DAY_S) * float(np.sqrt(np.mean(left)))


def day_over_blocks(data: AxisData, before: float, day_s: float = 0.0) -> float:
    """
    Say how many times more is left of a day than of blocks that, uncompensated, leave some RMS.

    A single recording is held out in blocks. What a model leaves wanders like a random walk, so
    it grows by the root of how much further drift goes in the whole recording; else by nothing.
    In a day longer than the recording, s, it goes on as it did from a block to the whole.
    """
    if data.recordings > 1 or not data.tared or before == 0:
        return 1.0
    (residual,) = (values for values in data.residual if np.isfinite(values).any())
    y = tared_means(residual, data.bin_cells, data.period_s)
    further = max(1.0, float(np.sqrt(np.mean(y**2))) / before)
    longer = max(1.0, day_s / (len(residual) * data.period_s))
    return float(further ** (0.5 * (1 + np.log(longer) / np.log(FOLDS))))


def largest_drift(data: AxisData) -> float:
    """Find the largest drift since a recording's first minute, in means over 10 s."""
    cells, period_s = averaged_cells(data.period_s), data.period_s
    drifts = np.concatenate([tared_means(one, cells, period_s) for one in data.residual])
    return float(np.abs(drifts).max(initial=0.0))


def late_errors(model: AxisModel, recordings: Sequence[Recording]) -> FloatArray:
    """
    Compute what is left in operation because the drift of a cell is subtracted in the next one.

    Zero drift of an axis in the recordings, on a ramp as the stream has it, in means over 10 s.
    """
    errors = []
    for recording in recordings:
        start = model.start(recording.temperature_c[0])
        drift = model.run(start, recording.temperature_c)[1][:, 0]
        cells = np.arange(2, len(drift))
        late = drift[2:] - (drift[1:-1] + drift[:-2]) / 2
        errors.append(bin_means(late, cells, averaged_cells(recording.period_s)))
    return np.concatenate(errors)


def day_limit(data: AxisData, rms: float) -> float:
    """Limit that the largest error of another day stays below; NaN where drift does so, too."""
    limit = rms * (_LIMIT_OF_ONE if data.recordings == 1 else _LIMIT_OF_SEVERAL)
    return limit if limit <= largest_drift(data) else np.nan
