"""Averages a recording over thermal cells, as a batch; ``gap`` fills the empty ones."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import product

import numpy as np

from wrist_ft_comp.channels import (
    AXES,
    FORCE_CHANNELS,
    GRAVITY,
    REFERENCE_CHANNELS,
    ROTATION_CHANNEL,
    temperature_channel,
)
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.ranges import PERIODS_S
from wrist_ft_comp.recording import Recording, Samples
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS, SAME_CLOCK_S
from wrist_ft_comp.stream.gap import fill_gaps
from wrist_ft_comp.stream.sample_checks import SampleChecks, UNIT_OF_STAMPS
from wrist_ft_comp.wire.temperature_source import TemperatureSource

#: Largest number of cells times one more than the thermometers: 24 days at 1 s with one
#: thermometer, 10 days with four. A calibration from that many takes 1 GB.
MAX_NUMBERS = 4_200_000
#: A longer recording is doubted, s: an hour in milliseconds, read as seconds, is 42 days.
_LONG_S = 7 * 86_400
#: A thermometer that reports later is warned of, s: a warm-up is fastest at its beginning.
_LATE_S = 60
#: At rest, specific force changes by less from cell to cell, m/s².
_STILL = 0.1
#: A norm at rest is doubted where it differs from gravity by a larger share.
_GRAVITY_DOUBT = 0.1
#: A smaller norm at rest is not that of gravity in any unit; in g it is 1.
_LEAST_GRAVITY = 0.5


def most_cells(thermometers: int) -> int:
    """Tell how many thermal cells a recording may span."""
    return MAX_NUMBERS // (1 + thermometers)


class GridBuilder:
    """Averages blocks of samples per cell while they are read; settings as in grid_samples."""

    def __init__(
        self,
        name: str,
        period_s: float = 1.0,
        max_bad_share: float = 0.01,
        temperatures: Sequence[TemperatureSource] = (),
    ) -> None:
        self._name, self._is_table = name, not temperatures
        # NaN is outside every range.
        if not 1 / NANOSECONDS <= period_s <= PERIODS_S[1]:
            raise RecordingError(
                f'The thermal period must be above 0 and at most {PERIODS_S[1]:g} s; got '
                f'{period_s} s.'
            )
        self._period_ns = round(period_s * NANOSECONDS)
        self._max_bad_share = max_bad_share
        #: What came, and what of it was dropped.
        self.checks = SampleChecks(name, temperatures)
        #: By channel, for each block: numbers of its cells, ascending, sums and counts in them.
        self._blocks: defaultdict[str, list[tuple[IntArray, FloatArray, IntArray]]]
        self._blocks = defaultdict(list)

    def add(self, samples: Samples) -> None:
        """Add a block of samples; blocks of the same channels must come in order of time."""
        spikes = self.checks.tallies[samples.channels].spikes
        wrong_starts = spikes.wrong_starts
        samples = self.checks.admit(samples)
        if spikes.wrong_starts > wrong_starts:
            self._blocks.pop(samples.channels[0], None)
        values = samples.values
        if not len(values):
            return
        cells = samples.stamps_ns // self._period_ns
        starts = np.flatnonzero(np.diff(cells, prepend=cells[0] - 1))
        if samples.channels == (ROTATION_CHANNEL,):
            values = values**2  # the mean speed of a motion to and fro says nothing
        sums = np.add.reduceat(values, starts, axis=0)
        counts = np.diff(starts, append=len(cells))
        for column, channel in enumerate(samples.channels):
            self._blocks[channel].append((cells[starts], sums[:, column], counts))

    def build(self) -> Recording:
        """Make the recording from everything that was added; raises as ``grid_samples``."""
        warnings = []
        for sentence, is_too_much in self.checks.judge(self._max_bad_share):
            if is_too_much:
                raise RecordingError(sentence)
            warnings.append(sentence)
        thermometers = self._thermometers()
        if self._blocks.keys().isdisjoint(AXES):
            raise RecordingError(
                f'{self._name} holds no wrench. Expected at least one of {", ".join(AXES)}; '
                f'got {", ".join(sorted(self._blocks))}.'
            )
        first = max(self._ends(channel)[0] for channel in thermometers)
        last = max(self._ends(channel)[1] for channel in self._blocks)
        warnings += self._judge_span(last + 1 - first, thermometers)
        warnings += self._late_thermometer(thermometers, first)
        temperature_c = self._table(thermometers, first, last)
        before_c = []
        for channel in thermometers:
            cells = np.concatenate([cells for cells, _, _ in self._blocks[channel]])
            # One cell of what lies before the first: it may be years away, by a broken stamp.
            begin = int(cells[cells <= first].max())
            before_c.append(self._means(channel, begin, begin)[0])
        force, speed = None, None
        if not self._blocks.keys().isdisjoint(FORCE_CHANNELS):
            measured = self._table(FORCE_CHANNELS, first, last)
            force, doubts = _doubt_gravity(measured, self._name)
            warnings += doubts
        if ROTATION_CHANNEL in self._blocks:
            speed = np.sqrt(self._means(ROTATION_CHANNEL, first, last))
        return Recording(
            name=self._name, period_ns=self._period_ns, first_cell=first,
            temperature_c=fill_gaps(temperature_c, np.array(before_c), self._period_ns),
            measured=np.isfinite(temperature_c),
            wrench=self._table(AXES, first, last),
            reference=self._table(REFERENCE_CHANNELS, first, last),
            warnings=tuple(warnings), specific_force=force, rotation_speed=speed)  # fmt: skip

    def _ends(self, channel: str) -> tuple[int, int]:
        """Find the first and the last cell of a channel."""
        blocks = self._blocks[channel]
        return int(blocks[0][0][0]), int(blocks[-1][0][-1])

    def _judge_span(self, cells: int, thermometers: Sequence[str]) -> Iterator[str]:
        """Refuse stamps that are no times of one recording; doubt a long one."""
        remedy = UNIT_OF_STAMPS * self._is_table
        span_s, period_s = cells * self._period_ns / NANOSECONDS, self._period_ns / NANOSECONDS
        for thermometer, axis in product(thermometers, filter(self._blocks.__contains__, AXES)):
            begins, ends = zip(self._ends(thermometer), self._ends(axis), strict=True)
            apart = max(begins) - min(ends)
            if apart * period_s > SAME_CLOCK_S:
                raise RecordingError(
                    f'Stamps of {axis} and {thermometer} of {self._name} are '
                    f'{apart * period_s:.0f} s apart; both drivers must use one clock. Record '
                    'both at the same time.'
                )
        most = most_cells(len(thermometers))
        if cells > most:
            raise RecordingError(
                f'Stamps of {self._name} span {span_s:.6g} s; at most {most} thermal cells of '
                f'{period_s:g} s fit in a recording. Remove the sample with the broken stamp, '
                f'use a longer thermal period, or split the recording. {remedy}'
            )
        if remedy and span_s > _LONG_S:
            yield f'{self._name} lasts {span_s / 86_400:.1f} days. {remedy}'

    def _late_thermometer(self, channels: Sequence[str], first: int) -> Iterator[str]:
        """Name the thermometer that the recording had to wait for, where it waited for long."""
        wrenches = [cells for axis in AXES for cells, _, _ in self._blocks.get(axis, [])]
        lost = np.unique(np.concatenate([cells[cells < first] for cells in wrenches]))
        lost_s = len(lost) * self._period_ns / NANOSECONDS
        if lost_s > _LATE_S:
            late = next(j for j, name in enumerate(channels) if self._ends(name)[0] == first)
            yield (
                f'Thermometer {late + 1} of {self._name} came after {lost_s:.0f} s of wrenches, '
                'of which no drift is known: nothing is learnt, judged or tared before it came, '
                'and compensate writes them with its first drift. The sensor is taken as soaked '
                'from there on. If it was warming up by then, record again, with all '
                'thermometers from the beginning.'
            )

    def _thermometers(self) -> list[str]:
        """List the channels of the thermometers, refusing a gap in their numbering."""
        found = [name for j in range(100) if (name := temperature_channel(j)) in self._blocks]
        expected = [temperature_channel(j) for j in range(len(found) or 1)]
        for channel in expected:
            if channel not in found:
                raise RecordingError(
                    f'{self._name} holds no usable {channel}. Expected a sample in at least one '
                    'thermal cell; record the temperature beside the wrench. A node keeps none '
                    'before all of its thermometers have reported.'
                )
        return found

    def _table(self, channels: Sequence[str], first: int, last: int) -> FloatArray:
        """Lay out means of channels, shape (n, C), NaN where none; read-only if all are NaN."""
        if self._blocks.keys().isdisjoint(channels):
            return np.broadcast_to(np.nan, (last - first + 1, len(channels)))
        return np.stack([self._means(channel, first, last) for channel in channels], axis=1)

    def _means(self, channel: str, first: int, last: int) -> FloatArray:
        """Means of a channel on cells first … last, shape (last - first + 1,), NaN where none."""
        size = last - first + 1
        means = np.full(size, np.nan)
        if channel in self._blocks:
            cells, sums, counts = map(np.concatenate, zip(*self._blocks[channel], strict=True))
            inside = (cells >= first) & (cells <= last)
            at = cells[inside] - first
            sums, counts = (np.bincount(at, part[inside], size) for part in (sums, counts))
            np.divide(sums, counts, out=means, where=counts > 0)
        return means


def _doubt_gravity(force: FloatArray, name: str) -> tuple[FloatArray | None, list[str]]:
    """
    Doubt specific force, shape (N, 3), whose norm at rest is not gravity's.

    Gives it as measured, NaN in cells without a sample of all three, or None where it can't be
    gravity; and doubts in sentences.
    """
    # At rest a cell is like its neighbour; where it hardly ever is, the quietest half has to do.
    change = np.linalg.norm(np.diff(force, axis=0, prepend=force[:1]), axis=1)
    known, subject = change[np.isfinite(change)], f'The specific force of {name} has'
    if not len(known):
        missing = 'no cell with linear_acceleration_x, _y and _z; it counts as absent.'
        return None, [f'{subject} {missing}']
    at_rest = change <= max(_STILL, float(np.median(known)))
    norm = float(np.median(np.linalg.norm(force[at_rest], axis=1)))
    off = norm / GRAVITY - 1
    force = np.where(np.isfinite(force).all(axis=1, keepdims=True), force, np.nan)
    if abs(off) <= _GRAVITY_DOUBT:
        return force, []
    if norm >= _LEAST_GRAVITY:
        doubt = (
            f'{subject} a norm of {norm:.4g} at rest, {off:+.0%} off {GRAVITY} m/s², which a '
            'payload takes for its scale. If it is in another unit, that is all; if not, '
            'calibrate the accelerometer, because a payload is as wrong as it is.'
        )
        return force, [doubt]
    doubt = (
        f'{subject} a norm of {norm:.3g} at rest, where gravity makes {GRAVITY}; it counts as '
        'absent. Record an accelerometer that feels gravity (sensor_msgs/Imu, '
        'linear_acceleration), not the motion alone.'
    )
    return None, [doubt]


def grid_samples(
    blocks: Iterable[Samples],
    *,
    name: str = 'recording',
    period_s: float = 1.0,
    max_bad_share: float = 0.01,
    temperatures: Sequence[TemperatureSource] = (),
) -> Recording:
    """
    Average blocks of samples, those of a channel in order of time, onto the thermal grid.

    Cells last ``period_s``. Up to ``max_bad_share`` of a channel's samples may be unusable: they
    are dropped and reported. ``temperatures`` are where those of a bag come from. RecordingError
    when more samples are unusable, a thermometer or every axis is missing, or the stamps are no
    times of one recording.
    """
    builder = GridBuilder(name, period_s, max_bad_share, temperatures)
    for block in blocks:
        builder.add(block)
    return builder.build()
