"""
Whether the wrench moves with the weight that is taken off: finds frames and units that are wrong.

Where a robot turns its tool in free space, the wrench changes as the weight does: ΔF = ΔW. A
specific force or a wrench whose frame is turned by Q, or in another unit, gives ΔF = k Q ΔW, one
whose origin has moved by d gives ΔT = ΔT_weight + d × ΔW. Contacts change the wrench, too, but
not in the same way in half of six poses: k Q is that of the three changes which agree best with
half of all (least median of squares), unless a quarter of all moves as the weight does.

Where neither fits, the weight of the payload shows by its size: forces of free space lie on a
sphere of that radius. Specific force then is that of another orientation.

What is left of the force without the weight shows whether wrench_external was tared with that
payload, or another one was on.
"""

from collections import deque
from collections.abc import Iterable
import math

import numpy as np

from wrist_ft_comp.series import BoolArray, FloatArray, IntArray, ROUNDING

#: The weight has changed where its force differs by this, N: seven times the noise of common
#: sensors, 0.3 N.
_MOVED_N = 2.0
#: Changes that are kept, and fewest that say something.
_KEPT, _FEWEST = 24, 14
#: Fewer poses than this say nothing, where a process presses in one of them in each cycle.
_FEWEST_POSES = 6
#: A force against the weight, or aside, shows in smaller steps: how large, N, and how many.
_LOOK_N, _LOOKS = 0.7, 16
#: Bounds of its share along the weight, of its size beside it, and of what one turn leaves.
_ALONG_SHARE, _AS_LARGE, _TURN_REST = 0.3, 0.7, 0.15
#: Triples of changes that are tried.
_TRIPLES = 40
#: Where this share of the newest changes is that of the weight, in three directions, contacts make
#: the others.
_AS_WEIGHT = 0.25
#: A smaller turn is none, degrees: an IMU that a person mounts is right within 3. A force that is
#: larger or smaller than the weight by more than this share of it is that of another payload.
_LEAST_TURN_DEG, _ANOTHER_SHARE = 8.0, 0.07
#: Of heavy payloads, smaller ones are said that make this much of wrench_external wrong, N; but
#: none that ~/identify_payload may leave, degrees, or share.
_MOST_OFF_N, _LEARNT_DEG, _LEARNT_SHARE = 3.0, 3.0, 0.03
#: In a swing, TF lacks an acceleration that looks like a smaller turn, degrees.
_FAR_DEG = 45.0
#: Forces that are kept, and how many differ; five times in a row, this share of those lies on the
#: sphere of a weight, within this share of its radius.
_FORCES, _DIRECTIONS, _IN_A_ROW, _ON_SPHERE, _THICK = 14, 9, 5, 0.8, 0.02
#: A force that moves by less than this share of the weight is that of an empty sensor.
_MOUNTED_SHARE = 0.2
#: Motion is what the weight changes by in this time, s, if it is more than this, N.
LAG_STEP_S, _LEAST_MOTION_N = 0.1, 0.1
#: A lag is said when this many looks in motion show it, this share of them as late, or as early,
#: and when it makes this share of the weight wrong.
_MOTIONS, _SAME_SIGN, _WRONG_SHARE = 16, 0.9, 0.05
#: A lag leaves less than this share of the force, in the median: friction leaves more.
_LAG_REST = 0.6
#: A smaller distance is none, m.
_LEAST_SHIFT_M = 0.01
#: What is found must explain all but this share of the median difference.
_UNEXPLAINED_SHARE = 0.4
#: When a payload becomes active after a tare without one, its weight has to show within this, s.
_SHOWN_S = 10.0
#: After a right tare, a free force differs from the weight by less than this, N, or this share of
#: the weight. A tare is certain after this many directions in which it was so.
_NEAR_N, _NEAR_SHARE, _PROOFS = 1.0, 0.05, 3
#: So many exchanges of payloads show which way the weight goes.
_EXCHANGES = 6
#: A proven tare is doubted where it was never near for this time, s: tools press for less.
_PRESSED_S = 600.0


