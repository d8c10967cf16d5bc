"""
Orientations between frames by their transforms, and what gravity makes of them.

Bags and the running node ask the same: ``GravityByTf`` takes transforms as they come and gives
specific force in the lower of two frames, where z of the upper one is up. Between the transforms
of a frame orientations are interpolated; nothing is known where these are too far apart, or have
ended. Quaternions are x, y, z, w as in messages; those of P frames at n stamps have shape (n, 4).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from wrist_ft_comp.model.signals import BoolArray, FloatArray, GRAVITY, IntArray, NANOSECONDS

#: Transforms that are further apart than this leave a gap.
GAP_NS = NANOSECONDS // 2
#: As much of every frame is kept behind its newest transform; a jump further back is a new start.
_KEPT_NS = 3 * NANOSECONDS
#: A frame whose transforms are this far behind others' is waited for no longer.
_PATIENCE_NS = 2 * NANOSECONDS
#: So many different static transforms of one frame are kept.
_STATIC = 100
#: The squared norm of a rotation is off from 1 by less.
_NORM_ERROR = 0.1


@dataclass(frozen=True, eq=False)
class Transforms:
    """Transforms of one frame in another: stamps, ns, shape (n,), and rotations, shape (n, 4)."""

    parent: str
    child: str
    stamps_ns: IntArray
    rotations: FloatArray


def _product(first: FloatArray, second: FloatArray) -> FloatArray:
    """Multiply quaternions, shapes (n, 4)."""
    x, y, z, w = first.T
    i, j, k, m = second.T
    return np.stack(
        (
            w * i + x * m + y * k - z * j,
            w * j - x * k + y * m + z * i,
            w * k + x * j - y * i + z * m,
            w * m - x * i - y * j - z * k,
        ),
        axis=1,
    )


#: Of transforms in order of time: stamps, ns, numbers of the parents, rotations.
_Columns = tuple[IntArray, IntArray, FloatArray]
_NONE: _Columns = np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 4))


class _Link:
    """The transforms of one frame, also of one whose parent changes; static ones hold."""

    def __init__(self, *, static: bool) -> None:
        self.static = static
        #: Of the newest transform.
        self.newest_ns, self.parent = -_KEPT_NS, -1
        self._columns: _Columns = _NONE
        self._new: list[_Columns] = []

    def add(self, parent: int, stamps_ns: IntArray, rotations: FloatArray) -> None:
        """Take transforms to a parent; a jump of the stamps back begins anew."""
        if not self.static and stamps_ns[-1] < self.newest_ns - _KEPT_NS:
            self._new, self._columns, self.newest_ns = [], _NONE, -_KEPT_NS
        self._new.append((stamps_ns, np.full(len(stamps_ns), parent), rotations))
        if stamps_ns[-1] >= self.newest_ns:
            self.newest_ns, self.parent = int(stamps_ns[-1]), parent

    def sort(self) -> None:
        """Sort in what came; of transforms with one stamp the newest counts."""
        if self._new:
            every = [np.concatenate(each) for each in zip(self._columns, *self._new, strict=True)]
            _, backwards = np.unique(every[0][::-1], return_index=True)
            order = len(every[0]) - 1 - backwards
            stamps_ns, parents, rotations = (each[order] for each in every)
            self._columns, self._new = (stamps_ns, parents, rotations), []

    def forget(self) -> None:
        """Drop what is too old."""
        self.sort()
        begin = np.searchsorted(self._columns[0], self.newest_ns - _KEPT_NS)
        keep = slice(-_STATIC, None) if self.static else slice(int(begin), None)
        stamps_ns, parents, rotations = self._columns
        self._columns = stamps_ns[keep], parents[keep], rotations[keep]

    def at(self, times_ns: IntArray) -> tuple[IntArray, FloatArray]:
        """Tell parents, -1 where there is none, and rotations, shape (n, 4), at some times."""
        self.sort()
        stamps_ns, parents, rotations = self._columns
        last = len(stamps_ns) - 1
        before = np.searchsorted(stamps_ns, times_ns, 'right') - 1
        if self.static:  # the first one holds from the beginning, however late it came
            before = np.maximum(before, 0)
            return parents[before], rotations[before]
        after = np.minimum(before + (stamps_ns[before] != times_ns), last)
        gap_ns = stamps_ns[after] - stamps_ns[before]
        known = (before >= 0) & (times_ns <= stamps_ns[last]) & (gap_ns <= GAP_NS)
        known &= parents[before] == parents[after]
        share = ((times_ns - stamps_ns[before]) / np.maximum(gap_ns, 1))[:, np.newaxis]
        begin, end = rotations[before], rotations[after]
        end = end * np.where((begin * end).sum(axis=1, keepdims=True) < 0, -1, 1)
        between = begin + share * (end - begin)
        between /= np.linalg.norm(between, axis=1, keepdims=True)
        return np.where(known, parents[before], -1), between


class GravityByTf:
    """
    Specific force in a frame, of which it is known how it is turned against one with z upwards.

    Names of frames count without leading slashes.
    """

    def __init__(self, upper: str, lower: str) -> None:
        self._numbers: dict[str, int] = {}
        self._links: dict[int, _Link] = {}
        self._upper = upper
        #: May be known only later.
        self.lower = lower
        #: Time and rotation that were told last.
        self._last: tuple[IntArray, FloatArray] = np.empty(0, np.int64), np.empty((0, 4))

    def _number(self, frame: str) -> int:
        """Find a frame's number."""
        return self._numbers.setdefault(frame.strip('/'), len(self._numbers))

    def add(self, transforms: Transforms, *, static: bool) -> None:
        """Take transforms of a frame; where some of it moved, static ones do not count."""
        child, parent = self._number(transforms.child), self._number(transforms.parent)
        known = np.abs((transforms.rotations**2).sum(axis=1) - 1) < _NORM_ERROR
        link = self._links.get(child)
        if not known.any() or (link is not None and static and not link.static):
            return
        if link is None or link.static != static:
            link = self._links[child] = _Link(static=static)
        link.add(parent, transforms.stamps_ns[known], transforms.rotations[known])

    def forget(self) -> None:
        """Drop what is too old, so that memory is bounded."""
        for link in self._links.values():
            link.forget()

    def settled_ns(self) -> int | None:
        """Tell up to when all is there that is to come; None where nothing moves."""
        path = self._path(lambda frame: self._links[frame].parent)
        links = [self._links[frame] for side in path or () for frame in side[:-1]]
        newest = [link.newest_ns for link in links if not link.static]
        return min((n for n in newest if n > max(newest) - _PATIENCE_NS), default=None)

    def _path(self, parent_of: Callable[[int], int]) -> tuple[list[int], list[int]] | None:
        """Find the ways from the lower and the upper frame to one above both; None if none is."""
        ways = []
        for frame in (self.lower, self._upper):
            way = [self._number(frame)]
            while way[-1] in self._links:
                parent = parent_of(way[-1])
                if parent < 0 or parent in way:
                    break
                way.append(parent)
            ways.append(way)
        lower, upper = ways
        shared = next((frame for frame in lower if frame in upper), None)
        if shared is None:
            return None
        return lower[: lower.index(shared) + 1], upper[: upper.index(shared) + 1]

    def _rotations(self, times_ns: IntArray) -> FloatArray:
        """Turn from the lower frame to the upper one, shape (n, 4), NaN where it is not known."""
        found = np.full((len(times_ns), 4), np.nan)
        left: IntArray = np.arange(len(times_ns))
        while len(left):
            first = times_ns[left[:1]]
            path = self._path(lambda frame: int(self._links[frame].at(first)[0][0]))  # noqa: B023
            if path is None:
                left = left[1:]
                continue
            # Times at which the frames hang together like this are turned at once.
            alike = np.ones(len(left), bool)
            lower, upper = (self._climb(way, times_ns[left], alike) for way in path)
            turned = _product(upper * [-1, -1, -1, 1], lower)
            found[left[alike]] = turned[alike]
            left = left[~alike]
        return found

    def _climb(self, way: Sequence[int], times_ns: IntArray, alike: BoolArray) -> FloatArray:
        """Turn from the first frame of a way to its last; marks where this is not the way."""
        turned = np.tile([0.0, 0.0, 0.0, 1.0], (len(times_ns), 1))
        for frame, parent in pairwise(way):
            parents, rotations = self._links[frame].at(times_ns)
            alike &= parents == parent
            turned = _product(rotations, turned)
        return turned

    def read(self, times_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        """
        Tell specific force, m/s², shape (n, 3), and speed of rotation, rad/s, at ascending times.

        The speed is the mean since the time before, also of the last call. NaN where not known.
        """
        rotations = self._rotations(times_ns)
        x, y, z, w = rotations.T
        up = np.stack((2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)), axis=1)
        known = np.isfinite(w)
        at = np.concatenate((self._last[0], times_ns[known]))
        turned = np.concatenate((self._last[1], rotations[known]))
        self._last = at[-1:], turned[-1:]
        change = _product(turned[:-1] * [-1, -1, -1, 1], turned[1:])
        angle = 2 * np.arctan2(np.linalg.norm(change[:, :3], axis=1), np.abs(change[:, 3]))
        steps_ns = np.diff(at)
        near = (steps_ns > 0) & (steps_ns <= GAP_NS)
        speed = np.where(near, angle * NANOSECONDS / np.maximum(steps_ns, 1), np.nan)
        speeds = np.full(len(times_ns), np.nan)
        speeds[known] = np.concatenate((np.full(known.sum() - len(speed), np.nan), speed))
        return GRAVITY * up, speeds

    def missing(self) -> str:
        """Say that nothing came of it, and which frames there are."""
        names = list(self._numbers)
        upper, lower = self._upper.strip('/'), self.lower.strip('/')
        there = {names[child] for child in self._links}
        there |= {names[link.parent] for link in self._links.values()}
        absent = [name for name in (upper, lower) if name not in there]
        what = (
            f'{" and ".join(absent)} {"are" if len(absent) > 1 else "is"} missing'
            if absent
            else 'no chain of transforms, without a loop or a gap of half a second, links them'
        )
        return (
            f'TF does not say how {lower} is turned against {upper}: {what}. The frames there '
            f'are: {", ".join(sorted(there)) or "none"}.'
        )
