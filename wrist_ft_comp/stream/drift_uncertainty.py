"""How far drift may be off: after a gap in the temperatures, and at a start on a warm robot."""

from typing import NamedTuple

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift import drift_model
from wrist_ft_comp.drift.drift_model import DriftModel, DriftState
from wrist_ft_comp.series import FloatArray, NANOSECONDS, noise_level

#: Temperatures that move by less over SPAN_S stand still, K: rooms, or rounding, move by 0.1.
_MOVES_K = 0.15
#: A room is warmer by this on one day than on another, K.
_ROOMS_K = 5.0
#: Steps of a path that temperatures may have taken in a gap: more change the bound by percents.
_PATH_STEPS = 64
#: A model's memory in slowest time constants: after three, 5 % of a change are left.
TIME_CONSTANTS = 3.0
#: A saved history is averaged over this time, s, so that it takes a few kilobytes; and over it is
#: measured how fast temperatures move.
SPAN_S = 60.0


class Uncertainty(NamedTuple):
    """How far the zero drift may be off at a stamp, and less and less from then on."""

    since_ns: int
    #: N and N m, (6,).
    bound: FloatArray

    def left(self, now_ns: float, memory_s: float) -> FloatArray:
        """Compute the bound at a later stamp, N and N m, (6,): the model forgets in memory_s."""
        age_s = (now_ns - self.since_ns) / NANOSECONDS
        return np.asarray(self.bound * np.exp(-TIME_CONSTANTS * age_s / memory_s))


def bound_drift(  # noqa: PLR0913, PLR0917 -- what a gap is between
    model: DriftModel, state: DriftState, history_c: FloatArray, after_c: FloatArray,
    gap_s: float, memory_s: float,
) -> FloatArray:  # fmt: skip
    """
    Bound the zero drift after a gap, N and N m: the least and the largest, (2, 6).

    Takes the state before it, the temperatures until then, °C, (n, J), and after it, (J,). In
    between, temperatures may have gone up and come back, or down, as fast as they ever moved over
    SPAN_S, but not beyond all that the model was learnt from.
    """
    period_s, before_c = model.period_ns / NANOSECONDS, history_c[-1]
    rate_k_s = np.abs(after_c - before_c) / max(gap_s, period_s)
    span = min(max(round(SPAN_S / period_s), 1), len(history_c) - 1)
    if span:  # a node may be killed after its first cell
        moves_k = np.abs(history_c[span:] - history_c[:-span]).max(axis=0)
        rate_k_s = np.maximum(moves_k / (span * period_s), rate_k_s)
    known_c = [history_c.min(axis=0), history_c.max(axis=0), after_c]
    for axis in model.axes.values():
        known_c += axis.range_c
    remembered_s = min(max(gap_s, 0.0), memory_s)
    cells = max(round(remembered_s / period_s / _PATH_STEPS), 1)
    until_s = np.arange(remembered_s, 0.0, -cells * period_s)[:, np.newaxis]
    since_k, until_k = rate_k_s * (gap_s - until_s), rate_k_s * until_s
    highest_c = np.minimum(np.minimum(before_c + since_k, after_c + until_k), np.max(known_c, 0))
    lowest_c = np.maximum(np.maximum(before_c - since_k, after_c - until_k), np.min(known_c, 0))
    ends = [drift_model.skip(model, state, path_c, cells) for path_c in (lowest_c, highest_c)]
    return np.stack([drift_model.step(model, end, after_c)[1].zero for end in ends])


def doubt_read(
    model: DriftModel, read_c: FloatArray, true_c: FloatArray, after_c: FloatArray
) -> FloatArray:
    """
    Bound what is wrong of the zero drift after false temperatures were read, (6,), N and N m.

    Takes what was read, and what may have been true, °C, (n, J), and what is true from then on,
    (J,). It is the largest error from then on, for as long again.
    """
    start, cells = drift_model.start(model, read_c[0]), len(read_c)
    states = [drift_model.skip(model, start, path_c) for path_c in (read_c, true_c)]
    off: FloatArray = np.zeros(len(AXES))
    # An error moves fast at first: looks that are not three times as late change it by percents.
    looks = [0, *3 ** np.arange(np.ceil(np.log(cells) / np.log(3))), cells]
    for passed in np.diff(looks, prepend=0).astype(int).tolist():
        states = [drift_model.skip(model, s, after_c[np.newaxis], passed) for s in states]
        read, true = (drift_model.step(model, s, after_c)[1].zero for s in states)
        off = np.maximum(off, np.abs(true - read))
    return off


def span_cells(model: DriftModel) -> int:
    """Count the thermal cells of SPAN_S, two at least."""
    return max(round(SPAN_S * NANOSECONDS / model.period_ns), 2)


def warmest_room_c(model: DriftModel) -> FloatArray:
    """Give what thermometers may read in a room, °C, (J,), by the coldest of the calibration."""
    coldest_c = [axis.range_c[0] for axis in model.axes.values()] or [np.full(1, np.inf)]
    return np.asarray(np.min(coldest_c, axis=0) + _ROOMS_K)


def doubt_start(
    model: DriftModel, start_c: FloatArray, memory_s: float, slope_k: FloatArray | None = None
) -> FloatArray:
    """
    Estimate how far the zero drift is off where the sensor had not soaked, N and N m, (6,).

    Of temperatures, °C, (n, J), the first SPAN_S count. Where they move, they may have done so
    before, from the coldest room or the hottest work that the model was learnt from. A robot that
    was switched on just now warms from the temperature of its room, and had soaked. What is warmer
    than a room may have come up in the slowest time constant, unless it is known, and taken into
    account, how fast temperatures moved before on the mean, K per cell, (J,).
    """
    start_c = start_c[: span_cells(model)]
    if slope_k is not None:
        start_c = start_c - slope_k * np.arange(len(start_c))[:, np.newaxis]
    some = max(len(start_c) // 6, 1)
    moved_k = start_c[-some:].mean(axis=0) - start_c[:some].mean(axis=0)
    rate_k = moved_k / max(len(start_c) - some, 1)
    rests_k = start_c - rate_k * np.arange(len(start_c))[:, np.newaxis]
    noise_k = np.array([noise_level([column]) for column in rests_k.T]) * np.sqrt(2 / some)
    is_still = np.abs(moved_k) < np.maximum(_MOVES_K, 3 * noise_k)
    rates_k = [np.where(is_still, 0.0, rate_k)]
    remembered = max(round(memory_s * NANOSECONDS / model.period_ns), 1)
    coldest_c = np.minimum(warmest_room_c(model), start_c[0])
    if slope_k is None:
        rates_k.append(TIME_CONSTANTS * (start_c[0] - coldest_c) / remembered)
    cells = max(remembered // _PATH_STEPS, 1)
    before = np.arange(remembered, 0, -cells)[:, np.newaxis]
    hottest_c = np.max([start_c[0], *(axis.range_c[1] for axis in model.axes.values())], axis=0)

    def end_of(path_c: FloatArray) -> FloatArray:
        state = drift_model.skip(model, drift_model.at_rest(model, path_c[:1]), path_c, cells)
        return drift_model.run_to_end(model, state, start_c)[1].zero

    paths_c = [np.clip(start_c[0] - k * before, coldest_c, hottest_c) for k in rates_k if k.any()]
    soaked = drift_model.run_to_end(model, drift_model.at_rest(model, start_c), start_c)[1].zero
    off = [np.abs(end_of(path_c) - soaked) for path_c in paths_c]
    return np.asarray(np.max([np.zeros(len(AXES)), *off], axis=0))