class WeightCheck:
    """Compares changes of the corrected wrench with those of the weight of a payload, by name."""

    def __init__(self, name: str = '') -> None:
        #: How the wrench moves otherwise than the weight, in a sentence; '' where it does not.
        self.found = ''
        #: Whether that is mirrored or turned by far, which no swing of the robot looks like.
        self.is_far = False
        #: Whether changes of _LOOK_N showed that, so that they may show that it is mended.
        self._by_looks = False
        self._name = name
        self._before: FloatArray | None = None
        self._changes: deque[FloatArray] = deque(maxlen=_KEPT)
        #: The weights before and after these changes, N.
        self._poses: deque[FloatArray] = deque(maxlen=_KEPT)
        #: Forces and weights between which the force changed, N, (2, 3) each.
        self._moves: deque[FloatArray] = deque(maxlen=_FORCES)
        #: Forces and weights between which the weight changed by less, N, (2, 3) each.
        self._looks: deque[FloatArray] = deque(maxlen=_LOOKS)
        #: How much oftener the torque showed another centre of mass than not: a contact may.
        self._shifted = 0
        #: How often in a row moves showed a weight that turns otherwise than specific force says.
        self._alone = 0

    def begin(self) -> None:
        """Begin anew after another payload was mounted: the change to it is not one of a pose."""
        self._before = None
        self._moves.clear()
        self._looks.clear()

    def add(self, wrench: FloatArray, weight: FloatArray) -> None:
        """Take a wrench before the payload is taken off, and the weight, N and N m, (6,) each."""
        now = np.stack((wrench, weight))
        if not self._looks or np.linalg.norm(now[1, :3] - self._looks[-1][1]) >= _LOOK_N:
            self._looks.append(now[:, :3])
        if not self._moves or np.linalg.norm(now[0, :3] - self._moves[-1][0]) >= _MOVED_N:
            self._moves.append(now[:, :3])
            self._alone = self._alone + 1 if self._turns_alone() else 0
        against = self._is_against()
        if not self.found and (self._alone >= _IN_A_ROW or against):
            self._by_looks = bool(against)
            self.found = (
                f'the force turns as the weight of {self._name} does, but specific force is '
                'mirrored, turned otherwise, or stands still: is z of gravity.frame up, does /tf, '
                'or the IMU, show how the robot moves now, or does a process press?'
            )
        elif self._by_looks and against is False:  # _compare never judges a light weight
            self.found, self._by_looks = '', False
        if self._before is None:
            self._before = now
            self._poses.append(weight[:3])
        change = now - self._before
        if np.linalg.norm(change[1, :3]) >= _MOVED_N:
            self._before = now
            self._changes.append(change)
            self._poses.append(weight[:3])
            if len(self._changes) >= _FEWEST and (found := self._compare()) is not None:
                self.found, self._by_looks = found, False

    def _turns_alone(self) -> bool:
        """Whether the force moves on the sphere of the weight, but not as the weight."""
        forces, weights = np.array(self._moves).swapaxes(0, 1)
        points = distinct(forces)
        if len(points) < _DIRECTIONS:
            return False
        moved = np.diff(forces, axis=0)
        rests = np.linalg.norm(moved - np.diff(weights, axis=0), axis=1)
        is_apart = rests > np.radians(_LEAST_TURN_DEG) * np.linalg.norm(moved, axis=1)
        if is_apart.mean() < 1 - _AS_WEIGHT:
            return False
        fours = points[_draws(4, len(points))]
        # Of four points, those less the first: 2 (p - q) · center = p² - q².
        rows, squares = 2 * (fours[:, 1:] - fours[:, :1]), np.sum(fours**2, axis=2)
        centers = np.linalg.pinv(rows) @ (squares[:, 1:] - squares[:, :1])[..., np.newaxis]
        distances = np.linalg.norm(points - centers.swapaxes(1, 2), axis=2)
        radius_n = np.median(np.linalg.norm(weights, axis=1))
        best = max(np.abs(distances / radius_n - 1) < _THICK, key=np.mean)
        if best.mean() < _ON_SPHERE:
            return False
        # One circle, as of the friction of a sander, lies on spheres of every larger radius; that
        # of a weight, where the tare was right, on the one around zero, and that of a turn about
        # a level axis, whatever the tare, is one of the radius itself.
        apart = points[best] - points[best].mean(axis=0)
        _, spread, directions = np.linalg.svd(apart)
        flat = apart @ directions[:2].T
        rows = np.column_stack((2 * flat, np.ones(len(flat))))
        *center, rest = np.linalg.lstsq(rows, np.sum(flat**2, axis=1), rcond=None)[0]
        circle_n = np.sqrt(max(rest + np.sum(np.square(center)), 0.0))
        around_zero = np.abs(np.linalg.norm(points[best], axis=1) / radius_n - 1) < _THICK
        is_of_weight = abs(circle_n / radius_n - 1) < _THICK or around_zero.mean() >= _ON_SPHERE
        return bool(spread[-1] >= _MOVED_N or is_of_weight)

    def _is_against(self) -> bool | None:
        """
        Whether the force moves against the weight, or aside, though it is as large.

        False where it moves as the weight does, None where looks do not tell.
        """
        if len(self._looks) < _LOOKS:
            return None
        force, weight = np.swapaxes(self._looks - np.mean(self._looks, axis=0), 0, 1)
        if len(distinct(weight, _LOOK_N)) < _FEWEST_POSES:
            return None
        reach, size = np.linalg.norm(weight), np.linalg.norm(force)
        (turn,) = _fit_turns(force[None], weight[None])
        limit_n = _TURN_REST * reach / np.sqrt(_LOOKS)
        follows, turns = (
            bool(np.linalg.norm(force - moved, axis=1).max() < limit_n)
            for moved in (weight, weight @ turn.T)
        )
        is_as_large = _AS_LARGE * reach < size < reach / _AS_LARGE
        is_turned = np.sum(force * weight) < _ALONG_SHARE * reach**2
        if turns and is_as_large and is_turned:
            return True
        return False if follows else None

    def _compare(self) -> str | None:
        """Say what the changes that are kept show; None where they do not tell."""
        if len(distinct(self._poses)) < _FEWEST_POSES:
            return None
        self.is_far, changes = False, np.array(self._changes)
        changes = changes[_are_free(changes[:, 0, :3], changes[:, 1, :3])]
        if len(changes) < _FEWEST / 2:
            return None
        force, weight = changes[:, 0, :3], changes[:, 1, :3]
        (turn,) = _fit_turns(force[None], weight[None])
        # Between two poses, a turn cannot be told from a contact in one of them; in one plane, a
        # mirror cannot be seen.
        _, spread, directions = np.linalg.svd(weight)
        beside_n = np.linalg.norm(weight @ directions[1:].T, axis=1)
        is_line = np.sum(beside_n >= _MOVED_N) < _FEWEST / 2
        if is_line:
            turn = np.eye(3) * np.sum(force * weight) / np.sum(weight**2)
        elif spread[2] < _MOVED_N and np.linalg.det(turn) < 0:
            turn = turn @ (np.eye(3) - 2 * np.outer(directions[2], directions[2]))
        scale = float(np.cbrt(np.linalg.det(turn)))
        off_n = np.median(np.linalg.norm(force - weight, axis=1))
        rest = np.median(np.linalg.norm(force - weight @ turn.T, axis=1))
        reach = np.median(np.linalg.norm(weight, axis=1))
        share = _MOST_OFF_N / float(np.median(np.linalg.norm(self._poses, axis=1)))
        least_deg = np.clip(np.degrees(share), _LEARNT_DEG, _LEAST_TURN_DEG)
        limit_n = np.radians(_LEAST_TURN_DEG) * reach
        # Half of it: where the weight points along the axis of a turn it does not move.
        if off_n > np.radians(least_deg) * reach / 2 and rest < _UNEXPLAINED_SHARE * off_n:
            if abs(scale) < _MOUNTED_SHARE:
                return (
                    f'the force hardly moves with the weight of {self._name}; is it mounted? Set '
                    'payload.active to what is, or check the unit of the wrench'
                )
            cosine = (np.trace(turn) / scale - 1) / 2
            turn_deg = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
            is_turned = turn_deg > least_deg
            self.is_far = scale < 0 or turn_deg > _FAR_DEG
            if scale < 0 or is_turned:
                how = f'mirrored or turned, by {turn_deg:.0f} degrees' if is_turned else 'mirrored'
                return (
                    f'the force moves otherwise than the weight of {self._name}: specific force '
                    f'is {how}; mend the mount of the IMU or the frame of the wrench, or call '
                    '~/identify_payload'
                )
            if abs(scale - 1) > np.clip(share, _LEARNT_SHARE, _ANOTHER_SHARE):
                return (
                    f'the force moves {scale:.3g} times as much as the weight of {self._name}: '
                    'its unit, payload.mass, or the payload is another one; mend that, or call '
                    '~/identify_payload'
                )
        if is_line:
            return None
        # d × ΔW, linear in d: one block of three rows a change. Another mass is no other centre.
        torque = changes[:, 0, 3:] - scale * changes[:, 1, 3:]
        moved_nm = np.median(np.abs(changes[:, 0, 3:]))
        if np.isnan(moved_nm) or moved_nm < ROUNDING:  # a sensor of forces alone
            torque = np.zeros_like(torque)
        rows = np.cross(np.eye(3), weight[:, None]).swapaxes(1, 2)
        shift, *_ = np.linalg.lstsq(rows.reshape(-1, 3), torque.ravel(), rcond=None)
        rest = np.median(np.linalg.norm(torque - rows @ shift, axis=1))
        off = np.median(np.linalg.norm(torque, axis=1))
        distance_m = float(np.linalg.norm(shift))
        is_shifted = distance_m > _LEAST_SHIFT_M and rest < _UNEXPLAINED_SHARE * off
        self._shifted = int(np.clip(self._shifted + (1 if is_shifted else -1), 0, 2 * _FEWEST))
        if self._shifted > _FEWEST or (is_shifted and self.found):
            return (
                f'the torque moves as if the centre of mass were {1e3 * distance_m:.0f} mm from '
                f'that of {self._name}; was the frame of the wrench moved, such as by another '
                'TCP? Move it back, or call ~/identify_payload'
            )
        is_right = not is_shifted and off_n < limit_n and off < _LEAST_SHIFT_M * reach
        return '' if is_right else None


