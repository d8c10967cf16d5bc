"""
The payload that is held, live: what it weighs at a wrench's stamp, in plain floats, not arrays.

The newest specific force at or before the stamp is taken, or else the nearest, so nothing waits.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np

from wrist_ft_comp.payload.weight import ForceFrame, Payload
from wrist_ft_comp.signals import NANOSECONDS

Force = tuple[float, float, float]
#: Samples that are kept: an IMU of 1 kHz may be a quarter of a second ahead of the wrench.
_KEPT = 256


class RecentForces:
    """Specific force of the last moments, as it was measured, m/s²."""

    def __init__(self, timeout_s: float) -> None:
        #: A sample farther from a wrench than this is none of its time, ns.
        self.timeout_ns = round(timeout_s * NANOSECONDS)
        #: Samples since the start, and the stamp of the newest, ns.
        self.count = self.newest_ns = 0
        self._kept: deque[tuple[int, Force]] = deque(maxlen=_KEPT)

    @property
    def newest(self) -> tuple[int, Force] | None:
        """Stamp, ns, and specific force of the newest sample."""
        return self._kept[-1] if self._kept else None

    def add(self, stamp_ns: int, force: Force) -> None:
        """Take one sample; a stamp far back is another time's, one a little back is too late."""
        self.count += 1
        if self._kept and stamp_ns < self._kept[-1][0]:
            if self._kept[-1][0] - stamp_ns <= self.timeout_ns:
                return
            self._kept.clear()
        self.newest_ns = stamp_ns
        self._kept.append((stamp_ns, force))

    def at(self, stamp_ns: int) -> Force | None:
        """Give the sample that holds at a stamp, ns; None where it is too old, or from later."""
        if not self._kept:
            return None
        for each in reversed(self._kept):
            if each[0] <= stamp_ns:
                break
        return each[1] if abs(stamp_ns - each[0]) <= self.timeout_ns else None


class LivePayload:
    """Weighs a payload at specific forces as they are measured."""

    def __init__(self, name: str, payload: Payload, frame: ForceFrame, turned: str = '') -> None:
        self.name, self.payload, self.frame = name, payload, frame
        #: How specific force is turned for it, and who says so.
        self.turn = f'specific force is {frame}, {turned}'
        still = payload.weight(frame.turn(np.zeros(3)))
        gains = payload.weight(frame.turn(np.eye(3))) - still
        #: Per axis: what each direction adds, and what is there without any.
        self._rows: list[tuple[float, float, float, float]] = list(
            zip(*gains.tolist(), still.tolist(), strict=True)
        )

    def __str__(self) -> str:
        """Say what it is."""
        center = ', '.join(f'{each:.4f}' for each in self.payload.center_m)
        return f'{self.name}, {self.payload.mass_kg:.4f} kg at ({center}) m'

    def weight(self, force: Force) -> list[float]:
        """Push at a specific force, m/s²: N and N m, axis order AXES."""
        return [-left for left in self.taken_off([0.0] * 6, force)]

    def taken_off(self, wrench: Sequence[float], force: Force) -> list[float]:
        """Take the weight at a specific force off a wrench, N and N m."""
        x, y, z = force
        return [
            w - (a * x + b * y + c * z + d)
            for w, (a, b, c, d) in zip(wrench, self._rows)  # noqa: B905 -- as in Compensator
        ]
