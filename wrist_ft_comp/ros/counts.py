"""What came in and what went out, counted."""

import time
from typing import NamedTuple

from wrist_ft_comp.core.recording import NANOSECONDS


class Period(NamedTuple):
    """
    What happened since the last report.

    Attributes
    ----------
    in_hz, out_hz, warm_hz : float
        Usable wrenches that came, wrenches that went, and finite temperatures, per second.
    unusable : int
        Wrenches that were dropped.
    temperatures : int
        Finite temperatures of all thermometers.
    rejected : int
        Temperatures whose stamp did not increase, or leapt and came alone.
    unusable_temperatures : int
        Temperatures that were dropped because no sensor reads them.

    """

    in_hz: float
    out_hz: float
    warm_hz: float
    unusable: int
    temperatures: int
    rejected: int
    unusable_temperatures: int


class Counts:
    """
    What came in and what went out.

    Parameters
    ----------
    thermometers : int
        Number of thermometers J.

    """

    def __init__(self, thermometers: int) -> None:
        self.wrenches = 0
        self.published = 0
        self.malformed = 0
        self.not_finite = 0
        self.bad_temperatures = 0
        self.bad_references = 0
        self.temperatures = 0
        self.last_temperature: list[float | None] = [None] * thermometers
        self._wrench_stamp_ns = self._temperature_stamp_ns = 0
        self._before = (time.monotonic(), 0, 0, 0, 0, 0, 0)

    def wrench(self, stamp_ns: int) -> None:
        """Count one usable wrench."""
        self.wrenches += 1
        self._wrench_stamp_ns = stamp_ns

    def temperature(self, thermometer: int, stamp_ns: int) -> None:
        """Count one finite temperature and remember when it came."""
        self.temperatures += 1
        self._temperature_stamp_ns = stamp_ns
        self.last_temperature[thermometer] = time.monotonic()

    @property
    def apart_s(self) -> float:
        """How far the stamps of the newest wrench and temperature are apart, s; 0 before both."""
        if not (self.wrenches and self.temperatures):
            return 0.0
        return abs(self._wrench_stamp_ns - self._temperature_stamp_ns) / NANOSECONDS

    def period(self, rejected: int) -> Period:
        """Count since the last call; rejected is what the core has counted so far."""
        unusable = self.malformed + self.not_finite
        now = (
            time.monotonic(), self.wrenches, self.published, unusable, self.temperatures, rejected,
            self.bad_temperatures,
        )  # fmt: skip
        before, self._before = self._before, now
        elapsed, came, went, *rest = (a - b for a, b in zip(now, before, strict=True))
        elapsed = max(elapsed, 1e-9)
        warm = now[4] - before[4]
        return Period(came / elapsed, went / elapsed, warm / elapsed, *map(int, rest))