class LagCheck:
    """Finds how far, in time, the force is behind the weight that is taken off, from motion."""

    def __init__(self) -> None:
        #: What is left of the force, and the speed of the weight, N and N/s, (2, 3) each.
        self._motions: deque[FloatArray] = deque(maxlen=_KEPT)

    def look(self, rest_n: FloatArray, weight_n: FloatArray, change_n: FloatArray) -> str:
        """
        Say how far it is behind or ahead, and what it may be; '' where nothing shows that.

        Takes a force without the weight, the weight, and how it changed in LAG_STEP_S, N, (3,)
        each. A force that is late by t leaves -t dW/dt.
        """
        if np.linalg.norm(change_n) >= _LEAST_MOTION_N:
            self._motions.append(np.stack((rest_n, change_n / LAG_STEP_S)))
        if len(self._motions) < _MOTIONS:
            return ''
        rests, speeds = np.array(self._motions).swapaxes(0, 1)
        ahead_s = np.sum(rests * speeds, axis=1) / np.sum(speeds**2, axis=1)
        lag_s = -float(np.median(ahead_s))
        wrong_n = abs(lag_s) * np.median(np.linalg.norm(speeds, axis=1))
        unexplained = np.linalg.norm(rests + lag_s * speeds, axis=1)
        if (
            np.mean(ahead_s * lag_s < 0) < _SAME_SIGN
            or wrong_n < min(_WRONG_SHARE * float(np.linalg.norm(weight_n)), _MOST_OFF_N)
            or np.median(unexplained) > _LAG_REST * np.median(np.linalg.norm(rests, axis=1))
        ):
            return ''
        side, why = 'before', 'specific force comes late or seldom, or its stamps are ahead'
        if lag_s > 0:
            side, why = 'behind', 'the driver filters the wrench, or stamps it late'
        return (
            f'in motion the force is {abs(lag_s):.2g} s {side} the weight that is taken off, so '
            f'that {wrong_n:.2g} N of wrench_external are wrong: {why}; mend that'
        )


