"""Finds wrenches that no healthy sensor gives: unusable, away, zeroed, frozen, or stuck."""

from collections import deque
from collections.abc import Sequence
import math

import numpy as np

from wrist_ft_comp.channels import AXES, LARGEST
from wrist_ft_comp.series import BoolArray, FloatArray, IntArray
from wrist_ft_comp.stream.drift_limits import axis_limits

#: A sensor that is silent for longer, s, may have been switched off, and have another zero then.
_AWAY_S = 5.0
#: A reading is frozen after about this many looks with the same value, 5 s of ten looks a second.
LOOKS = 50
#: Only the same value in a row for more looks than this counts, 1 s: sensors that are slower than
#: the node's looks, or have coarse steps, repeat themselves for less.
_RUN_LOOKS = 10
#: An axis that never repeated itself for more looks has steps that are finer than its noise, but
#: where it was saturated.
_FINE_LOOKS = 2
#: An axis that shows the value before in fewer looks than this share does not come back to the
#: last bit of its largest or least value, but where it was saturated.
_FINE_SHARE = 0.02
#: A look at a reading that lives takes this much of a look back: what stands still for more than
#: a fifth of the time is found, and what lives is believed again after 25 s.
_RECOVERY = 0.2
#: An axis lives where at least this share of its looks in the last 5 s showed a new value. Of a
#: sensor whose steps are as coarse as its noise, half do.
LIVELY_SHARE = 0.8
#: What a free sensor reads is known to this many standard deviations of the model, but not better
#: than the second, N, and to the third on axes without a model.
_CERTAIN, _RESOLVED_N, _UNKNOWN_N = 3.0, 0.2, 0.5
#: A load beyond this, N, or its torque, moves both forces and torques, however coarse they are.
_LOADED_N = 3.0
#: A load at rest scatters by less than this, N.
_REST_N = 0.5
#: A sensor that was zeroed just now reads less than this, N, and what its noise makes of it.
_ZERO_N = 0.02


def unusable(raw: Sequence[float], before: Sequence[float]) -> float | None:
    """
    Give the number for which a wrench, N and N m, is dropped; None where it is usable.

    An axis that was NaN in every earlier wrench may be NaN: the sensor does not have it.
    """
    numbers = [value for value in raw if not math.isnan(value)]
    pairs = zip(raw, before, strict=True)
    lost = any(math.isnan(value) and not math.isnan(last) for value, last in pairs)
    if numbers and not lost and math.hypot(*numbers) < LARGEST:
        return None
    return math.nan if lost or not numbers else max(numbers, key=abs)


def was_away(silent_s: float, passed_s: float) -> bool:
    """
    Whether a sensor may have been off, by how long it was silent, and what passed by its stamps.

    By the stamps, too: a simulation that was held up goes on with the next one, a clock that
    stands still shows nothing.
    """
    return silent_s > _AWAY_S and not 0 < passed_s <= _AWAY_S


