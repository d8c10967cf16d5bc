"""
Whether the samples of a recording can be used: refusals and doubts; then means on thermal cells.

What no sensor measures is dropped and counted, by the limits of the node; ``gaps_and_restarts``
fills the cells without a sample.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
import math
from typing import NamedTuple

import numpy as np

from wrist_ft_comp import channels as channel_names
from wrist_ft_comp.channels import AXES, FORCE_CHANNELS, ROTATION_CHANNEL, temperature_channel
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recording import PERIODS_S, Recording, Samples
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.stream.clock import in_order, NO_TIME, SAME_CLOCK_S
from wrist_ft_comp.stream.gaps_and_restarts import fill_gaps
from wrist_ft_comp.stream.temperature_jumps import SpikeFilter
from wrist_ft_comp.units import UNIT_REMEDY

#: Largest number of cells times one more than the thermometers: 24 days at 1 s with one
#: thermometer, 10 days with four. A calibration from that many takes 1 GB.
MAX_NUMBERS = 4_200_000
#: A longer recording is doubted, s: an hour in milliseconds, read as seconds, is 42 days.
_LONG_S = 7 * 86_400
#: A thermometer that reports later is warned of, s: a warm-up is fastest at its beginning.
_LATE_S = 60
#: A smaller median norm of specific force is not that of gravity in any unit; in g it is 1.
_LEAST_GRAVITY = 0.5
#: No force/torque sensor samples faster: the fastest that robots carry do 8 kHz, Hz.
_FASTEST_HZ = 50_000.0
#: Up to this many samples may lie closer together: a burst.
_BURST = 100
#: What to do where stamps may be in another unit than the one they are read in.
UNIT_OF_STAMPS = (
    'Is the unit of the stamps right? Another one is named by the column, such as stamp_ms, or, '
    "of another program's log, by --time ms."
)


class CellSums(NamedTuple):
    """What the samples of a channel are in cells: numbers, sums and counts, shape (n,)."""

    cells: IntArray
    sums: FloatArray
    counts: IntArray

    def means(self, first: int, last: int) -> FloatArray:
        """Means on cells first … last, shape (last - first + 1,), NaN where none."""
        size, inside = last - first + 1, (self.cells >= first) & (self.cells <= last)
        at = self.cells[inside] - first
        sums, counts = (np.bincount(at, part[inside], size) for part in self[1:])
        return np.asarray(sums / np.where(counts > 0, counts, np.nan))


@dataclass(eq=False)
class _Group:
    """Channels that share their samples: sums over cells, and what was dropped, and why."""

    channels: tuple[str, ...]
    period_ns: int
    samples: int = 0
    out_of_order: int = 0
    #: Readings that no sensor makes, and the first number among them, NaN where none is one.
    strange: int = 0
    first_strange: float = math.nan
    #: First and last stamp of the samples that can be used, ns.
    first_ns: int = NO_TIME
    last_ns: int = NO_TIME
    #: Of a thermometer: readings that changed faster than metal can.
    spikes: SpikeFilter = field(default_factory=SpikeFilter)
    #: Of every block: cells, ascending, sums, shape (n, C), and counts.
    sums: list[tuple[IntArray, FloatArray, IntArray]] = field(default_factory=list)

    def add(self, stamps_ns: IntArray, values: FloatArray) -> None:
        """Sum up a block of samples, (n,) and (n, C), but for those that are dropped."""
        low, high = np.array([channel_names.limits_of(channel) for channel in self.channels]).T
        plausible = ((values > low) & (values < high)).all(axis=1)
        ordered = in_order(stamps_ns, self.last_ns)
        self.samples += len(values)
        self.out_of_order += int(np.count_nonzero(~ordered))
        strange = values[ordered & ~plausible]
        self.strange += len(strange)
        numbers = strange[np.isfinite(strange).all(axis=1)]
        if len(numbers) and math.isnan(self.first_strange):
            self.first_strange = float(numbers[0][np.argmax(np.abs(numbers[0]))])
        usable = ordered & plausible
        stamps_ns, values = stamps_ns[usable], values[usable]
        if len(values) and self.channels[0].startswith('temperature'):
            wrong_starts = self.spikes.wrong_starts
            stamps_ns, column = self.spikes.admit_all(stamps_ns, values[:, 0])
            values = column[:, np.newaxis]
            if self.spikes.wrong_starts > wrong_starts:
                self.sums.clear()
        if not len(values):
            return
        self.first_ns = int(stamps_ns[0]) if self.first_ns == NO_TIME else self.first_ns
        self.last_ns = int(stamps_ns[-1])
        if ROTATION_CHANNEL in self.channels:
            values = values**2  # the mean speed of a motion to and fro says nothing
        cells = stamps_ns // self.period_ns
        starts = np.flatnonzero(np.diff(cells, prepend=cells[0] - 1))
        counts = np.diff(starts, append=len(cells))
        self.sums.append((cells[starts], np.add.reduceat(values, starts, axis=0), counts))

    def judge(self, name: str, max_bad_share: float) -> Iterator[str]:
        """Say what was dropped and what is doubtful; RecordingError where too much was."""
        first, *others = self.channels
        title = f'{first} … {others[-1]} of {name}' if others else f'{first} of {name}'
        of_temperature = first.startswith('temperature')
        if of_temperature and not self.samples:
            yield f'{title} holds no sample; it is left out.'
        if dropped := self.strange + self.out_of_order:
            why_strange = channel_names.why_unusable(first, self.first_strange)
            ran_back = 'have no stamp, or one that ran back'
            reasons = (self.strange, f'are {why_strange}'), (self.out_of_order, ran_back)
            counts = (f'{n} of {self.samples} samples {reason}' for n, reason in reasons if n)
            why = f'{title}: {" and ".join(counts)}; '
            if dropped > max_bad_share * self.samples:
                remedy = 'Record again, or remove those samples.'
                if of_temperature and not math.isnan(self.first_strange):
                    remedy = UNIT_REMEDY
                raise RecordingError(f'{why}at most {max_bad_share:.1%} may be unusable. {remedy}')
            yield f'{why}they were dropped.'
        if self.spikes.first:
            stamp_ns, reading_c = self.spikes.first
            yield (
                f'{title}: {self.spikes.dropped} of {self.samples} samples changed faster than '
                f'metal can, first at stamp {stamp_ns / NANOSECONDS:.0f} s with {reading_c:.1f} '
                '°C; left out. Is it loose?'
            )
        used, span_ns = self.samples - dropped, self.last_ns - self.first_ns
        if used > _BURST and span_ns * _FASTEST_HZ < used * NANOSECONDS:
            raise RecordingError(
                f'{title}: {used} samples within {span_ns / NANOSECONDS:.3g} s; no sensor makes '
                f'more than {_FASTEST_HZ:g} a second. {UNIT_OF_STAMPS}'
            )


def grid_samples(
    blocks: Iterable[Samples],
    *,
    name: str = 'recording',
    period_s: float = 1.0,
    max_bad_share: float = 0.01,
    of_bag: bool = False,
) -> Recording:
    """
    Average blocks of samples, those of a channel in order of time, onto the thermal grid.

    Cells last ``period_s``. Up to ``max_bad_share`` of a channel's samples may be unusable: they
    are dropped and reported. RecordingError when more samples are unusable, a thermometer or every
    axis is missing, or the stamps are no times of one recording.
    """
    if not 1 / NANOSECONDS <= period_s <= PERIODS_S[1]:  # NaN is outside every range
        raise RecordingError(
            f'The thermal period must be above 0 and at most {PERIODS_S[1]:g} s; got {period_s} s.'
        )
    period_ns = round(period_s * NANOSECONDS)
    groups: dict[tuple[str, ...], _Group] = {}
    for block in blocks:
        group = groups.setdefault(block.channels, _Group(block.channels, period_ns))
        group.add(block.stamps_ns, block.values)
    warnings, parts = list[str](), defaultdict[str, list[CellSums]](list)
    for group in groups.values():
        warnings += group.judge(name, max_bad_share)
        for cells, sums, counts in group.sums:
            for channel, column in zip(group.channels, sums.T, strict=True):
                parts[channel].append(CellSums(cells, column, counts))
    found = {
        channel: CellSums(*map(np.concatenate, zip(*of_channel, strict=True)))
        for channel, of_channel in parts.items()
    }
    count = sum(channel.startswith('temperature') for channel in found)
    channels = [temperature_channel(j) for j in range(max(count, 1))]
    if missing := [channel for channel in channels if channel not in found]:
        raise RecordingError(
            f'{name} holds no usable {missing[0]}. Record the temperature beside the wrench; a '
            'node keeps none before all of its thermometers have reported.'
        )
    if found.keys().isdisjoint(AXES):
        raise RecordingError(
            f'{name} holds no wrench. Expected at least one of {", ".join(AXES)}; got '
            f'{", ".join(sorted(found))}.'
        )
    first = max(int(found[channel].cells.min()) for channel in channels)
    last = max(int(sums.cells.max()) for sums in found.values())
    remedy = '' if of_bag else UNIT_OF_STAMPS
    warnings += _judge_channels(found, name, period_s, (first, last), remedy)

    def table(*channels: str) -> FloatArray:
        """Lay out means of channels, shape (n, C), NaN where none; read-only if all are NaN."""
        nothing: FloatArray = np.broadcast_to(np.nan, (last - first + 1, len(channels)))
        if found.keys().isdisjoint(channels):
            return nothing
        columns = [found[c].means(first, last) if c in found else nothing[:, 0] for c in channels]
        return np.stack(columns, axis=1)

    temperature_c = table(*channels)
    # Those that were silent in the first cell keep what they read last, perhaps years before.
    before_c = np.zeros(len(channels))
    for j, channel in enumerate(channels):
        cells = found[channel].cells
        newest = int(cells[cells <= first].max())
        before_c[j] = found[channel].means(newest, newest)[0]
    force = speed = None
    if not found.keys().isdisjoint(FORCE_CHANNELS):
        force = table(*FORCE_CHANNELS)
        norms = np.linalg.norm(force, axis=1)
        force[np.isnan(norms)] = np.nan
        norms = norms[np.isfinite(norms)]
        if not len(norms) or np.median(norms) < _LEAST_GRAVITY:
            force = None
            warnings.append(
                f'The accelerometer of {name} does not feel gravity, and counts as absent. Record '
                'all three of linear_acceleration (sensor_msgs/Imu), not the motion alone.'
            )
    if ROTATION_CHANNEL in found:
        speed = np.sqrt(found[ROTATION_CHANNEL].means(first, last))
    return Recording(
        name=name, period_ns=period_ns, first_cell=first,
        temperature_c=fill_gaps(temperature_c, before_c, period_ns),
        measured=np.isfinite(temperature_c), wrench=table(*AXES),
        reference=table(*channel_names.REFERENCE_CHANNELS), warnings=tuple(warnings),
        specific_force=force, rotation_speed=speed)  # fmt: skip


def _judge_channels(
    found: dict[str, CellSums], name: str, period_s: float, ends: tuple[int, int], remedy: str
) -> Iterator[str]:
    """Drop axes that are dead beside others, refuse broken stamps, and doubt what came late."""
    first, last = ends
    axes = [axis for axis in AXES if axis in found]
    dead = [axis for axis in axes if not found[axis].sums.any()]
    if dead and dead != axes:
        yield (
            f'{", ".join(dead)} of {name}: exactly 0 in every sample; counted as absent. Where '
            'such an axis exists, it is broken.'
        )
        for axis in dead:
            axes.remove(axis)
            del found[axis]
    thermometers = [channel for channel in found if channel.startswith('temperature')]
    for thermometer in thermometers:
        for axis in axes:
            one, other = found[thermometer].cells, found[axis].cells
            apart_s = (max(one.min(), other.min()) - min(one.max(), other.max())) * period_s
            if apart_s > SAME_CLOCK_S:
                raise RecordingError(
                    f'Stamps of {axis} and {thermometer} of {name} are {apart_s:.0f} s apart; '
                    'both drivers must use one clock. Record both at the same time.'
                )
    span_s, most = (last + 1 - first) * period_s, MAX_NUMBERS // (1 + len(thermometers))
    if last + 1 - first > most:
        raise RecordingError(
            f'Stamps of {name} span {span_s:.6g} s; at most {most} thermal cells of {period_s:g} '
            f's fit. Remove the broken stamp, or split it, or choose longer cells. {remedy}'
        )
    if remedy and span_s > _LONG_S:
        yield f'{name} lasts {span_s / 86_400:.1f} days. {remedy}'
    cells = np.unique(np.concatenate([found[axis].cells for axis in axes]))
    lost_s = np.count_nonzero(cells < first) * period_s
    if lost_s > _LATE_S:
        begins = [found[temperature_channel(j)].cells.min() for j in range(len(thermometers))]
        yield (
            f'Thermometer {np.argmax(begins) + 1} of {name} came {lost_s:.0f} s after the first '
            'wrench. What was before it is not used. If the sensor was already warming up, record '
            'again, with all thermometers from the beginning.'
        )
