"""
Averages a recording over thermal cells, as a batch, of samples that a sensor can have measured.

What no sensor measures is dropped and counted, by the limits of the node; ``thermal_memory`` fills
the cells without a sample.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
import math
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.channels import (
    AXES,
    FORCE_CHANNELS,
    LARGEST,
    PLAUSIBLE_C,
    REFERENCE_CHANNELS,
    ROTATION_CHANNEL,
    temperature_channel,
)
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.ranges import PERIODS_S
from wrist_ft_comp.recording import Recording, Samples
from wrist_ft_comp.series import BoolArray, FloatArray, IntArray, NANOSECONDS, SAME_CLOCK_S
from wrist_ft_comp.stream.clock import in_order, NO_TIME
from wrist_ft_comp.stream.thermal_memory import fill_gaps
from wrist_ft_comp.stream.thermometer_faults import SpikeFilter
from wrist_ft_comp.wire.temperature_source import TemperatureSource, unit_remedy

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
#: A thermometer that always reads between these, °C, is probably one of 15 to 60 °C in °F.
_HOT_C = (59.0, 140.0)
#: What to do where stamps may be in another unit than the one they are read in.
UNIT_OF_STAMPS = (
    'Is the unit of the stamps right? Another one is named by the column, such as stamp_ms, or, '
    "of another program's log, by --time ms."
)


def why_unusable(channel: str, value: float) -> str:
    """Say what is wrong with readings of a channel such as a value that no sensor makes."""
    if not math.isfinite(value):
        return 'not finite'
    (low, high), unit = _limits(channel), ' °C' if _is_temperature((channel,)) else ''
    return f'outside {low:g} to {high:g}{unit}, which no sensor reads, such as {value:.4g}{unit}'


def _limits(channel: str) -> tuple[float, float]:
    return PLAUSIBLE_C if _is_temperature((channel,)) else (-LARGEST, LARGEST)


def _is_temperature(channels: tuple[str, ...]) -> bool:
    return channels[0].startswith('temperature')


@dataclass
class Tally:
    """Samples of a group of channels: how many came, how many were dropped, and why."""

    samples: int = 0
    not_finite: int = 0
    out_of_order: int = 0
    #: Readings that no sensor makes, and the first of them.
    implausible: int = 0
    first_implausible: float = math.nan
    #: Of the samples that can be used: first and last stamp, ns, least and largest reading.
    first_ns: int = NO_TIME
    last_ns: int = NO_TIME
    least: float = math.inf
    largest: float = -math.inf
    #: Of a thermometer: readings that metal cannot have gone to.
    spikes: SpikeFilter = field(default_factory=SpikeFilter)


class SampleChecks:
    """Drops and counts samples that no sensor can have measured; sources are those of a bag."""

    def __init__(self, name: str, sources: Sequence[TemperatureSource] = ()) -> None:
        self._name = name
        self._sources = {temperature_channel(j): source for j, source in enumerate(sources)}
        #: By the channels that share their samples.
        self.tallies: defaultdict[tuple[str, ...], Tally] = defaultdict(Tally)

    def admit(self, samples: Samples) -> Samples:
        """Take a block, in order of time; returns the part of it that can be used."""
        stamps_ns, values = samples.stamps_ns, samples.values
        tally = self.tallies[samples.channels]
        low, high = np.array([_limits(channel) for channel in samples.channels]).T
        finite = np.isfinite(values).all(axis=1)
        plausible = ((values > low) & (values < high)).all(axis=1)
        ordered = in_order(stamps_ns, tally.last_ns)
        tally.samples += len(values)
        tally.out_of_order += int(np.count_nonzero(~ordered))
        tally.not_finite += int(np.count_nonzero(ordered & ~finite))
        strange = values[ordered & finite & ~plausible]
        if len(strange) and not tally.implausible:
            tally.first_implausible = float(strange[0][np.argmax(np.abs(strange[0]))])
        tally.implausible += len(strange)
        usable = ordered & plausible
        if not usable.all():
            stamps_ns, values = stamps_ns[usable], values[usable]
        if _is_temperature(samples.channels) and values.shape[1] == 1 and len(values):
            stamps_ns, column = tally.spikes.admit_all(stamps_ns, values[:, 0])
            values = column[:, np.newaxis]
        if len(values):
            tally.first_ns = int(stamps_ns[0]) if tally.first_ns == NO_TIME else tally.first_ns
            tally.last_ns = int(stamps_ns[-1])
            tally.least = min(tally.least, float(values.min()))
            tally.largest = max(tally.largest, float(values.max()))
        return Samples(samples.channels, stamps_ns, values)

    def judge(self, max_bad_share: float = 0.01) -> Iterator[tuple[str, bool]]:
        """Give sentences about dropped and doubtful samples; True where they are too many."""
        for channels, tally in self.tallies.items():
            of_temperature = _is_temperature(channels)
            title = channels[0] if len(channels) == 1 else f'{channels[0]} … {channels[-1]}'
            title = f'{title} of {self._name}'
            if of_temperature and not tally.samples:
                yield f'{title} holds no sample; it is left out.', False

            reasons = (
                (tally.not_finite, 'are not finite'),
                (tally.out_of_order, 'have a stamp that does not increase'),
                (tally.implausible, f'are {why_unusable(channels[0], tally.first_implausible)}'),
            )
            dropped = sum(count for count, _ in reasons)
            if dropped:
                (first, why), *others = [pair for pair in reasons if pair[0]]
                counts = [why, *(f'{count} {reason}' for count, reason in others)]
                sentence = f'{title}: {first} of {tally.samples} samples {" and ".join(counts)}; '
                if dropped <= max_bad_share * tally.samples:
                    yield f'{sentence}they were dropped.', False
                else:
                    remedy = 'Record again, or remove those samples.'
                    if of_temperature and 2 * tally.implausible > dropped:
                        remedy = self._remedy(channels[0], tally.first_implausible)
                    yield f'{sentence}at most {max_bad_share:.1%} may be unusable. {remedy}', True

            if tally.spikes.first:
                stamp_ns, reading_c = tally.spikes.first
                sentence = (
                    f'{title}: {tally.spikes.dropped} of {tally.samples} samples are where metal '
                    f'cannot have gone, first at stamp {stamp_ns / NANOSECONDS:.0f} s with '
                    f'{reading_c:.1f} °C; left out.'
                )
                yield sentence, False
            used, span_ns = tally.samples - dropped, tally.last_ns - tally.first_ns
            if used > _BURST and span_ns * _FASTEST_HZ < used * NANOSECONDS:
                sentence = (
                    f'{title}: {used} samples within {span_ns / NANOSECONDS:.3g} s; no sensor '
                    f'makes more than {_FASTEST_HZ:g} a second. {UNIT_OF_STAMPS}'
                )
                yield sentence, True
            if of_temperature and _HOT_C[0] < tally.least <= tally.largest < _HOT_C[1]:
                sentence = (
                    f'{title} is hot throughout: {tally.least:.1f} to {tally.largest:.1f} °C. '
                    f'{self._remedy(channels[0], tally.least)}'
                )
                yield sentence, False

    def _remedy(self, channel: str, value_c: float) -> str:
        """Say how to name a temperature that is probably in another unit."""
        if source := self._sources.get(channel):
            return unit_remedy(value_c, source.in_unit)
        return unit_remedy(value_c, lambda unit: channel.removesuffix('c') + unit.lower())


class CellSums(NamedTuple):
    """What the samples of a channel are in cells: numbers, ascending, sums and counts, (n,)."""

    cells: IntArray
    sums: FloatArray
    counts: IntArray

    def means(self, first: int, last: int) -> FloatArray:
        """Means on cells first … last, shape (last - first + 1,), NaN where none."""
        size, inside = last - first + 1, (self.cells >= first) & (self.cells <= last)
        at = self.cells[inside] - first
        sums, counts = (np.bincount(at, part[inside], size) for part in self[1:])
        means: FloatArray = np.full(size, np.nan)
        np.divide(sums, counts, out=means, where=counts > 0)
        return means


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
    if not 1 / NANOSECONDS <= period_s <= PERIODS_S[1]:  # NaN is outside every range
        raise RecordingError(
            f'The thermal period must be above 0 and at most {PERIODS_S[1]:g} s; got {period_s} s.'
        )
    period_ns = round(period_s * NANOSECONDS)
    checks, parts = SampleChecks(name, temperatures), defaultdict[str, list[CellSums]](list)
    for block in blocks:
        spikes = checks.tallies[block.channels].spikes
        wrong_starts = spikes.wrong_starts
        usable = checks.admit(block)
        if spikes.wrong_starts > wrong_starts:
            parts.pop(block.channels[0], None)
        if not len(usable.values):
            continue
        # The mean speed of a motion to and fro says nothing.
        values = usable.values**2 if ROTATION_CHANNEL in usable.channels else usable.values
        cells = usable.stamps_ns // period_ns
        starts = np.flatnonzero(np.diff(cells, prepend=cells[0] - 1))
        sums = np.add.reduceat(values, starts, axis=0)
        counts = np.diff(starts, append=len(cells))
        for column, channel in enumerate(usable.channels):
            parts[channel].append(CellSums(cells[starts], sums[:, column], counts))
    found = {
        channel: CellSums(*map(np.concatenate, zip(*of_channel, strict=True)))
        for channel, of_channel in parts.items()
    }

    warnings = []
    for sentence, is_too_much in checks.judge(max_bad_share):
        if is_too_much:
            raise RecordingError(sentence)
        warnings.append(sentence)
    thermometers = [j for j in range(100) if temperature_channel(j) in found]
    if thermometers != list(range(len(thermometers) or 1)):
        missing = next(j for j in range(100) if j not in thermometers)
        raise RecordingError(
            f'{name} holds no usable {temperature_channel(missing)}. Expected a sample in at '
            'least one thermal cell; record the temperature beside the wrench. A node keeps none '
            'before all of its thermometers have reported.'
        )
    if found.keys().isdisjoint(AXES):
        raise RecordingError(
            f'{name} holds no wrench. Expected at least one of {", ".join(AXES)}; got '
            f'{", ".join(sorted(found))}.'
        )
    channels = [temperature_channel(j) for j in thermometers]
    first = max(int(found[channel].cells[0]) for channel in channels)
    last = max(int(sums.cells[-1]) for sums in found.values())
    remedy = '' if temperatures else UNIT_OF_STAMPS
    warnings += _judge_channels(found, channels, name, period_s, (first, last), remedy)

    def table(*channels: str) -> FloatArray:
        """Lay out means of channels, shape (n, C), NaN where none; read-only if all are NaN."""
        nothing: FloatArray = np.broadcast_to(np.nan, (last - first + 1, len(channels)))
        if found.keys().isdisjoint(channels):
            return nothing
        columns = [found[c].means(first, last) if c in found else nothing[:, 0] for c in channels]
        return np.stack(columns, axis=1)

    temperature_c = table(*channels)
    # Those that were silent in the first cell keep what they read last, perhaps years before.
    newest = [int(cells[cells <= first].max()) for cells, *_ in (found[c] for c in channels)]
    before_c = np.array(
        [found[c].means(cell, cell)[0] for c, cell in zip(channels, newest, strict=True)]
    )
    force = speed = None
    if not found.keys().isdisjoint(FORCE_CHANNELS):
        force = table(*FORCE_CHANNELS)
        norms = np.linalg.norm(force, axis=1)
        known: BoolArray = np.asarray(np.isfinite(norms))
        force = np.where(known[:, np.newaxis], force, np.nan)
        if not known.any() or np.median(norms[known]) < _LEAST_GRAVITY:
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
        reference=table(*REFERENCE_CHANNELS), warnings=tuple(warnings),
        specific_force=force, rotation_speed=speed)  # fmt: skip


def _judge_channels(  # noqa: PLR0913, PLR0917 -- what a sentence needs
    found: dict[str, CellSums], thermometers: Sequence[str], name: str, period_s: float,
    ends: tuple[int, int], remedy: str,
) -> Iterator[str]:  # fmt: skip
    """Refuse stamps that are no times of one recording; drop dead axes, doubt a late start."""
    axes, (first, last) = [axis for axis in AXES if axis in found], ends
    dead = [axis for axis in axes if not found[axis].sums.any()]
    if dead and dead != axes:
        yield (
            f'{", ".join(dead)} of {name}: exactly 0 in every sample; counted as absent. Where '
            'such an axis exists, it is broken.'
        )
        axes = [axis for axis in axes if axis not in dead]
        for axis in dead:
            del found[axis]
    for thermometer in thermometers:
        for axis in axes:
            one, other = found[thermometer].cells, found[axis].cells
            apart_s = (max(one[0], other[0]) - min(one[-1], other[-1])) * period_s
            if apart_s > SAME_CLOCK_S:
                raise RecordingError(
                    f'Stamps of {axis} and {thermometer} of {name} are {apart_s:.0f} s apart; '
                    'both drivers must use one clock. Record both at the same time.'
                )
    span_s, most = (last + 1 - first) * period_s, MAX_NUMBERS // (1 + len(thermometers))
    if last + 1 - first > most:
        raise RecordingError(
            f'Stamps of {name} span {span_s:.6g} s; at most {most} thermal cells of '
            f'{period_s:g} s fit in a recording. Remove the sample with the broken stamp, '
            f'use a longer thermal period, or split the recording. {remedy}'
        )
    if remedy and span_s > _LONG_S:
        yield f'{name} lasts {span_s / 86_400:.1f} days. {remedy}'
    cells = np.unique(np.concatenate([found[axis].cells for axis in axes]))
    lost_s = np.count_nonzero(cells < first) * period_s
    if lost_s > _LATE_S:
        late = next(j for j, t in enumerate(thermometers) if found[t].cells[0] == first)
        yield (
            f'Thermometer {late + 1} of {name} came {lost_s:.0f} s after the first wrench. What '
            'was before it is not used. If the sensor was warming up by then, record again, with '
            'all thermometers from the beginning.'
        )