class HiddenWeight:
    """Judges whether a payload that becomes active was on at a tare that had none; times in s."""

    def __init__(self) -> None:
        #: Since when the weight of a payload has not shown, and when one did last, which proves
        #: the tare.
        self._hidden_s, self._shown_s = math.inf, -math.inf
        self._looked_s = -math.inf

    def expect(self, now_s: float, tared_s: float) -> None:
        """Take that a payload is active from now on, and was not at the tare."""
        if self._shown_s <= tared_s:
            self._hidden_s = now_s if self._hidden_s < tared_s else min(self._hidden_s, now_s)

    def look(self, now_s: float, tared_s: float, rest_n: FloatArray, weight_n: FloatArray) -> bool:
        """Take the force without the weight, and the weight, (3,); True where it is hidden."""
        off_n, size_n = float(np.linalg.norm(rest_n)), float(np.linalg.norm(weight_n))
        if off_n < max(_NEAR_N, size_n / 5):  # not by half: a pull may be as large
            self._hidden_s, self._shown_s = math.inf, now_s
        elif tared_s > self._hidden_s:
            self._hidden_s = math.inf
        elif 2 * off_n < size_n and self._hidden_s < now_s:  # a part is carried, or it is free
            self._hidden_s += 1.5 * (now_s - max(self._looked_s, self._hidden_s))
        self._looked_s = now_s
        return now_s - self._hidden_s > _SHOWN_S and 2 * off_n >= size_n


