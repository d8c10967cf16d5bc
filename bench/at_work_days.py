"""
From days at work to drift that a calibration can learn from: forces, steps, states, observations.

1. An accelerometer is set right by its norm at rest: bias, what temperature adds to it, and scale,
   as far as the directions that were seen tell them apart; the rest stays as it is.
2. Payload states are fitted (``payload``); one more is believed where it explains SHARE more of
   cells that it was not fitted to.
3. A step that stays, and that no payload explains, is a tare of the driver: found where lines over
   WINDOWS cells of 10 s before and after do not meet, and taken out.
4. What is left are readings less weight, NaN where a contact, a fast turn or a change of state
   was, averaged over 10 s, and the weight, for gain drift.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from payload import (
    BLOCK_S,
    Cells,
    explained,
    FASTEST,
    Fit,
    fit_states,
    GRAVITY,
    one_more,
    TUNING,
    unexplained,
)
from working_days import WorkDay
from world_peers import block_means, Day

from wrist_ft_comp.model.signals import BoolArray, FloatArray, IntArray

MEAN_S = 10
#: Standing still, rad/s; what is expected of accelerometers: bias, m/s², per kelvin, and scale.
#: A specific force that does not change at all for so long, s, is no longer measured.
FROZEN_S = 1200
STILL, BIAS, PER_KELVIN, SCALE = 0.03, 0.3, 0.01, 0.03
#: Noise of a norm that is taken as independent, m/s², so that slow errors count for what they are.
NORM_NOISE = 0.2
#: Lines of so many means on both sides of a step, and how far apart they are by what is usual;
#: what bends is apart by the longer ones only.
WINDOWS, STEP, SMALLEST = (6, 12), 40.0, 12.0
#: A step is sudden: so many cells may be on the way, this share of it off its ends.
BLURRED, ON_THE_WAY, MOST_STEPS = 0.1, 3, 20
#: Most payloads, and the share of cells not fitted to that another one has to explain.
#: Two states that weigh the same up to this share are one.
MOST, SHARE, ALIKE = 4, 0.02, 0.03
#: A cell counts for drift where its weight is above this.
COUNTS = 0.5


@dataclass(frozen=True, eq=False)
class Observed:
    """What days at work say: drift and weight as Days, payloads, steps and shares of cells."""

    days: list[Day]
    fit: Fit
    cells: Cells
    steps: list[list[tuple[int, FloatArray]]]
    #: Covariance of the scale that is left in the specific force's axes, relative, (3, 3).
    scale: FloatArray


def level_forces(days: Sequence[WorkDay]) -> tuple[list[FloatArray], FloatArray]:
    """Set accelerometers right by their norm at rest, (N, 3) per day; and Observed.scale."""
    force = np.concatenate([day.force for day in days])
    known = np.isfinite(force).all(axis=1)
    known &= ~np.concatenate([frozen(day.force) for day in days])
    temperature_c = np.concatenate([day.temperature_c for day in days])
    theta = temperature_c - temperature_c.mean(axis=0)
    still = known & (np.concatenate([day.spin for day in days]) < STILL)
    force = np.where(known[:, None], force, [0, 0, GRAVITY])
    force = force * (GRAVITY / np.median(np.linalg.norm(force[still], axis=1)))
    widths = np.repeat([BIAS, SCALE, *[PER_KELVIN] * theta.shape[1]], 3)
    prior = np.diag(widths**2)
    prior[3:6, 3:6] = SCALE**2 * (np.eye(3) + 1) / 2
    found, covariance = np.zeros(len(prior)), prior
    weights = 1.0 * still
    for _ in range(6):
        bias, scale, drift = found[:3], found[3:6], found[6:].reshape(-1, 3)
        right = (force - bias - theta @ drift) * (1 - scale)
        norm = np.linalg.norm(right, axis=1, keepdims=True)
        n = right / norm
        x = np.concatenate(
            (n, GRAVITY * n**2, *(n * theta[:, [j]] for j in range(theta.shape[1]))), axis=1
        )
        y = norm[:, 0] - GRAVITY + x @ found
        normal = (x * weights[:, None]).T @ x / NORM_NOISE**2 + np.linalg.inv(prior)
        covariance = np.linalg.inv(normal)
        found = covariance @ (x.T @ (weights * y)) / NORM_NOISE**2
        error = np.abs(y - x @ found)
        weights = still / (1 + (error / (4 * max(0.005, np.median(error[still])))) ** 2) ** 2
    ends = np.cumsum([len(day.force) for day in days])[:-1]
    bias, scale, drift = found[:3], found[3:6], found[6:].reshape(-1, 3)
    right = np.where(known[:, None], (force - bias - theta @ drift) * (1 - scale), np.nan)
    return np.split(right, ends), covariance[3:6, 3:6]


def frozen(force: FloatArray) -> BoolArray:
    """Tell where a specific force (N, 3) stands still to the last digit for FROZEN_S."""
    changes = np.append(True, np.any(np.diff(force, axis=0) != 0, axis=1))
    runs = np.cumsum(changes) - 1
    return np.asarray(np.bincount(runs)[runs] >= FROZEN_S)


def cells_of(days: Sequence[WorkDay], forces: Sequence[FloatArray]) -> Cells:
    """Cut days into blocks, the last of a day filled up with cells that are not used."""

    def cut(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
        blocks = []
        for part in parts:
            short = -len(part) % BLOCK_S
            filled = np.concatenate((part, np.zeros((short, *part.shape[1:]), part.dtype)))
            blocks.append(filled.reshape(-1, BLOCK_S, *part.shape[1:]))
        return np.concatenate(blocks)

    usable = [
        np.isfinite(day.wrench).all(axis=1) & np.isfinite(f).all(axis=1) & (day.spin < FASTEST)
        for day, f in zip(days, forces, strict=True)
    ]
    wrench = [np.where(u[:, None], day.wrench, 0) for day, u in zip(days, usable, strict=True)]
    force = [np.where(u[:, None], f, 0) for f, u in zip(forces, usable, strict=True)]
    return Cells(cut(wrench), cut(force), cut(usable))


def joined(days: Sequence[WorkDay], blocks: NDArray[Any]) -> list[NDArray[Any]]:
    """Undo cells_of for one array of blocks: a part per day."""
    parts, at = [], 0
    for day in days:
        count = -(-len(day.wrench) // BLOCK_S)
        part = blocks[at : at + count].reshape(-1, *blocks.shape[2:])
        parts.append(part[: len(day.wrench)])
        at += count
    return parts


def believed(cells: Cells) -> Fit:
    """Fit as many states as explain blocks that they were not fitted to, and then all blocks."""
    odd = np.arange(len(cells.wrench)) % 2 == 1
    learnt, held = cells.part(~odd), cells.part(odd)
    fit = fit_states(learnt, np.zeros(learnt.usable.shape, dtype=np.int64), 1)
    while len(fit.gains) < MOST:
        more = one_more(learnt, fit)
        noise = np.minimum(fit.noise, more.noise)
        gained = unexplained(held, fit, noise) - unexplained(held, more, noise)
        if gained < SHARE or nearest(more.gains) < ALIKE:
            break
        fit = more
    return fit


def nearest(gains: FloatArray) -> float:
    """Tell how far the two states that are most alike are apart, as a share of their weight."""
    return min(
        float(np.linalg.norm(a[:, :3] - b[:, :3]) / np.linalg.norm(a[:, :3]))
        for a, b in combinations(gains, 2)
    )


def means(values: FloatArray, counts: BoolArray) -> FloatArray:
    """Means of 10 s over cells that count, NaN below two of them."""
    number = block_means(counts[:, None].astype(float), MEAN_S) * MEAN_S
    total = block_means(np.where(counts[:, None], values, 0), MEAN_S) * MEAN_S
    return np.asarray(np.where(number > 1, total / np.maximum(number, 1), np.nan))


def find_steps(drift: FloatArray, noise: FloatArray) -> list[tuple[int, int, FloatArray]]:
    """Find where a day's means (M, 6) may step, largest first: means before and after, jump."""
    there = np.flatnonzero(np.isfinite(drift[:, 0]))
    if len(there) < 4 * WINDOWS[-1]:
        return []
    at = np.arange(WINDOWS[-1], len(there) - WINDOWS[-1])
    jumps = [jumps_of(drift, there, at, window) for window in WINDOWS]
    size = np.min([np.mean((jump / noise) ** 2, axis=1) for jump in jumps], axis=0) ** 0.5
    limit = max(SMALLEST, STEP * float(np.median(size)))
    found = []
    while size.max() > limit:
        best = int(size.argmax())
        found.append((int(there[at[best] - 1]), int(there[at[best]]), jumps[0][best]))
        size[max(0, best - WINDOWS[0]) : best + WINDOWS[0] + 1] = 0.0
    return found


