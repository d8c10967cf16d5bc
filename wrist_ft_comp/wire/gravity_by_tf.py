"""
Transforms read from ``tf2_msgs/TFMessage``, orientations between frames, and gravity by them.

The messages of a publisher differ in their numbers only: those with the same names are alike. For
bags and the running node, ``GravityByTf`` takes transforms as they come. It interpolates between
those of a frame, unless they are too far apart or have ended. Quaternions are x, y, z, w.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.channels import GRAVITY
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.wire import numbers_in_messages
from wrist_ft_comp.wire.cdr import Rows, TF
from wrist_ft_comp.wire.numbers_in_messages import Definitions, Layouts, Place, SEQUENCE

_DEFINITIONS: Definitions = {
    TF: [('transforms', ('TransformStamped', SEQUENCE))],
    'TransformStamped': [
        ('header', ('Header', None)),
        ('child_frame_id', ('string', None)),
        ('translation', ('float64', 3)),
        ('rotation', ('float64', 4)),
    ],
    'Header': [('stamp', ('uint32', 2)), ('frame_id', ('string', None))],
}
#: A rotation is dropped where its squared norm differs from 1 by more.
_NORM_ERROR = 0.1
#: Transforms that are further apart than this leave a gap.
GAP_NS = NANOSECONDS // 2
#: Transforms that are older by this than the newest of their frame are dropped, ns; a stamp that
#: is farther back is the beginning of a new time.
_KEPT_NS = 3 * NANOSECONDS
#: A frame is not waited for any more when its transforms are this far behind the others', ns.
_PATIENCE_NS = 2 * NANOSECONDS
#: Most frames that a node remembers, and most above a frame. Robots have tens, but a sender may
#: make up names for ever.
_MOST_FRAMES = 1000
#: Most names of frames in a message.
_NAMED = 20

#: Of transforms in order of time: stamps, ns, shape (n,), and quaternions, shape (n, 4).
_Columns = tuple[IntArray, FloatArray]
_NONE: _Columns = np.empty(0, np.int64), np.empty((0, 4))


class Transforms(NamedTuple):
    """Transforms of a frame in another: stamps, ns, shape (n,), and rotations, shape (n, 4)."""

    parent: str
    child: str
    stamps_ns: IntArray
    quaternions: FloatArray


@dataclass(frozen=True, eq=False)
class Layout:
    """The transforms in every message that holds the same names."""

    #: Parent and child of every transform, without leading slashes.
    frames: tuple[tuple[str, str], ...]
    #: Where the stamp and the rotation of every transform lie.
    _numbers: tuple[tuple[Place, Place], ...]

    def decode(self, rows: Rows, places: Sequence[int]) -> Iterator[Transforms]:
        """Read the rotations at some places in ``frames`` out of n messages of this layout."""
        for place in places:
            stamps, rotations = (number.values(rows) for number in self._numbers[place])
            usable = np.abs((rotations**2).sum(axis=1) - 1) < _NORM_ERROR
            stamps_ns = stamps[usable].astype(np.int64) @ np.array([NANOSECONDS, 1])
            yield Transforms(*self.frames[place], stamps_ns, rotations[usable])


def tf_layouts() -> Layouts[Layout]:
    """Remember from now on how the messages of a topic's publishers are laid out."""
    return Layouts(_DEFINITIONS, TF, _lay_out, same_texts=True)


def _lay_out(message: numbers_in_messages.Layout) -> Layout:
    """Note the frames of a message, and where its numbers lie."""
    frames, numbers = [], []
    for index in range(message.sizes['transforms',] or 0):
        parent = message.text(('transforms', index, 'header', 'frame_id'))
        child = message.text(('transforms', index, 'child_frame_id'))
        frames.append((parent.strip('/'), child.strip('/')))
        stamp = message.places['transforms', index, 'header', 'stamp']
        numbers.append((stamp, message.places['transforms', index, 'rotation']))
    return Layout(tuple(frames), tuple(numbers))


def _matrices(quaternions: FloatArray) -> FloatArray:
    """Turn quaternions, shape (n, 4), of any norm into rotations, shape (n, 3, 3)."""
    x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def _angle(change: FloatArray) -> FloatArray:
    """Compute the angles of turns, rad, (n,), from what rotations changed by, (n, 3, 3)."""
    # Of a turn by θ, |R' - R| = √8 sin θ/2.
    sine = np.linalg.norm(change, axis=(1, 2)) / np.sqrt(8)
    return np.asarray(2 * np.arcsin(np.minimum(sine, 1)))