class ExchangeCheck:
    """Finds that the force goes against the weight where payloads are exchanged, in any pose."""

    def __init__(self) -> None:
        #: Forces and weights under the present payload, N, and the medians of the one before.
        self._looks: deque[FloatArray] = deque(maxlen=_KEPT)
        self._before: FloatArray | None = None
        #: How much of a change of the weight the force made along it, at each exchange.
        self._shares: deque[float] = deque(maxlen=_EXCHANGES)

    def look(self, force_n: FloatArray, weight_n: FloatArray) -> bool:
        """Take a force with the weight in it, and the weight, N, (3,); whether it is against."""
        self._looks.append(np.stack((force_n, weight_n)))
        # A payload that is named late, or early, makes it 0 to 1.
        apart = np.abs(np.array(self._shares) + 1)
        return len(apart) == _EXCHANGES and bool((apart < _ALONG_SHARE).all())

    def exchange(self) -> None:
        """Take that another payload is held from now on."""
        if not self._looks:
            return
        now = np.median(self._looks, axis=0)
        force, weight = now - (now if self._before is None else self._before)
        self._before = now
        self._looks.clear()
        if np.linalg.norm(weight) >= _MOVED_N:
            self._shares.append(float(force @ weight / (weight @ weight)))


class TareCheck:
    """Judges whether the last tare of wrench_external was of the weight that is taken off."""

    def __init__(self) -> None:
        #: Whether this tare has proven itself, and when it was near last, s.
        self._is_right, self._near_s = False, -math.inf
        #: What is left of the force, and the weight, N, (2, 3) each.
        self._looks: deque[FloatArray] = deque(maxlen=_FORCES)

    def off_n(self, now_s: float, rest_n: FloatArray, weight_n: FloatArray) -> float:
        """
        Take forces without the weight, and weights, N, (3,) each; say by how much the tare is off.

        A wrong tare is the same in all directions, and so is a zero that moved. So is what a
        force-controlled tool presses with, for some time.
        """
        now = np.stack((rest_n, weight_n))
        if not self._looks or np.linalg.norm(now[1] - self._looks[-1][1]) >= _MOVED_N:
            self._looks.append(now)
        rests, weights = np.array(self._looks).swapaxes(0, 1)
        off = np.median(rests, axis=0)
        near_n = max(_NEAR_N, _NEAR_SHARE * float(np.linalg.norm(weight_n)))
        near = np.linalg.norm(rests, axis=1) < near_n
        self._is_right |= len(distinct(weights[near])) >= _PROOFS
        if np.linalg.norm(rest_n) < near_n:
            self._near_s = now_s
        same = np.linalg.norm(rests - off, axis=1) < near_n
        is_same = same.mean() >= _ON_SPHERE and len(distinct(weights[same])) >= _DIRECTIONS
        off_n = float(np.linalg.norm(off))
        is_proven = self._is_right and now_s - self._near_s < _PRESSED_S
        return off_n if is_same and off_n > near_n and not is_proven else 0.0


