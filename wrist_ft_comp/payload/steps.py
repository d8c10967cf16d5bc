"""
Steps that stay and that no payload explains: tares of the driver.

They are found where lines over windows of means before and after do not meet, and located where
the cells go over; heat goes over, too, but leaves a tail. A fit of the drift gets a constant of
its own after each, so that one that is none costs little.
"""

import numpy as np

from wrist_ft_comp.payload.states import TUNING
from wrist_ft_comp.signals import BoolArray, FloatArray, IntArray

#: Lines run over means of so long, s.
MEAN_S = 10.0
#: Lines of so many means on both sides of a step, and how far apart they are by what is usual;
#: what bends is apart by the longer ones only.
_WINDOWS, _STEP, _SMALLEST = (6, 12), 40.0, 12.0
#: The nearer of so many cells that count on either side of a step are apart by this share of it,
#: and of what all of them are, unless no more cells than this hide it.
_NEIGHBOURS, _ALL, _HIDDEN = (6, 90), 0.8, 15
#: Heat has a tail: behind a contact that hides its front, the first of so many cells after it are
#: short of the line through the others by more than this share of the step, and times the noise.
_FIRST, _FOLLOWING, _TAIL, _OF_NOISE = 6, 30, 0.015, 2.0
#: A step's size is found from so many cells before and after.
_NEAR = 90


def means(values: FloatArray, counts: BoolArray, length: int) -> FloatArray:
    """Means (M, A) over so many cells, of those that count; NaN where less than a fifth do."""
    whole = len(values) // length
    counted = counts[: whole * length].reshape(whole, length, 1)
    total = (counted * values[: whole * length].reshape(whole, length, -1)).sum(axis=1)
    number = counted.sum(axis=1)
    return np.asarray(np.where(number > length // 10, total / np.maximum(number, 1), np.nan))


def suspect_steps(
    drift: FloatArray, noise: FloatArray
) -> list[tuple[int, int, FloatArray, FloatArray]]:
    """Find where means (M, A) may step, largest first: before, after, jump (A,) and slope (A,)."""
    there = np.flatnonzero(np.isfinite(drift[:, 0]))
    if len(there) < 4 * _WINDOWS[-1]:
        return []
    at = np.arange(_WINDOWS[-1], len(there) - _WINDOWS[-1])
    lines = [_lines(drift, there, at, window) for window in _WINDOWS]
    size = np.min([np.mean((jump / noise) ** 2, axis=1) for jump, _ in lines], axis=0) ** 0.5
    limit = max(_SMALLEST, _STEP * float(np.median(size)))
    found = []
    while size.max() > limit:
        best = int(size.argmax())
        jump, slope = (each[best] for each in lines[0])
        found.append((int(there[at[best] - 1]), int(there[at[best]]), jump, slope))
        size[max(0, best - _WINDOWS[0]) : best + _WINDOWS[0] + 1] = 0.0
    return found


def _lines(
    drift: FloatArray, there: IntArray, at: IntArray, window: int
) -> tuple[FloatArray, FloatArray]:
    """Jumps between lines through so many means on either side of places, mean slopes, (n, A)."""
    middle = (there[at - 1] + there[at]) / 2
    ends, slopes = [], []
    for offsets in (np.arange(-window, 0), np.arange(window)):
        rows = there[at[:, None] + offsets]
        time = rows - middle[:, None]
        centred = time - time.mean(axis=1, keepdims=True)
        slope = np.einsum('nw,nwi->ni', centred, drift[rows])
        slope /= np.sum(centred**2, axis=1)[:, None]
        ends.append(drift[rows].mean(axis=1) - slope * time.mean(axis=1)[:, None])
        slopes.append(slope)
    return np.asarray(ends[1] - ends[0]), np.asarray(sum(slopes) / 2)


def locate(rest: FloatArray, before: FloatArray, jump: FloatArray, noise: FloatArray) -> int:
    """Find the first cell after a step, counted in rest."""
    # ``rest`` is what each payload leaves, (K, n, A); before, jump and noise (A,) are the level
    # before the step, how far it goes, and the noise of a cell.
    size = np.sqrt(np.sum((jump / noise) ** 2))
    off = (rest - before) / noise
    gone = off @ (jump / noise) / size**2
    aside = np.linalg.norm(off - gone[..., None] * jump / noise, axis=2)
    distance = [np.min(np.hypot(aside, (gone - end) * size), axis=0) for end in (0, 1)]
    width = np.sqrt(len(noise)) * TUNING
    cost = [
        np.concatenate(([0.0], np.cumsum(1 / (1 + (width / np.maximum(each, 1e-9)) ** 2))))
        for each in distance
    ]
    return int(np.argmin(cost[0] + cost[1][-1] - cost[1]))


def settled(
    rest: FloatArray, counts: BoolArray, at: int, step: FloatArray, noise: FloatArray
) -> FloatArray | None:
    """Tell how far (A,) a step goes by cells near it, of (N, A); None where heat may go so far."""
    # Heat goes on behind a contact that hides its front, and lines reach over gaps.
    rows = np.flatnonzero(counts)
    middle = int(np.searchsorted(rows, at))
    if not 0 < middle < len(rows):
        return None
    way: FloatArray = np.column_stack((rest[rows], rows))
    near, around = (
        np.median(way[middle:][:most], axis=0)
        - np.median(way[max(0, middle - most) : middle], axis=0)
        for most in _NEIGHBOURS
    )
    size = float(np.linalg.norm(step / noise))
    along = step / noise**2 / size**2
    gone, stays = (float(each[:-1] @ along) for each in (near, around))
    hidden = rows[middle] - rows[middle - 1] > _HIDDEN
    if stays < 0 or gone < _ALL * (max(1.0, stays) if hidden else 1.0):
        return None
    after = way[middle : middle + _FOLLOWING, :-1] @ along
    short = _short(rows[middle : middle + _FOLLOWING], after)
    if short > max(_TAIL * gone, _OF_NOISE / size):
        return None
    trend = (around - near) / max(1.0, around[-1] - near[-1])
    return np.asarray(near - trend * near[-1])[:-1]


def _short(rows: IntArray, way: FloatArray) -> float:
    """Tell how much the first of some cells are short of the line through the others."""
    if len(rows) <= 2 * _FIRST:
        return 0.0
    line = np.polyfit(rows[_FIRST:], way[_FIRST:], 1)
    return float(np.median(np.polyval(line, rows[:_FIRST]) - way[:_FIRST]))


def step_size(drift: FloatArray, counts: BoolArray, at: int) -> FloatArray:
    """Estimate a step (A,) at a cell from all that count near it, beside a parabola."""
    rows = np.arange(max(0, at - _NEAR), min(len(drift), at + _NEAR))
    rows = rows[counts[rows]]
    share = (rows - at) / _NEAR
    x = np.stack((np.ones(len(rows)), share, share**2, 1.0 * (rows >= at)), axis=1)
    if len(rows) < 20 or not 5 < x[:, 3].sum() < len(rows) - 5:
        return np.zeros(drift.shape[1])
    return np.asarray(np.linalg.lstsq(x, drift[rows], rcond=None)[0][3])
