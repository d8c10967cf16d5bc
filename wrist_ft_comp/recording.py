"""What a recording is: samples as they were read, and their means on the thermal grid."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from wrist_ft_comp.channels import AXES, SensorNames
from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.series import BoolArray, CLOCK_NS, FloatArray, IntArray, NANOSECONDS

#: Thermal cells that a person may choose, s: longer ones would average a warm-up away.
PERIODS_S = (0.1, 600.0)
#: What is known of the true wrench in a recording.
Reference = Literal['unloaded', 'constant', 'payload', 'recorded']

#: Takes stamps_ns (n,) and raw wrenches (n, 6), N and N m; returns corrected wrenches (n, 6).
Correction = Callable[[IntArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class Topics:
    """How a recording is read: where a bag holds what, what a log's columns are, which part."""

    wrench: str = '/wrench_raw'
    #: One per thermometer, as ``temperature_source`` reads it; the first is inside the sensor.
    temperatures: tuple[str, ...] = ('/temperature',)
    #: The default one may be absent.
    reference: str = '/wrench_reference'
    #: Where specific force comes from: a sensor_msgs/Imu, or a frame of /tf whose z is up, against
    #: which that of the wrench turns; nowhere where both are empty.
    imu: str = ''
    gravity_frame: str = ''
    #: The frame_id of the specific force and of the wrench; empty where the caller knows neither.
    force_frame: str = ''
    wrench_frame: str = ''
    #: What columns and stamps of a table mean, as ``column_map`` reads them.
    columns: str = ''
    time: str = ''
    #: Which part of a recording counts, as ``read_options`` reads it; all where they are empty.
    begin: str = ''
    end: str = ''
    exclude: tuple[str, ...] = ()

    @property
    def force_source(self) -> str:
        """Where specific force comes from: imu, tf, or an empty string."""
        return 'imu' if self.imu else 'tf' if self.gravity_frame else ''

    def options(self, reference: str) -> list[str]:
        """Give the options that say what a table's columns are, and where the true load is."""
        words = ['--columns', self.columns] if self.columns else []
        if self.columns and self.time:
            words += ['--time', self.time]
        if reference == 'recorded' and self.reference != Topics.reference:
            words += ['--reference-topic', self.reference]
        if reference == 'payload' and self.imu:
            words += ['--imu-topic', self.imu]
        if reference == 'payload' and self.gravity_frame:
            words += ['--gravity-frame', self.gravity_frame]
        return words

    def __post_init__(self) -> None:
        """Refuse one name in the place of several: its letters would be topics."""
        names: object = self.temperatures
        if isinstance(names, str):
            raise SettingsError(
                f'temperatures are names of topics; got the text {names!r}. Write ({names!r},).'
            )
        if self.imu and self.gravity_frame:
            raise SettingsError(
                f'Specific force is of {self.imu} or by {self.gravity_frame}, not from both.'
            )


@dataclass(frozen=True, eq=False)
class Samples:
    """A block of samples that share their stamps, in the order in which they were recorded."""

    #: C names, as in the module's docstring.
    channels: tuple[str, ...]
    #: Time of measurement, shape (n,).
    stamps_ns: IntArray
    #: N, N m or °C, shape (n, C); not finite where the source held no number.
    values: FloatArray


@dataclass(frozen=True, eq=False)
class Recording:
    """
    Means of a recording over the cells of the thermal grid.

    Cell ``k`` is the half-open interval ``[k h, (k + 1) h)`` of stamps, ``h = period_ns``. The
    first cell is the first one by whose end every thermometer has reported.
    """

    #: Where it came from, for messages.
    name: str
    #: Cell length h, ns.
    period_ns: int
    #: Number of the first cell.
    first_cell: int
    #: Mean temperature, °C, shape (N, J); on straight lines over cells without a sample (``gap``).
    temperature_c: FloatArray
    #: Whether the cell had a temperature sample of its own, shape (N, J).
    measured: BoolArray
    #: Mean raw and reference wrench, N and N m, axis order AXES, shape (N, 6); NaN: no sample.
    wrench: FloatArray
    reference: FloatArray
    #: What was dropped while reading, in sentences.
    warnings: tuple[str, ...] = field(default=())
    #: Mean specific force as it was measured, shape (N, 3), NaN where there was no sample; None
    #: where none was recorded. Scale and bias of the accelerometer are still in it.
    specific_force: FloatArray | None = None
    #: RMS speed of rotation, rad/s, shape (N,); NaN and None as before.
    rotation_speed: FloatArray | None = None
    #: Cells from which on the zero is another, because it was or may have been tared there.
    steps: tuple[int, ...] = ()
    #: What the sensor was called.
    sensor: SensorNames = field(default_factory=dict)
    #: First stamp of the file, from which times count; None where that is the first cell's.
    origin_ns: int | None = None

    def __len__(self) -> int:
        return len(self.temperature_c)

    @property
    def period_s(self) -> float:
        """Cell length h in seconds."""
        return self.period_ns / NANOSECONDS

    @property
    def duration_s(self) -> float:
        """Time covered, seconds."""
        return len(self) * self.period_s

    @property
    def elapsed_s(self) -> FloatArray:
        """Time from the start of the first cell to the centre of each, shape (N,)."""
        return np.asarray((np.arange(len(self)) + 0.5) * self.period_s, dtype=float)

    @property
    def thermometers(self) -> int:
        """J."""
        return int(self.temperature_c.shape[1])

    @property
    def axes_present(self) -> tuple[str, ...]:
        """Axes that have at least one wrench sample."""
        present = np.any(np.isfinite(self.wrench), axis=0)
        return tuple(axis for axis, found in zip(AXES, present, strict=True) if found)


def elapsed_s(recording: Recording, cell: int) -> float:
    """Compute when a cell begins, s since the first stamp of the file, as --exclude counts."""
    begin_ns = (recording.first_cell + int(cell)) * recording.period_ns
    first_ns = recording.first_cell * recording.period_ns
    origin_ns = first_ns if recording.origin_ns is None else recording.origin_ns
    return max(begin_ns - origin_ns, 0) / NANOSECONDS


def time_in(recording: Recording, cell: int) -> str:
    """Write when a cell begins: since the file's first stamp, and by the clock if it has one."""
    since_s = int(elapsed_s(recording, cell))
    elapsed = f'{since_s // 3600}:{since_s // 60 % 60:02}:{since_s % 60:02}'
    stamp_ns = (recording.first_cell + int(cell)) * recording.period_ns
    if stamp_ns < CLOCK_NS:
        return elapsed
    return f'{elapsed} ({clock_time(stamp_ns)})'


def clock_time(stamp_ns: int) -> str:
    """Write a stamp as date and time of day."""
    return f'{np.datetime64(stamp_ns // NANOSECONDS, "s")} UTC'.replace('T', ' ', 1)
