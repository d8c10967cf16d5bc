"""
Watching a sensor that still talks: frozen, saturated, or with wrong stamps.

It looks at one reading now and then, not at each: what stands still for seconds is seen as well,
and the stream pays nothing.
"""

from collections.abc import Sequence

from wrist_ft_comp.core.recording import AXES, NANOSECONDS

#: Looks in a row with the same reading after which it counts as frozen.
LOOKS = 50
#: Looks in a row at one stamp after which the stamps count as standing still.
_STAMP_LOOKS = 5
#: Stamps that move by more between two looks have leapt, unless they move that fast always.
_LEAP_NS = 60 * NANOSECONDS
_STEPS = 10


class SensorWatch:
    """
    Remembers what a sensor's readings looked like.

    Parameters
    ----------
    looks : int
        Equal looks in a row that make a reading suspicious.

    """

    def __init__(self, looks: int = LOOKS) -> None:
        #: How often stamps ran back, and leapt ahead.
        self.ran_back = self.leapt = 0
        #: Whether the newest wrench had no stamp.
        self.unstamped = False
        self._looks = looks
        self._received = 0
        self._raw: Sequence[float] = ()
        self._same = [0] * len(AXES)
        self._least = [float('inf')] * len(AXES)
        self._most = [float('-inf')] * len(AXES)
        self._stamp_ns: int | None = None
        self._step_ns = 0
        self._same_stamps = 0

    def look(self, received: int, stamp_ns: int, raw: Sequence[float]) -> None:
        """
        Look at the newest wrench.

        Parameters
        ----------
        received : int
            How many came so far; without a new one there is nothing to see.
        stamp_ns : int
            Its stamp, ns; 0 when it has none.
        raw : sequence of 6 floats
            N and N m, axis order AXES.

        """
        if received == self._received:
            return
        self._received = received
        for i, value in enumerate(raw):
            self._same[i] = self._same[i] + 1 if self._raw and value == self._raw[i] else 0
            self._least[i] = min(self._least[i], value)
            self._most[i] = max(self._most[i], value)
        self._raw = raw
        self.unstamped = not stamp_ns
        if stamp_ns:
            self._look_at_stamp(stamp_ns)

    def _look_at_stamp(self, stamp_ns: int) -> None:
        """Compare a stamp with the one before."""
        if self._stamp_ns is not None:
            step_ns = stamp_ns - self._stamp_ns
            self._same_stamps = self._same_stamps + 1 if step_ns == 0 else 0
            self.ran_back += step_ns < 0
            self.leapt += step_ns > max(_LEAP_NS, _STEPS * self._step_ns) and self._step_ns > 0
            self._step_ns = max(step_ns, 1)
        self._stamp_ns = stamp_ns

    @property
    def stamps_stand_still(self) -> bool:
        """Whether new wrenches come with an old stamp."""
        return self._same_stamps >= _STAMP_LOOKS

    @property
    def frozen(self) -> bool:
        """Whether the reading has been the same, to the last bit, on all axes."""
        return min(self._same) >= self._looks

    @property
    def saturated(self) -> tuple[str, ...]:
        """
        Axes that stay exactly at their largest or least value so far, while others move.

        An axis that never moved, such as one that a sensor does not have, is not among them.
        """
        if self.frozen:
            return ()
        return tuple(
            axis
            for axis, same, value, least, most in zip(
                AXES, self._same, self._raw or self._same, self._least, self._most, strict=True
            )
            if same >= self._looks and least < most and value in {least, most}
        )
