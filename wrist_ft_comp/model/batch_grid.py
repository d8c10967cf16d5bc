"""Samples of a recording onto the thermal grid, as a batch; empty cells as ``gap`` says."""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.model.gap import straight_lines
from wrist_ft_comp.model.ranges import PERIODS_S
from wrist_ft_comp.model.signals import (
    AXES,
    FloatArray,
    FORCE_CHANNELS,
    GRAVITY,
    IntArray,
    NANOSECONDS,
    Recording,
    REFERENCE_CHANNELS,
    ROTATION_CHANNEL,
    Samples,
    temperature_channel,
)

#: More cells than this in one recording (58 days at 1 s) can only be a broken stamp.
MAX_CELLS = 5_000_000
#: Losing more than this of a recording's beginning, where a warm-up moves most, is said, s.
_LATE_S = 60
#: Neighbouring cells at rest differ by less, m/s²; a norm at rest is doubted that is off by this
#: share, and is no gravity below this, in whatever unit (gravity is 1 in g).
_STILL, _GRAVITY_DOUBT, _LEAST_GRAVITY = 0.1, 0.1, 0.5


@dataclass
class _Tally:
    """What one group of channels delivered so far."""

    seen: int = 0
    not_finite: int = 0
    out_of_order: int = 0
    last_stamp_ns: int | None = None


class GridBuilder:
    """Reduces blocks of samples to means per cell while they are read; as ``grid_samples``."""

    def __init__(self, name: str, period_s: float = 1.0, max_bad_share: float = 0.01) -> None:
        self._name = name
        # NaN is outside every range.
        if not 1 / NANOSECONDS <= period_s <= PERIODS_S[1]:
            raise RecordingError(
                f'The thermal period must be above 0 and at most {PERIODS_S[1]:g} s; got '
                f'{period_s} s.'
            )
        self._period_ns = round(period_s * NANOSECONDS)
        self._max_bad_share = max_bad_share
        self._tallies: defaultdict[tuple[str, ...], _Tally] = defaultdict(_Tally)
        self._cells: defaultdict[str, list[IntArray]] = defaultdict(list)
        self._sums: defaultdict[str, list[FloatArray]] = defaultdict(list)
        self._counts: defaultdict[str, list[IntArray]] = defaultdict(list)

    def add(self, samples: Samples) -> None:
        """Add a block of samples; blocks of the same channels must come in order of time."""
        if not len(samples.stamps_ns):
            return
        tally = self._tallies[samples.channels]
        stamps_ns, values = samples.stamps_ns, samples.values
        tally.seen += len(stamps_ns)
        before = stamps_ns[0] - 1 if tally.last_stamp_ns is None else tally.last_stamp_ns
        highest = np.maximum.accumulate(np.concatenate(([before], stamps_ns)))
        in_order = stamps_ns > highest[:-1]
        finite = np.isfinite(values).all(axis=1)
        tally.last_stamp_ns = int(highest[-1])
        tally.out_of_order += int(np.count_nonzero(~in_order))
        tally.not_finite += int(np.count_nonzero(in_order & ~finite))
        usable = in_order & finite
        if not usable.any():
            return
        if not usable.all():
            stamps_ns, values = stamps_ns[usable], values[usable]
        cells = stamps_ns // self._period_ns
        starts = np.flatnonzero(np.diff(cells, prepend=cells[0] - 1))
        if samples.channels == (ROTATION_CHANNEL,):
            values = values**2  # its mean of a motion to and fro says nothing
        sums = np.add.reduceat(values, starts, axis=0)
        counts = np.diff(starts, append=len(cells))
        for column, channel in enumerate(samples.channels):
            self._cells[channel].append(cells[starts])
            self._sums[channel].append(sums[:, column])
            self._counts[channel].append(counts)

    def build(self) -> Recording:
        """Make the recording from everything that was added; raises as ``grid_samples``."""
        warnings = self._judge_tallies()
        thermometers = self._count_thermometers()
        wanted = [temperature_channel(j) for j in range(thermometers)]
        if not any(axis in self._cells for axis in AXES):
            raise RecordingError(
                f'{self._name} holds no wrench. Expected at least one of {", ".join(AXES)}; '
                f'got {", ".join(sorted(self._cells))}.'
            )
        first = max(int(self._cells[channel][0][0]) for channel in wanted)
        last = max(int(parts[-1][-1]) for parts in self._cells.values())
        if last - first >= MAX_CELLS:
            period_s = self._period_ns / NANOSECONDS
            raise RecordingError(
                f'Stamps of {self._name} span {(last - first) * period_s:.6g} s; at most '
                f'{MAX_CELLS} thermal cells of {period_s:g} s fit in a recording. Remove the '
                'sample with the broken stamp, or use a longer thermal period.'
            )
        warnings += tuple(self._late_thermometer(wanted, first))
        dense = {channel: self._dense(channel, first, last) for channel in self._cells}
        temperature_c = np.stack([dense[channel] for channel in wanted], axis=1)
        absent = np.full(last - first + 1, np.nan)
        force = None
        if any(channel in dense for channel in FORCE_CHANNELS):
            force = np.stack([dense.get(c, absent) for c in FORCE_CHANNELS], axis=1)
            force, doubts = _scale_to_gravity(force, self._name)
            warnings += doubts
        return Recording(
            name=self._name, period_ns=self._period_ns, first_cell=first,
            temperature_c=self._bridge(temperature_c, wanted, first),
            measured=np.isfinite(temperature_c),
            wrench=np.stack([dense.get(axis, absent) for axis in AXES], axis=1),
            reference=np.stack([dense.get(c, absent) for c in REFERENCE_CHANNELS], axis=1),
            warnings=warnings, specific_force=force,
            rotation_speed=np.sqrt(dense[ROTATION_CHANNEL]) if ROTATION_CHANNEL in dense else None,
        )  # fmt: skip

    def _judge_tallies(self) -> tuple[str, ...]:
        """Report what was dropped; refuse when it is too much."""
        warnings = []
        for channels, tally in self._tallies.items():
            bad = tally.not_finite + tally.out_of_order
            if not bad:
                continue
            what = channels[0] if len(channels) == 1 else f'{channels[0]} … {channels[-1]}'
            sentence = (
                f'{what} of {self._name}: {tally.not_finite} of {tally.seen} samples are not '
                f'finite and {tally.out_of_order} have a stamp that does not increase'
            )
            if bad > self._max_bad_share * tally.seen:
                raise RecordingError(
                    f'{sentence}; at most {self._max_bad_share:.1%} may be unusable. '
                    'Record again, or remove those samples.'
                )
            warnings.append(f'{sentence}; they were dropped.')
        return tuple(warnings)

    def _late_thermometer(self, channels: list[str], first: int) -> Iterator[str]:
        """Name the thermometer that the recording had to wait for, where it waited for long."""
        wrenches = [cells for axis in AXES for cells in self._cells.get(axis, [])]
        lost = np.unique(np.concatenate([cells[cells < first] for cells in wrenches]))
        lost_s = len(lost) * self._period_ns / NANOSECONDS
        if lost_s > _LATE_S:
            late = next(j for j, name in enumerate(channels) if self._cells[name][0][0] == first)
            yield (
                f'Thermometer {late + 1} of {self._name} came after {lost_s:.0f} s of wrenches, '
                'which were left out; the sensor is taken as soaked from there on. If it was '
                'warming up by then, record again, with all thermometers from the beginning.'
            )

    def _count_thermometers(self) -> int:
        """Count thermometers that delivered, refusing a gap in their numbering."""
        numbers = [j for j in range(100) if temperature_channel(j) in self._cells]
        if numbers != list(range(len(numbers))) or not numbers:
            missing = temperature_channel(next(j for j in range(101) if j not in numbers))
            raise RecordingError(
                f'{self._name} holds no usable {missing}. Expected a sample in at least one '
                'thermal cell; record the temperature beside the wrench.'
            )
        return len(numbers)

    def _dense(self, channel: str, first: int, last: int) -> FloatArray:
        """Means of a channel on cells first … last, shape (last - first + 1,), NaN where none."""
        cells = np.concatenate(self._cells[channel])
        inside = (cells >= first) & (cells <= last)
        at = cells[inside] - first
        size = last - first + 1
        sums = np.bincount(at, np.concatenate(self._sums[channel])[inside], size)
        counts = np.bincount(at, np.concatenate(self._counts[channel])[inside], size)
        means = np.full(size, np.nan)
        np.divide(sums, counts, out=means, where=counts > 0)
        return means

    def _bridge(self, temperature_c: FloatArray, channels: list[str], first: int) -> FloatArray:
        """Fill empty cells by the rule for gaps, shape (N, J), also from before the first cell."""
        bridged = np.empty_like(temperature_c)
        for j, channel in enumerate(channels):
            cells = np.concatenate(self._cells[channel])
            begin = int(cells[cells <= first].max())
            means = self._dense(channel, begin, first + len(bridged) - 1)
            at = np.flatnonzero(np.isfinite(means))
            bridged[:, j] = straight_lines(begin + at, means[at], first, len(bridged))
        return bridged