def jumps_of(drift: FloatArray, there: IntArray, at: IntArray, window: int) -> FloatArray:
    """Jumps between lines through so many means before and after every place, (n, 6)."""
    middle = (there[at - 1] + there[at]) / 2
    ends = []
    for offsets in (np.arange(-window, 0), np.arange(window)):
        rows = there[at[:, None] + offsets]
        time = rows - middle[:, None]
        centred = time - time.mean(axis=1, keepdims=True)
        slope = np.einsum('nw,nwi->ni', centred, drift[rows])
        slope /= np.sum(centred**2, axis=1)[:, None]
        ends.append(drift[rows].mean(axis=1) - slope * time.mean(axis=1)[:, None])
    return np.asarray(ends[1] - ends[0])


def locate(
    rest: FloatArray, before: FloatArray, jump: FloatArray, noise: FloatArray
) -> int | None:
    """
    Find the first cell after a step, or None where heat would do: not at once.

    Parameters
    ----------
    rest : ndarray, shape (K, n, 6)
        What each payload leaves.
    before, jump, noise : ndarrays, shape (6,)
        Level before the step, how far it goes, and noise of a cell.

    """
    size = np.sqrt(np.sum((jump / noise) ** 2))
    off = (rest - before) / noise
    gone = off @ (jump / noise) / size**2
    aside = np.linalg.norm(off - gone[..., None] * jump / noise, axis=2)
    distance = [np.min(np.hypot(aside, (gone - end) * size), axis=0) for end in (0, 1)]
    width = np.sqrt(6) * TUNING
    cost = [
        np.concatenate(([0.0], np.cumsum(1 / (1 + (width / np.maximum(each, 1e-9)) ** 2))))
        for each in distance
    ]
    at = int(np.argmin(cost[0] + cost[1][-1] - cost[1]))
    between = (gone > BLURRED) & (gone < 1 - BLURRED) & (aside < 3 * BLURRED * size)
    end = max(width, BLURRED * size)
    earlier, later = np.flatnonzero(distance[0][:at] < end), np.flatnonzero(distance[1][at:] < end)
    first = int(earlier[-1]) + 1 if len(earlier) else 0
    last = at + int(later[0]) if len(later) else len(aside[0])
    return at if between.any(axis=0)[first:last].sum() <= ON_THE_WAY else None