class SensorWatch:
    """Watches readings; the same value in about LOOKS looks is suspicious."""

    def __init__(self) -> None:
        #: Per axis: the newest reading, its least and its largest, and how often it was the same.
        self._raw, self._least, self._most = np.full((3, len(AXES)), np.nan)
        self._same: IntArray = np.zeros(len(AXES), np.int64)
        #: Per axis: for how many looks it ever was the same, inside its range, before it changed.
        self._longest: FloatArray = np.full(len(AXES), np.nan)
        #: Per axis: share of its last looks inside its range that showed the value before.
        self._repeating: FloatArray = np.ones(len(AXES))
        #: Per axis: whether its value was its least or its largest one before, too.
        self._returned: BoolArray = np.zeros(len(AXES), np.bool_)
        #: The readings of the last two seconds.
        self._lately: deque[FloatArray] = deque(maxlen=2 * _RUN_LOOKS)
        #: What a reading that first rested near zero, and at zero, since a tare showed without
        #: drift; and that tare, N and N m.
        self._near_zero, self._at_zero, self._tare = np.full((3, len(AXES)), np.nan)
        #: Share of the last looks that showed a new value, per axis.
        self._lively: FloatArray = np.zeros(len(AXES))
        #: Looks at an axis that stood still while others moved; the last, at all that stood still.
        self._still: FloatArray = np.zeros(len(AXES) + 1)

    def look(self, raw: Sequence[float]) -> None:
        """Look at another wrench, N and N m."""
        before, self._raw = self._raw, np.array(raw)
        self._lately.append(self._raw)
        is_same = self._raw == before
        ended = ~is_same & (before > self._least) & (before < self._most)
        self._longest = np.where(ended, np.fmax(self._longest, self._same), self._longest)
        self._same = np.where(is_same, self._same + 1, 0)
        returned = (self._raw == self._least) | (self._raw == self._most)
        self._returned = np.where(is_same, self._returned, returned)
        inside = (self._raw > self._least) & (self._raw < self._most)
        self._repeating += np.where(inside, (is_same - self._repeating) / 100, 0.0)
        self._lively += (~is_same - self._lively) / LOOKS
        self._least = np.fmin(self._least, self._raw)
        self._most = np.fmax(self._most, self._raw)
        extreme = (self._raw == self._least) | (self._raw == self._most)
        held = self._same > _RUN_LOOKS
        # Forces have one resolution, and torques another one; three of one board may hang at once.
        is_fine = self._longest <= _FINE_LOOKS
        others_live = ((self._lively > LIVELY_SHARE) & ~held).reshape(2, 3).any(axis=1).repeat(3)
        has_moved, span = self._least < self._most, self._most - self._least
        # What hangs since the start shows when a load comes, which moves forces and torques.
        loaded = (span > axis_limits(_LOADED_N)).reshape(2, 3).any(axis=1)[::-1].repeat(3)
        is_odd = has_moved & (extreme | others_live | is_fine)
        is_odd |= (others_live | (loaded & ~has_moved)) & (self._raw != 0)
        returned = self._returned & (self._repeating < _FINE_SHARE)
        repeats = held | (is_fine & extreme & (returned | (self._same > _FINE_LOOKS)))
        stuck = repeats & is_odd & ~held.all()
        change = np.where(np.append(stuck, held.all()), 1.0, -_RECOVERY)
        # The looks before a run was long enough belong to it.
        if self._same.min() == _RUN_LOOKS + 1:
            change[-1] += _RUN_LOOKS
        self._still = np.clip(self._still + change, 0.0, 2 * LOOKS)

    def zeroed(self, drift: FloatArray, tare: FloatArray, deviation: FloatArray) -> str:
        """
        Say how a reading at rest shows that the sensor was zeroed; '' where it does not.

        It jumps to zero on all axes between two looks, a second ago, where drift and tare, N and
        N m, (6,), say that a free sensor reads something else. Not where it rested there before,
        as with a tool in one pose: a load was let go. Where a program zeroes in each cycle, no
        jump is large; but it rests at zero again, though drift has moved since. ``deviation`` is
        a third of what the model may be off, NaN where there is none.
        """
        if len(self._lately) < 2 * _RUN_LOOKS:
            return ''
        if (tare != self._tare).any():
            self._near_zero, self._at_zero = np.full((2, len(AXES)), np.nan)
            self._tare = tare
        off = np.fmax(_CERTAIN * deviation, axis_limits(_RESOLVED_N))
        off = np.where(np.isnan(deviation), axis_limits(_UNKNOWN_N), off)
        parts = np.array(self._lately).reshape(2, _RUN_LOOKS, len(AXES))
        means, scatter = parts.mean(axis=1), parts.std(axis=1)
        # The noise of some sensors is larger than what others scatter in motion. It bends from
        # look to look, which a swing hardly does.
        bends = np.median(np.abs(np.diff(parts, 2, axis=1)), axis=1).max(axis=0)
        noise = bends / math.sqrt(3)  # as large as its deviation
        uncertain = _CERTAIN * noise / math.sqrt(_RUN_LOOKS)
        off = np.maximum(off, uncertain)
        rests = scatter < np.maximum(axis_limits(_REST_N), 2 * noise)
        # Zeros to the last bit are those of a broken sensor.
        if not (rests.all() and scatter[1].any()):
            return ''
        # What is at zero to the noise of a second shows smaller steps than what is near it.
        zero = axis_limits(_ZERO_N) + uncertain
        least = np.where(np.isnan(deviation), off, _CERTAIN * deviation) + 2 * zero
        for near, far, rested in ((off, 2 * off, self._near_zero), (zero, least, self._at_zero)):
            before, now = (np.abs(means) < near).all(axis=1)
            jumped = (np.abs(means[0] - means[1]) > near).any()
            moved = np.abs(means[1] - drift - rested)  # NaN where it never rested there
            if now and jumped and (np.abs(drift + tare) > far).any() and not (moved < far).all():
                return 'jumped to zero on all axes at once'
            if now and before and (moved > far).any():
                return 'rests at zero again on all axes, though drift has moved it since'
            if now and before and np.isnan(rested).all():
                rested[:] = means[1] - drift
        return ''

    @property
    def frozen(self) -> bool:
        """Whether the reading stands still, to the last bit, on all axes, again and again."""
        return bool(self._still[-1] >= LOOKS)

    @property
    def stuck(self) -> tuple[str, ...]:
        """
        Axes that repeat one value again and again while others move.

        Either it is their largest or least one, or they never repeated one before, or the other
        forces, or torques, all but never do. An axis that never read anything but 0 is absent.
        """
        if self.frozen:
            return ()
        return tuple(AXES[i] for i in np.flatnonzero(self._still[:-1] >= LOOKS - _RUN_LOOKS))

    @property
    def unused(self) -> tuple[str, ...]:
        """Axes that have not read anything but 0 for seconds, and never did."""
        zero = (self._least == 0) & (self._most == 0) & (self._same >= LOOKS - _RUN_LOOKS)
        return tuple(AXES[i] for i in np.flatnonzero(zero))
