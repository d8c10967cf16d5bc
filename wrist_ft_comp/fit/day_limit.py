"""What is stated of another day: what a fit leaves, RMS, and the limit of its largest error."""

from collections.abc import Sequence

import numpy as np

from wrist_ft_comp.channels import axis_unit
from wrist_ft_comp.drift.drift_model import AxisModel
from wrist_ft_comp.fit.axis_data import AxisData, FOLDS
from wrist_ft_comp.fit.folds import averaged_cells, mean_over, tared_means
from wrist_ft_comp.fit.result import AxisFit, Candidate, HeldOut
from wrist_ft_comp.series import FloatArray, ROUNDING

#: What another day is expected to keep is stated of a day of at least this length, s.
DAY_S = 10800.0
#: Recordings that are all shorter than this promise nothing of a day, s: of axes that were learnt
#: from three of 20 min half stayed below (bench/accuracy/worlds.py --dev, families short_1 to 3),
#: and of three of 40 min, where a motor cools sooner than the sensor.
_PROMISES_S = 3600.0
#: Nor do several that are shorter than this and only warm, or only cool: the thermometer that
#: moves most does not turn back by this share of its range.
_ONE_WAY_S, _ONE_WAY_SHARE = 7200.0, 0.2
#: On 9 of 10 days the largest error of an axis is below this many times the RMS that is stated
#: of it, where stretches of recordings were held out: tuned to 95 of 100
#: (bench/accuracy/worlds.py --dev); on worlds that nobody looked at it was below on 92 ...
_LIMIT_OF_STRETCHES = 9.0
#: ... and where whole recordings were.
_LIMIT_OF_DAYS = 6.0


def state_fit(  # noqa: PLR0913, PLR0917 -- what was chosen, and from what
    data: AxisData, model: AxisModel | None, chosen: str, left: HeldOut, names: Sequence[str],
    weights: FloatArray, notes: tuple[str, ...] = (),
) -> AxisFit:  # fmt: skip
    """
    State what an average of candidates leaves: names and weights, (C,), the first no compensation.

    Candidates of one name are stated together, in their weighted mean.
    """
    held_out = left.averaged(weights)
    squares = held_out.squares()  # (folds, C + 1)
    each = np.sqrt(squares).mean(axis=0)
    before, after = float(each[0]), float(each[-1])
    factor = day_over_blocks(data, before)
    rounding = ROUNDING * max(np.fmax.reduce(np.abs(r), initial=0.0) for r in data.residual)

    def of_a_day(rms: float) -> float:
        # What leaves less of blocks than no compensation does not leave more of a day.
        stated = max(rms, min(factor * rms, before))
        return stated if stated > rounding else 0.0

    tried = []
    for name in dict.fromkeys(names):
        members = [position for position, one in enumerate(names) if one == name]
        shares = weights[members]
        rms = np.average(each[members], weights=shares if shares.any() else None)
        tried.append(Candidate(name, of_a_day(float(rms)), float(shares.sum())))
    expected = expected_rms(data, model, squares, weights)
    largest = limit = np.nan
    if data.tared:
        cells = averaged_cells(data.period_s)
        drifts = [tared_means(residual, cells, data.period_s) for residual in data.residual]
        largest = float(np.abs(np.concatenate(drifts)).max(initial=0.0))
        limit = expected * (_LIMIT_OF_DAYS if data.holds_out_days else _LIMIT_OF_STRETCHES)
    # Where the drift stays below it, too, it is no promise, nor where nothing lasted.
    is_promise = limit <= largest and data.longest_s >= _PROMISES_S
    # Short warm-ups agree with each other, and say nothing of how the sensor cools.
    is_long = data.recordings == 1 or data.longest_s >= _ONE_WAY_S
    is_promise &= is_long or any(map(_turns_back, data.temperature_c))
    if data.no_sensitivity:
        notes = (*notes, f'zero drift only: {data.no_sensitivity}')
    return AxisFit(
        model=model, chosen=chosen, candidates=tuple(tried), rms_before=tried[0].rms,
        rms_after=of_a_day(after), notes=notes, unit=axis_unit(data.axis), held_out=held_out,
        expected_rms=expected, largest_drift=largest,
        day_limit=limit if is_promise else np.nan)  # fmt: skip


def _turns_back(temperature_c: FloatArray) -> bool:
    """Whether the thermometer that moves most warms and cools by a good part of that, (N, J)."""
    leading_c = temperature_c[:, np.argmax(np.ptp(temperature_c, axis=0))]
    fallen_k = (np.maximum.accumulate(leading_c) - leading_c).max()
    risen_k = (leading_c - np.minimum.accumulate(leading_c)).max()
    return bool(min(fallen_k, risen_k) > _ONE_WAY_SHARE * np.ptp(leading_c))


def expected_rms(
    data: AxisData, model: AxisModel | None, squares: FloatArray, weights: FloatArray
) -> float:
    """
    Root mean square that an average of fits, the model, is expected to leave of another day.

    Takes mean squares on held-out folds, (folds, C + 1), without compensation first and of the
    average last, and its weights, (C,). Half of the members' spread around the average is added,
    because what they disagree about is not known. Of several recordings each counts by how much it
    drifts uncompensated, because another day may be like the one that drifted most; and what is
    learnt from all of them leaves less than what each was held out from.
    """
    uncompensated, left = squares[:, 0], (squares[:, -1] + squares[:, :-1] @ weights) / 2
    if data.holds_out_days:
        # What n recordings leave, by what n - 1 of them leave: the median of 1270 axes that were
        # learnt from two to six drawn days kept 0.86 of what was expected with this power.
        learnt_more = (1 - 1 / len(left)) ** (1 / 3)
        shares = uncompensated + np.finfo(float).tiny
        rms = float(learnt_more * np.sqrt(np.average(left, weights=shares)))
    else:
        before = float(np.sqrt(uncompensated).mean())
        rms = day_over_blocks(data, before, DAY_S) * float(np.sqrt(np.mean(left)))
    if model is None:
        return rms
    # In operation the drift of a cell is subtracted in the next one, on a ramp.
    late = []
    for temperature_c in data.temperature_c:
        drift = model.run(model.start(temperature_c[0]), temperature_c)[1][:, 0]
        missed = np.full(len(drift), np.nan)
        missed[2:] = drift[2:] - (drift[1:-1] + drift[:-2]) / 2
        late.append(mean_over(missed, averaged_cells(data.period_s)))
    return float(np.hypot(rms, np.nanstd(np.concatenate(late))))


def day_over_blocks(data: AxisData, before: float, day_s: float = 0.0) -> float:
    """
    Say how many times more is left of a day than of blocks that, uncompensated, leave some RMS.

    What a model leaves of blocks wanders like a random walk, so it grows by the root of how much
    further drift goes in the whole recording; where recordings are held out, by nothing. In a day
    longer than the recording, s, it goes on as it did from a block to the whole.
    """
    if data.holds_out_days or not data.tared or before == 0:
        return 1.0
    read = [values for values in data.residual if np.isfinite(values).any()]
    y = np.concatenate([tared_means(values, data.bin_cells, data.period_s) for values in read])
    further = max(1.0, float(np.sqrt(np.mean(y**2))) / before)
    longer = max(1.0, day_s / (max(map(len, read)) * data.period_s))
    return float(further ** (0.5 * (1 + np.log(longer) / np.log(FOLDS))))