def refined(
    drift: FloatArray, counts: BoolArray, at: int, jump: FloatArray, near: int = 90
) -> FloatArray:
    """Estimate a step at a cell from all that count near it, between parabolas."""
    rows = np.arange(max(0, at - near), min(len(drift), at + near))
    rows = rows[counts[rows]]
    share = (rows - at) / near
    x = np.stack((np.ones(len(rows)), share, share**2, 1.0 * (rows >= at)), axis=1)
    if len(rows) < 20 or not 5 < x[:, 3].sum() < len(rows) - 5:
        return jump
    return np.asarray(np.linalg.lstsq(x, drift[rows], rcond=None)[0][3])


def weightless(day: FloatArray, force: FloatArray, gains: FloatArray) -> FloatArray:
    """Take what each payload weighs from readings, (K, N, 6)."""
    return np.asarray(day - force @ gains)


def observe(days: Sequence[WorkDay]) -> Observed:
    """Separate payload, contacts, steps and drift of days at work."""
    forces, scale = level_forces(days)
    wrenches = [day.wrench.copy() for day in days]
    steps: list[list[tuple[int, FloatArray]]] = [[] for _ in days]
    cells = cells_of(days, forces)
    fit = believed(cells)
    fit = fit_states(
        cells, explained(cells, fit.gains, fit.noise).states, len(fit.gains), rounds=12
    )
    while True:
        states, weights = joined(days, fit.states), joined(days, fit.weights)
        found = 0
        for n, wrench in enumerate(wrenches):
            each = weightless(wrench, forces[n], fit.gains)
            drift = each[states[n], np.arange(len(wrench))]
            averaged = means(drift, weights[n] > COUNTS)
            for before, after, jump in find_steps(averaged, fit.noise):
                first = max(0, before - 1) * MEAN_S
                rest = each[:, first : (after + 2) * MEAN_S]
                at = locate(rest, averaged[before], jump, fit.noise)
                if at is not None and len(steps[n]) < MOST_STEPS:
                    wrench[first + at :] -= jump
                    steps[n].append((first + at, jump))
                    found += 1
        new = [replace(day, wrench=wrench) for day, wrench in zip(days, wrenches, strict=True)]
        cells = cells_of(new, forces)
        if not found:
            break
        fit = fit_states(cells, fit.states, len(fit.gains), rounds=8)
    observed = []
    for n, (day, wrench) in enumerate(zip(days, wrenches, strict=True)):
        each = weightless(wrench, forces[n], fit.gains)
        counts = weights[n] > COUNTS
        drift = each[states[n], np.arange(len(wrench))]
        for at, _ in steps[n]:
            drift[at:] -= refined(drift, counts, at, np.zeros(6))
        load = wrench - each[states[n], np.arange(len(wrench))]
        temperature_c = block_means(day.temperature_c, MEAN_S)
        observed.append(Day(temperature_c, means(drift, counts), means(load, counts), MEAN_S))
    return Observed(observed, fit, cells, steps, scale)
