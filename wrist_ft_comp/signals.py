"""
What a recording is: samples as they were read, and their means on the thermal grid.

Channels are named like the columns of a CSV recording: ``force_x`` … ``torque_z`` (raw wrench, N
and N m), ``reference_force_x`` … (reference wrench), ``temperature_c``, ``temperature_2_c`` …,
``linear_acceleration_x`` … (specific force, m/s²: +9.81 upwards at rest), ``rotation_speed``
(rad/s).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.errors import RecordingError, SettingsError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
#: What is known of the true wrench in a recording.
Reference = Literal['unloaded', 'constant', 'payload', 'recorded']

#: Reports progress: takes the share of the work that is done, 0 to 1.
Progress = Callable[[float], None]
#: Takes stamps_ns (n,) and raw wrenches (n, 6), N and N m; returns corrected wrenches (n, 6).
Correction = Callable[[IntArray, FloatArray], FloatArray]

#: The names of a sensor, by fact: one name, but of temperature_topics one per thermometer.
#: A fact that is not known is left out.
SensorNames = Mapping[str, Sequence[str]]
SENSOR_FACTS = ('hardware_id', 'frame_id', 'wrench_topic', 'temperature_topics')

#: Axis order of every wrench array in this package.
AXES = ('force_x', 'force_y', 'force_z', 'torque_x', 'torque_y', 'torque_z')
REFERENCE_CHANNELS = tuple(f'reference_{axis}' for axis in AXES)
FORCE_CHANNELS = ('linear_acceleration_x', 'linear_acceleration_y', 'linear_acceleration_z')
ROTATION_CHANNEL = 'rotation_speed'
#: Norm of the specific force at rest, m/s².
GRAVITY = 9.807
NANOSECONDS = 1_000_000_000
#: A thermometer of a wrist reads between these, °C; 0 K and readings in kelvin lie outside.
PLAUSIBLE_C = (-100.0, 200.0)
#: Every other channel stays below this in any unit; a larger number is damaged: sums overflow.
LARGEST = 1e9
#: Means of equal readings differ by less than this share, because sums are rounded.
_ROUNDING = 1e-9
#: Stamps of two drivers that lie farther apart come from two clocks, s.
SAME_CLOCK_S = 3600.0
#: Stamps from this one on are of a clock, ns; those of many logs begin at 0.
CLOCK_NS = 10**9 * NANOSECONDS
#: Samples further apart than this many times the usual distance belong to different stretches.
_GAP_FACTOR = 10.0


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
    #: Which part of a recording counts, as ``excerpt`` reads it; all of it where these are empty.
    begin: str = ''
    end: str = ''
    exclude: tuple[str, ...] = ()

    @property
    def force_source(self) -> str:
        """Where specific force comes from: imu, tf, or an empty string."""
        return 'imu' if self.imu else 'tf' if self.gravity_frame else ''

    def __post_init__(self) -> None:
        """Refuse one name in the place of several: its letters would be topics."""
        names: object = self.temperatures
        if isinstance(names, str):
            raise SettingsError(
                f'temperatures are names of topics; got the text {names!r}. Write ({names!r},).'
            )
        if self.imu and self.gravity_frame:
            raise SettingsError(
                f'Specific force comes from the IMU {self.imu} or by the frame '
                f'{self.gravity_frame}, not from both; name one.'
            )


def axis_unit(axis: str) -> str:
    """Return the unit of a channel that is no temperature."""
    if axis in {*FORCE_CHANNELS, ROTATION_CHANNEL}:
        return 'rad/s' if axis == ROTATION_CHANNEL else 'm/s²'
    return 'N' if axis.startswith('force') else 'N m'


def is_plausible(value: float) -> bool:
    """Tell whether a thermometer may read a value, °C; NaN and infinities may not."""
    return PLAUSIBLE_C[0] < value < PLAUSIBLE_C[1]


def differ(values: FloatArray, others: FloatArray | float) -> BoolArray:
    """Mark means of different readings, and what is not a number."""
    return np.asarray(~(np.abs(values - others) <= _ROUNDING * np.abs(others)))


def temperature_channel(thermometer: int) -> str:
    """Name the channel of a thermometer, counted from 0, which is the one inside the sensor."""
    return 'temperature_c' if thermometer == 0 else f'temperature_{thermometer + 1}_c'


@dataclass(frozen=True, eq=False)
class Samples:
    """A block of samples that share their stamps, in the order in which they were recorded."""

    #: C names, as in the module's docstring.
    channels: tuple[str, ...]
    #: Time of measurement, shape (n,).
    stamps_ns: IntArray
    #: N, N m or °C, shape (n, C); not finite where the source held no number.
    values: FloatArray

    def __post_init__(self) -> None:
        expected = (len(self.stamps_ns), len(self.channels))
        if self.values.shape != expected:
            raise RecordingError(
                f'Samples of {", ".join(self.channels)} need values of shape {expected}; '
                f'got {self.values.shape}.'
            )


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
    #: Mean raw and reference wrench, N and N m, axis order AXES, shape (N, 6); NaN where there was
    #: no sample.
    wrench: FloatArray
    reference: FloatArray
    #: What was dropped while reading, in sentences.
    warnings: tuple[str, ...] = field(default=())
    #: Mean specific force as it was measured, shape (N, 3), NaN where there was no sample; None
    #: where none was recorded. Scale and bias of the accelerometer are still in it.
    specific_force: FloatArray | None = None
    #: RMS speed of rotation, rad/s, shape (N,), NaN where there was no sample; None where none was
    #: recorded.
    rotation_speed: FloatArray | None = None
    #: Cells from which on the zero is another, because it was or may have been tared there.
    steps: tuple[int, ...] = ()
    #: What the sensor was called.
    sensor: SensorNames = field(default_factory=dict)
    #: First stamp of the file, from which times count; None where that is the first cell's.
    origin_ns: int | None = None

    def __post_init__(self) -> None:
        if self.period_ns <= 0:
            raise RecordingError(
                f'A thermal cell must last longer than 0 ns; got {self.period_ns}.'
            )
        if self.temperature_c.ndim != 2 or 0 in self.temperature_c.shape:
            raise RecordingError(
                f'{self.name} holds no temperature. Expected temperature_c in at least one cell.'
            )
        cells = len(self.temperature_c)
        for what, array, shape in (
            ('measured', self.measured, self.temperature_c.shape),
            ('wrench', self.wrench, (cells, len(AXES))),
            ('reference', self.reference, (cells, len(AXES))),
            ('specific_force', self.specific_force, (cells, len(FORCE_CHANNELS))),
            ('rotation_speed', self.rotation_speed, (cells,)),
        ):
            if array is not None and array.shape != shape:
                raise RecordingError(
                    f'{what} of {self.name} must have shape {shape}; got {array.shape}.'
                )
        low, high = PLAUSIBLE_C
        if not ((self.temperature_c > low) & (self.temperature_c < high)).all():
            raise RecordingError(
                f'Temperatures of {self.name} must lie between {low:g} and {high:g} °C in every '
                f'cell; got {self.temperature_c.min():.4g} to {self.temperature_c.max():.4g}.'
            )

    def __len__(self) -> int:
        """N."""
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
    by_clock = str(np.datetime64(stamp_ns // NANOSECONDS, 's')).replace('T', ' ')
    return f'{elapsed} ({by_clock} UTC)'


def require_recordings(given: object) -> None:
    """Refuse what is no list of recordings, such as a single one, with a SettingsError."""
    if not isinstance(given, Sequence) or not all(isinstance(item, Recording) for item in given):
        raise SettingsError(
            f'Expected a list of recordings; got {type(given).__name__}. Read a file with '
            'read_recording, and put what it gives into a list: [day].'
        )


def noise_level(series: Sequence[FloatArray]) -> float:
    """Estimate the noise of slow series, robust against steps, from neighbours; 0 of none."""
    steps = np.concatenate([np.diff(values[np.isfinite(values)]) for values in series])
    if not len(steps):
        return 0.0
    # A normal variable's median absolute value is 0.6745 σ; a difference has twice the variance.
    return float(np.median(np.abs(steps)) / 0.6745 / np.sqrt(2))


def stretches(present: BoolArray, period_s: float) -> IntArray:
    """Count the stretches of a channel from 0, shape (N,); a gap belongs to the one before it."""
    at = np.flatnonzero(present)
    numbers = np.zeros(len(present), dtype=np.int64)
    if len(at) > 2:
        distance = np.diff(at)
        limit = max(_GAP_FACTOR * float(np.median(distance)), 60.0 / period_s)
        numbers[at[1:][distance > limit]] = 1
    return np.cumsum(numbers)


def part_of(report: Progress, number: int, count: int) -> Progress:
    """Turn the progress of part ``number`` of ``count`` into the progress of the whole."""
    return lambda done: report((number + done) / count)
