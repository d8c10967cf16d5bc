"""What comes in: counts, and faults that no single message shows."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

from wrist_ft_comp.signals import NANOSECONDS
from wrist_ft_comp.stream.drift_tracker import DriftTracker
from wrist_ft_comp.stream.input_checks import SensorWatch, ThermometerWatch

#: An event is worth a warning for this long, s.
_RECENT_S = 10.0


@dataclass
class Counts:
    """Messages since the start."""

    #: Usable wrenches that came, and wrenches that went.
    wrenches: int = 0
    published: int = 0
    malformed: int = 0
    not_finite: int = 0
    bad_references: int = 0
    #: Usable temperatures of all thermometers, and those that no sensor reads.
    temperatures: int = 0
    bad_temperatures: int = 0
    #: Usable temperatures whose stamp did not increase, or leapt and came alone.
    rejected: int = 0


class InputHealth:
    """Remembers what is pushed to it; times are those of a steady clock, thermometers from 0."""

    def __init__(self, thermometers: int) -> None:
        self.counts = Counts()
        self.sensor = SensorWatch()
        self.thermometers = ThermometerWatch(thermometers)
        self.last_wrench_s: float | None = None
        self.last_temperature_s: list[float | None] = [None] * thermometers
        #: Thermometer and value, °C, of the newest unusable reading.
        self.last_unusable: tuple[int, float] | None = None
        #: Whether the newest reading of a thermometer had a stamp; None where its type has none.
        self.stamped: list[bool | None] = [True] * thermometers
        self.frame = ''
        #: How often the frame changed, and from what to what the last time.
        self.frame_changes = 0
        self.last_frames = ('', '')
        self._looked_at = 0
        self._wrench_stamp_ns = self._temperature_stamp_ns = 0
        #: Count of each kind of event, and when it last grew.
        self._events: dict[str, tuple[int, float]] = {}

    @property
    def stamps_apart_s(self) -> float:
        """How far the stamps of the newest wrench and temperature are apart; 0 before both."""
        if not (self._looked_at and self.counts.temperatures):
            return 0.0
        return abs(self._wrench_stamp_ns - self._temperature_stamp_ns) / NANOSECONDS

    @property
    def clock_stands(self) -> bool:
        """Whether what comes without a stamp gets the time 0: simulated, and nobody tells it."""
        wrench = self._looked_at and not self._wrench_stamp_ns
        return bool(wrench or (self.counts.temperatures and not self._temperature_stamp_ns))

    def look(
        self, now_s: float, stamp_ns: int, raw: Sequence[float], frame: str, *, stamped: bool
    ) -> None:
        """Look at the newest wrench, N and N m, if it is another one than at the last look."""
        if self._looked_at == self.counts.wrenches:
            return
        self._looked_at, self.last_wrench_s = self.counts.wrenches, now_s
        self._wrench_stamp_ns = stamp_ns
        self.sensor.look(stamp_ns if stamped else 0, raw)
        if self.frame and frame != self.frame:
            self.frame_changes += 1
            self.last_frames = (self.frame, frame)
        self.frame = frame

    def take_temperature(
        self, now_s: float, thermometer: int, stamp_ns: int, *, stamped: bool | None
    ) -> None:
        """Note a usable temperature."""
        self.counts.temperatures += 1
        self._temperature_stamp_ns = stamp_ns
        self.last_temperature_s[thermometer] = now_s
        self.stamped[thermometer] = stamped

    def drop_temperature(self, thermometer: int, temperature_c: float) -> None:
        """Note a temperature that no sensor reads."""
        self.counts.bad_temperatures += 1
        self.last_unusable = thermometer, temperature_c

    def note_events(self, now_s: float, tracker: DriftTracker) -> None:
        """Remember when the counts of events grew."""
        strays, grid = tracker.timestamp_filter.strays, tracker.grid
        self.counts.rejected = grid.rejected + strays
        counts = {
            'frame': self.frame_changes,
            'ran_back': self.sensor.ran_back,
            'leapt': self.sensor.leapt,
            'jump': int(self.thermometers.jumps.sum()),
            'stray temperature': strays,
            'temperature leapt': tracker.timestamp_filter.leaps + grid.restarts,
        }
        for kind, count in counts.items():
            before, at_s = self._events.get(kind, (0, -math.inf))
            self._events[kind] = (count, now_s if count > before else at_s)

    def recent(self, now_s: float) -> set[str]:
        """Which events happened lately; their names stand in note_events."""
        return {kind for kind, (_, at_s) in self._events.items() if at_s > now_s - _RECENT_S}