class _Link:
    """The transforms of one frame to its parent; of static ones the newest holds for ever."""

    def __init__(self, parent: str, *, static: bool) -> None:
        self.parent, self.static = parent, static
        self.newest_ns, self._columns = -_KEPT_NS, _NONE

    def add(self, stamps_ns: IntArray, quaternions: FloatArray) -> None:
        """Take transforms; where stamps jump back, forget those before. The newest counts."""
        if self.static:
            if stamps_ns[-1] >= self.newest_ns:
                self._columns = stamps_ns[-1:], quaternions[-1:]
        else:
            if stamps_ns[-1] < self.newest_ns - _KEPT_NS:
                self.newest_ns, self._columns = -_KEPT_NS, _NONE
            stamps_ns = np.concatenate((self._columns[0], stamps_ns))
            quaternions = np.concatenate((self._columns[1], quaternions))
            if (np.diff(stamps_ns) <= 0).any():
                _, backwards = np.unique(stamps_ns[::-1], return_index=True)
                stamps_ns, quaternions = stamps_ns[::-1][backwards], quaternions[::-1][backwards]
            self._columns = stamps_ns, quaternions
        self.newest_ns = max(self.newest_ns, int(stamps_ns.max()))

    def forget(self) -> None:
        """Drop what is too old."""
        stamps_ns, quaternions = self._columns
        begin = int(np.searchsorted(stamps_ns, self.newest_ns - _KEPT_NS))
        self._columns = stamps_ns[begin:], quaternions[begin:]

    def at(self, times_ns: IntArray) -> FloatArray:
        """Interpolate rotations at times (n,), shape (n, 3, 3), NaN where they are not known."""
        stamps_ns, quaternions = self._columns
        if self.static:
            return np.broadcast_to(_matrices(quaternions), (len(times_ns), 3, 3))
        before = np.searchsorted(stamps_ns, times_ns, 'right') - 1
        after = np.minimum(before + (stamps_ns[before] != times_ns), len(stamps_ns) - 1)
        gap_ns = stamps_ns[after] - stamps_ns[before]
        known = (before >= 0) & (times_ns <= stamps_ns[-1]) & (gap_ns <= GAP_NS)
        share = ((times_ns - stamps_ns[before]) / np.maximum(gap_ns, 1))[:, np.newaxis]
        begin, end = quaternions[before], quaternions[after]
        end = end * np.where((begin * end).sum(axis=1, keepdims=True) < 0, -1, 1)
        rotations = _matrices(begin + share * (end - begin))
        return np.where(known[:, np.newaxis, np.newaxis], rotations, np.nan)


