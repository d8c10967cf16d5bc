"""
The weight of the mounted payload at the stamp of a wrench, live, in floats instead of arrays.

It is the weight at the newest specific force up to the stamp, or else at the nearest one, so that
nothing waits.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np

from wrist_ft_comp.payload.weight import ForceFrame, Payload
from wrist_ft_comp.signals import NANOSECONDS

Force = tuple[float, float, float]
#: Samples that are kept, so that an IMU of 1 kHz may be a quarter of a second ahead of the wrench.
_KEPT_SAMPLES = 256


class RecentForces:
    """The newest samples of specific force, as measured, m/s²."""

    def __init__(self, timeout_s: float) -> None:
        #: A sample is used for wrenches within this time, ns.
        self.timeout_ns = round(timeout_s * NANOSECONDS)
        #: Samples since the start, and the stamp of the newest, ns.
        self.count = self.newest_ns = 0
        self._kept: deque[tuple[int, Force]] = deque(maxlen=_KEPT_SAMPLES)

    @property
    def newest(self) -> tuple[int, Force] | None:
        """Stamp, ns, and specific force of the newest sample."""
        return self._kept[-1] if self._kept else None

    def add(self, stamp_ns: int, force: Force) -> None:
        """Add a sample; a late one is dropped, and a stamp that is far back begins anew."""
        self.count += 1
        if self._kept and stamp_ns < self._kept[-1][0]:
            if self._kept[-1][0] - stamp_ns <= self.timeout_ns:
                return
            self._kept.clear()
        self.newest_ns = stamp_ns
        self._kept.append((stamp_ns, force))

    def at(self, stamp_ns: int) -> Force | None:
        """Find the sample for a stamp, ns; None where it is farther away than the timeout."""
        if not self._kept:
            return None
        for sample in reversed(self._kept):
            if sample[0] <= stamp_ns:
                break
        return sample[1] if abs(stamp_ns - sample[0]) <= self.timeout_ns else None


class LivePayload:
    """A payload, and how measured specific force is turned for it, by whom ``turned`` says."""

    def __init__(self, name: str, payload: Payload, frame: ForceFrame, turned: str = '') -> None:
        self.name, self.payload, self.frame = name, payload, frame
        #: How specific force is turned for it, and who says so, for people.
        self.turn = f'specific force is {frame}, {turned}'
        still = payload.weight(frame.turn(np.zeros(3)))
        gains = payload.weight(frame.turn(np.eye(3))) - still
        #: Per axis: gains of the three directions of the specific force, and a constant.
        self._rows: list[tuple[float, float, float, float]] = list(
            zip(*gains.tolist(), still.tolist(), strict=True)
        )

    def __str__(self) -> str:
        """Name it, with mass and centre of mass."""
        center = ', '.join(f'{coordinate:.4f}' for coordinate in self.payload.center_m)
        return f'{self.name}, {self.payload.mass_kg:.4f} kg at ({center}) m'

    def weight(self, force: Force) -> list[float]:
        """Compute its wrench at a specific force, m/s²: N and N m, axis order AXES."""
        return [-value for value in self.taken_off([0.0] * 6, force)]

    def taken_off(self, wrench: Sequence[float], force: Force) -> list[float]:
        """Subtract its wrench at a specific force, m/s², from a wrench, N and N m."""
        x, y, z = force
        return [
            w - (a * x + b * y + c * z + d)
            for w, (a, b, c, d) in zip(wrench, self._rows)  # noqa: B905 -- as in Compensator
        ]