def _are_free(force: FloatArray, weight: FloatArray) -> BoolArray:
    """Mark changes, (n, 3) each, that are of one turn, or of the weight; contacts make others."""
    triples = _draws(3, len(force))
    turns = _fit_turns(force[triples], weight[triples])
    moved = np.einsum('tij,nj->tni', turns, weight)
    medians = np.median(np.linalg.norm(force - moved, axis=2), axis=1)
    best = int(np.argmin(medians))
    noise_n, turned = max(medians[best], 1e-9), moved[best]
    # Along the axis of a turn, or in the plane of a mirror, there are always some; older ones are
    # of before an IMU was turned.
    as_weight = np.linalg.norm(force - weight, axis=1) <= 2 * noise_n
    lately = as_weight[-_KEPT // 2 :].mean()
    if lately >= _AS_WEIGHT and np.linalg.svd(weight[as_weight])[1][-1] >= _MOVED_N:
        turned = weight
    return np.asarray(np.linalg.norm(force - turned, axis=1) <= 3 * noise_n)


def _draws(few: int, count: int) -> IntArray:
    """Draw different numbers below a count, (_TRIPLES, few); the same ones every time."""
    return np.random.default_rng(0).random((_TRIPLES, count)).argsort(axis=1)[:, :few]


def distinct(forces: Iterable[FloatArray], apart_n: float = _MOVED_N) -> FloatArray:
    """Pick forces that differ by _MOVED_N, or otherwise, from all before, (n, 3)."""
    points = np.reshape(list(forces), (-1, 3))
    near = np.linalg.norm(points[:, np.newaxis] - points, axis=2) < apart_n
    kept = list[int]()
    for k, is_near in enumerate(near.tolist()):
        if not any(is_near[before] for before in kept):
            kept.append(k)
    return points[kept]


def _fit_turns(forces: FloatArray, weights: FloatArray) -> FloatArray:
    """Fit k Q, Q orthogonal, (t, 3, 3), with F ≈ k Q W, to rows of both, (t, n, 3)."""
    left, _, right = np.linalg.svd(np.einsum('tni,tnj->tij', forces, weights))
    turns = left @ right
    moved = np.einsum('tij,tnj->tni', turns, weights)
    scales = np.sum(forces * moved, axis=(1, 2)) / np.sum(weights**2, axis=(1, 2))
    return np.asarray(scales[:, None, None] * turns)