class GravityByTf:
    """
    Specific force in a lower frame, by its rotation against an upper one whose z is up.

    Leading slashes of names do not count; the lower frame may be set later.
    """

    def __init__(self, upper: str, lower: str = '') -> None:
        self.upper, self.lower = upper, lower
        self._links: dict[str, _Link] = {}
        #: Child frames of all messages, for what ``missing`` says.
        self._others: set[str] = set()
        #: Last time with a known rotation, and that rotation.
        self._last: tuple[IntArray, FloatArray] = np.empty(0, np.int64), np.empty((0, 3, 3))
        #: Whether a static transform has come since that time.
        self._static_came = False
        #: By how much the lower frame turned while transforms were away, or by a static one that
        #: came again, also with another parent, rad.
        self.turned_unseen_rad = 0.0

    def add(self, transforms: Transforms, *, static: bool) -> None:
        """Take transforms of a frame; where some of it moved, static ones do not count."""
        if not len(transforms.stamps_ns):
            return
        child, parent = transforms.child.strip('/'), transforms.parent.strip('/')
        link = self._links.get(child)
        if link is not None and static and not link.static:
            return
        if link is None or (link.parent, link.static) != (parent, static):
            link = self._links[child] = _Link(parent, static=static)
        link.add(transforms.stamps_ns, transforms.quaternions)
        self._static_came |= static

    def needed(self, frames: Sequence[tuple[str, str]], *, static: bool) -> list[int]:
        """
        Choose the transforms of a message that may link the two frames, so that work is bounded.

        Takes parent and child of every transform, without leading slashes, and gives their places.
        Static ones are sent once, and are kept because they may be needed later.
        """
        linking = {*self._chain(self.lower), *self._chain(self.upper)}
        parents = {child: parent for parent, child in frames}
        for frame in tuple(linking):
            above = parents.get(frame)
            while above is not None and above not in linking and len(linking) < _MOST_FRAMES:
                linking.add(above)
                above = parents.get(above)
        if len(self._others) < _MOST_FRAMES:
            self._others.update(parents)
        return [
            place
            for place, (_, child) in enumerate(frames)
            if child in linking
            or (static and (child in self._links or len(self._links) < _MOST_FRAMES))
        ]

    def forget(self) -> None:
        """Drop what is too old, so that memory is bounded."""
        for link in self._links.values():
            link.forget()

    def settled_ns(self) -> int | None:
        """Newest stamp that all moving links have reached, ns; None where nothing moves."""
        lower, upper = self._chain(self.lower), self._chain(self.upper)
        if lower[-1] != upper[-1]:
            return None
        links = [self._links[frame] for frame in set(lower) ^ set(upper)]
        newest = [link.newest_ns for link in links if not link.static]
        return min((n for n in newest if n > max(newest) - _PATIENCE_NS), default=None)

    def root(self) -> str:
        """Name the uppermost frame above the lower one."""
        return self._chain(self.lower)[-1]

    def _chain(self, frame: str) -> list[str]:
        """List a frame and all frames above it."""
        chain = [frame.strip('/')]
        while (link := self._links.get(chain[-1])) and link.parent not in chain:
            chain.append(link.parent)
        return chain

    def rotations(self, times_ns: IntArray) -> FloatArray:
        """Compute rotations from the lower frame to the upper, (n, 3, 3), NaN where unknown."""
        chains = self._chain(self.lower), self._chain(self.upper)
        lower, upper = turned = [np.tile(np.eye(3), (len(times_ns), 1, 1)) for _ in chains]
        if chains[0][-1] != chains[1][-1]:
            return np.full_like(lower, np.nan)
        for rotation, chain, other in zip(turned, chains, reversed(chains), strict=True):
            for frame in chain:
                if frame not in other:  # else both go the same way
                    rotation[:] = self._links[frame].at(times_ns) @ rotation
        return np.swapaxes(upper, 1, 2) @ lower

    def read(self, times_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        """
        Compute specific force, m/s², (n, 3), and speed of rotation, rad/s, (n,); times ascend.

        The speed is the mean since the time before, also of the last call. NaN where not known.
        """
        rotations = self.rotations(times_ns)
        linked = np.isfinite(rotations[:, 0, 0])
        if self._static_came and linked.any() and len(self._last[0]):
            by = _angle(self.rotations(self._last[0]) - self._last[1])
            self.turned_unseen_rad = max(self.turned_unseen_rad, *np.nan_to_num(by).tolist())
        self._static_came &= not linked.any()
        at = np.concatenate((self._last[0], times_ns[linked]))
        turned = np.concatenate((self._last[1], rotations[linked]))
        self._last = at[-1:], turned[-1:]
        angle, steps_ns = _angle(np.diff(turned, axis=0)), np.diff(at).astype(float)
        if (is_away := steps_ns > _PATIENCE_NS).any():
            self.turned_unseen_rad = float(angle[is_away][-1])
        steps_ns[(steps_ns <= 0) | (steps_ns > GAP_NS)] = np.nan
        speed = angle * NANOSECONDS / steps_ns
        speeds = np.full(len(times_ns), np.nan)
        speeds[linked] = np.concatenate(([np.nan], speed))[len(speed) + 1 - linked.sum() :]
        return GRAVITY * rotations[:, 2], speeds

    def missing(self) -> str:
        """Say why the two frames are not linked, and which frames there are."""
        ends = {end for child, link in self._links.items() for end in (child, link.parent)}
        present = sorted(self._others | ends)
        upper, lower = self.upper.strip('/'), self.lower.strip('/')
        what = 'no chain of transforms, without a loop or a gap of half a second, links them'
        if self._chain(lower)[-1] == self._chain(upper)[-1] and self.settled_ns() is None:
            what = 'only static ones link them, as where no joint is published'
        if absent := [name for name in (upper, lower) if name not in present]:
            what = f'{" and ".join(absent)} {"are" if len(absent) > 1 else "is"} missing'
        listed = ', '.join(present[:_NAMED]) or 'none'
        more = f' and {len(present) - _NAMED} more' if len(present) > _NAMED else ''
        return (
            f'TF does not say how {lower} is turned against {upper}: {what}. The frames there '
            f'are: {listed}{more}.'
        )
