"""
Steps of the zero: where a reading changes at once and stays, as after a tare of the driver.

Beside a possible step, the reading is explained twice: by a parabola, a step and sudden heat, and
by a parabola and sudden heat twice. Heat has a tail, also behind a contact that hides its
front. A step is named only where it explains clearly more.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.series import BoolArray, FloatArray, IntArray, robust_cost, robust_weight

#: A step is explained by the readings within this time before and after it, s: longer than a
#: contact, short enough for a parabola to follow the drift; steps are half of it apart ...
BESIDE_S = 120.0
#: ... and at least by this number of readings on either side: half of what is fitted to an axis.
_LEAST_BESIDE = 6
#: Smallest step, in standard deviations of a reading, over all axes.
SMALLEST_SIGMA = 15.0
#: Time constants of sudden heat, s: by half an octave, because a tail of 6 s is not one of 5 s.
#: Those of less than two readings are left out: means over cells do not show them.
_HEAT_S = np.geomspace(5.0, 160.0, 11)
#: A step is named where it is more likely than heat by the exponential of this: with n readings,
#: n times the logarithm of the ratio of squares that heat and step leave.
_LEAST_EVIDENCE = 18.0
#: Where a contact of at least this time hides what happened, s, heat and step explain it alike. A
#: jump of at least four times SMALLEST_SIGMA is taken for a step then, but not called certain:
#: with cells of 10 s, tares of a driver were above 300; at 40, five of six worlds got steps that
#: were none; at 100, jumps of 2 N were missed. That also is the time around a possible step in
#: which it and sudden heat may begin, and over whose median the level before it is taken.
_HIDING_S = 20.0
#: The evidence is above this then: 33 heats compete, one of which may be likelier by chance. At
#: -2.5 a press of 200 s around a jump was named as a part of it; at 0 the jump was missed.
_HIDDEN_EVIDENCE = -2.0
#: Width of the robust weight, in standard deviations of an axis, where the noise is known.
WIDTH_SIGMA = 4.0


@dataclass(frozen=True, eq=False)
class Step:
    """A tare of the driver, or another jump of the zero."""

    #: First cell after the step.
    cell: int
    #: By how much the readings change, N and N m, shape (A,).
    jump: FloatArray
    #: Whether sudden heat is unlikely; without that, the zero may have moved in some other way.
    certain: bool = True


def find_steps(
    readings: FloatArray, states: IntArray, counts: BoolArray, noise: FloatArray, period_s: float
) -> list[Step]:
    """
    Find the steps of a recording, the largest first.

    Readings, N and N m, (K, N, A), are those less the weight of each of K payloads; states, (N,),
    say which one is mounted, and counts, (N,), which cells are free of contact. Noise, N and N m,
    (A,), is the standard deviation of a reading.
    """
    rows = np.flatnonzero(counts)
    if len(rows) < 2 * _LEAST_BESIDE:
        return []
    values = readings[states[rows], rows] / noise
    # Any payload may be mounted where a contact hides it.
    possible = (np.arange(len(readings))[:, np.newaxis] == states) | ~counts
    readings = np.where(possible[..., np.newaxis], readings / noise, np.nan)
    time_s: FloatArray = np.asarray((rows + 0.5) * period_s, dtype=float)
    between_s = (time_s[1:] + time_s[:-1]) / 2
    # A step before reading ``place`` is explained by readings from ``first`` to before ``last``.
    places = np.arange(1, len(time_s))
    first = np.minimum(np.searchsorted(time_s, time_s[:-1] - BESIDE_S), places - _LEAST_BESIDE)
    last = np.maximum(np.searchsorted(time_s, time_s[1:] + BESIDE_S), places + _LEAST_BESIDE)
    first, last = np.maximum(first, 0), np.minimum(last, len(time_s))
    before = _line_ends(time_s, values, first, places, between_s)
    after = _line_ends(time_s, values, places, last, between_s)
    sizes = np.nan_to_num(np.linalg.norm(after - before, axis=1))
    steps: list[Step] = []
    while sizes.max() > SMALLEST_SIGMA:
        at = int(sizes.argmax())
        near = slice(int(first[at]), int(last[at]))
        found = _explain(time_s[near], values[near], at - near.start)
        if found is None:
            sizes[np.abs(between_s - between_s[at]) < BESIDE_S / 4] = 0.0
            continue
        step, level = found
        place = near.start + step.cell
        # What a step leaves beside it is judged when it has been taken out.
        sizes[(first < place) & (place < last)] = 0.0
        # A short press before a step may look like the level after it, so look around, too.
        around = round(BESIDE_S / 4 / period_s)
        begin = max(int(rows[place - 1]) + 1 - around, 0)
        beside = readings[:, begin : rows[place] + around]
        cell = begin + _place(beside, level, level + step.jump)
        steps.append(replace(step, cell=cell, jump=step.jump * noise))
    return steps


def _line_ends(
    time_s: FloatArray, values: FloatArray, begin: IntArray, end: IntArray, at_s: FloatArray
) -> FloatArray:
    """Fit a line to values, (n, A), of each range, and read it at a time, (m,); NaN of two."""
    axes = values.shape[1]
    columns = (np.ones_like(time_s), time_s, time_s**2, values, time_s[:, None] * values)
    sums = np.pad(np.cumsum(np.column_stack(columns), axis=0), ((1, 0), (0, 0)))
    part = sums[end] - sums[begin]
    count = np.where(part[:, 0] >= 3, part[:, 0], np.nan)
    mean_s, mean = part[:, 1] / count, part[:, 3 : 3 + axes] / count[:, None]
    spread = np.maximum(part[:, 2] - count * mean_s**2, 1e-9)
    slope = (part[:, 3 + axes :] - (count * mean_s)[:, None] * mean) / spread[:, None]
    return np.asarray(mean + slope * (at_s - mean_s)[:, None])


def _explain(time_s: FloatArray, values: FloatArray, place: int) -> tuple[Step, FloatArray] | None:
    """
    Explain readings, in units of noise, between place and the next by a step, or give None.

    The level before the step, (A,), stands beside it.
    """
    gap_s = time_s[place + 1] - time_s[place]
    t = time_s - time_s[place] - gap_s / 2
    firsts = np.flatnonzero(np.abs(t) < _HIDING_S + gap_s / 2)
    firsts = firsts[(firsts >= 2) & (firsts <= len(t) - 2)]
    if not len(firsts) or len(t) < 8:
        return None
    steps = np.asarray(np.arange(len(t))[:, None] >= firsts, dtype=float)
    apart_s = float(np.diff(t).min())  # readings may come more seldom than cells
    lags_s = [lag_s for lag_s in _HEAT_S if lag_s >= 2 * apart_s] or [2 * apart_s]
    last_s = t[firsts - 1] + apart_s / 2
    near_heats = _heats(t, np.concatenate((last_s, last_s - 5.0, last_s - 10.0)), lags_s)
    far_s = np.arange(_HIDING_S, BESIDE_S, 10.0)
    far_heats = _heats(t, np.concatenate((t[firsts[0]] - far_s, t[firsts[-1]] + far_s)), lags_s)
    parabola: FloatArray = np.asarray(np.linalg.qr(np.vander(t / BESIDE_S, 3))[0], dtype=float)
    left, steps, near_heats, far_heats = (
        _without(parabola, columns) for columns in (values, steps, near_heats, far_heats)
    )
    first = _best(steps, left)
    step, heat = steps[:, [first]], near_heats[:, [_best(near_heats, left)]]
    (by_step, jump), (by_heat, _) = (_beside_heat(k, far_heats, left) for k in (step, heat))
    evidence = len(t) * np.log(max(by_heat, 1e-9) / max(by_step, 1e-9))
    certain = evidence > _LEAST_EVIDENCE
    hidden = gap_s >= _HIDING_S and evidence > _HIDDEN_EVIDENCE
    smallest = SMALLEST_SIGMA if certain else 4 * SMALLEST_SIGMA if hidden else np.inf
    if np.linalg.norm(jump) < smallest:
        return None
    after = int(firsts[first])
    before = np.flatnonzero(time_s[:after] >= time_s[after - 1] - _HIDING_S)
    return Step(after, jump, bool(certain)), np.median(values[before], axis=0)


def _heats(time_s: FloatArray, onsets_s: FloatArray, lags_s: Sequence[float]) -> FloatArray:
    """Warm up from every onset by every time constant, one column each."""
    since_s = np.maximum(time_s[:, None] - onsets_s, 0.0)
    return np.concatenate([1 - np.exp(-since_s / lag_s) for lag_s in lags_s], axis=1)


def _beside_heat(
    kernel: FloatArray, heats: FloatArray, left: FloatArray
) -> tuple[float, FloatArray]:
    """Sum the squares that a kernel, (n, 1), and the best heat leave; gives its size, (A,)."""
    unit = kernel / max(float(np.linalg.norm(kernel)), 1e-9)
    best = _best(_without(unit, heats), _without(unit, left))
    both = np.concatenate((kernel, heats[:, [best]]), axis=1)
    sizes = np.linalg.lstsq(both, left, rcond=None)[0]
    return float(np.sum((left - both @ sizes) ** 2)), sizes[0]


def _without(basis: FloatArray, values: FloatArray) -> FloatArray:
    """Take what an orthonormal basis explains off columns."""
    return values - basis @ (basis.T @ values)


def _best(kernels: FloatArray, left: FloatArray) -> int:
    """Find the column that explains most of what is left."""
    power = np.sum(kernels**2, axis=0)
    explained = np.sum((kernels.T @ left) ** 2, axis=1)
    return int(np.argmax(np.where(power > 1e-3, explained / np.maximum(power, 1e-3), 0.0)))


def _place(readings: FloatArray, before: FloatArray, after: FloatArray) -> int:
    """
    Find the first cell after a step from one level to another, both (A,).

    Readings, (K, n, A), are in units of noise; of K payloads the one that fits best counts.
    """
    costs = []
    for level in (before, after):
        squares = np.mean((readings - level) ** 2, axis=2)
        square = np.where(np.isnan(squares), 1e9, squares).min(axis=0)
        costs.append(robust_cost(robust_weight(square / WIDTH_SIGMA**2)))
    first, second = (np.concatenate(([0.0], np.cumsum(cost))) for cost in costs)
    return int(np.argmin(first + second[-1] - second))