def _scale_to_gravity(force: FloatArray, name: str) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Scale specific force by its norm at rest, because accelerometers are off by some percent."""
    # Shape (N, 3), NaN in cells without a sample of all three; None where it can't be gravity. The
    # sentences are doubts.
    # At rest a cell is like its neighbour; where it hardly ever is, the quietest half has to do.
    change = np.linalg.norm(np.diff(force, axis=0, prepend=force[:1]), axis=1)
    steps = change[np.isfinite(change)]
    its = f'The specific force of {name} has'
    if not len(steps):
        missing = 'no cell with linear_acceleration_x, _y and _z; it counts as absent.'
        return None, (f'{its} {missing}',)
    at_rest = change <= max(_STILL, float(np.median(steps)))
    norm = float(np.median(np.linalg.norm(force[at_rest], axis=1)))
    if norm < _LEAST_GRAVITY:
        doubt = (
            f'{its} a norm of {norm:.3g} at rest, where gravity makes {GRAVITY}; it counts as '
            'absent. Record an accelerometer that feels gravity (sensor_msgs/Imu, '
            'linear_acceleration), not the motion alone.'
        )
        return None, (doubt,)
    off = norm / GRAVITY - 1
    doubt = (
        f'{its} a norm of {norm:.4g} at rest, {off:+.0%} off {GRAVITY} m/s²; it was scaled. If it '
        'is in another unit, that is all; if not, calibrate the accelerometer, because a payload '
        'is as wrong as it is.'
    )
    known = np.isfinite(force).all(axis=1, keepdims=True)
    scaled = np.where(known, force * (GRAVITY / norm), np.nan)
    return scaled, (doubt,) if abs(off) > _GRAVITY_DOUBT else ()


def grid_samples(
    blocks: Iterable[Samples],
    *,
    name: str = 'recording',
    period_s: float = 1.0,
    max_bad_share: float = 0.01,
) -> Recording:
    """Average blocks of samples, those of a channel in order of time, onto the thermal grid."""
    # Cells last period_s. Up to a share of a channel's samples may be unusable (not finite, or a
    # stamp that does not increase): they are dropped and reported. RecordingError when there are
    # more, a thermometer or every axis is missing, or the stamps span more than any recording.
    builder = GridBuilder(name, period_s, max_bad_share)
    for block in blocks:
        builder.add(block)
    return builder.build()
