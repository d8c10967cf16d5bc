"""Which samples a sensor can have measured: one set of limits for files and for the node."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
import math

import numpy as np

from wrist_ft_comp.signals import (
    BoolArray,
    IntArray,
    LARGEST,
    NANOSECONDS,
    PLAUSIBLE_C,
    Samples,
    temperature_channel,
)
from wrist_ft_comp.stream.temperature_spikes import SpikeFilter
from wrist_ft_comp.wire.temperature_source import TemperatureSource
from wrist_ft_comp.wire.units import unit_remedy

#: The stamp of a sample that came without one.
NO_TIME = int(np.iinfo(np.int64).min)
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
    #: Of a thermometer: readings that stand alone.
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
        in_order = _in_order(stamps_ns, tally.last_ns)
        tally.samples += len(values)
        tally.out_of_order += int(np.count_nonzero(~in_order))
        tally.not_finite += int(np.count_nonzero(in_order & ~finite))
        strange = values[in_order & finite & ~plausible]
        if len(strange) and not tally.implausible:
            tally.first_implausible = float(strange[0][np.argmax(np.abs(strange[0]))])
        tally.implausible += len(strange)
        usable = in_order & plausible
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
            if _is_temperature(channels) and not tally.samples:
                yield f'{_title(channels)} of {self._name} holds no sample; it is left out.', False
            dropped = tally.not_finite + tally.out_of_order + tally.implausible
            if dropped:
                yield self._describe_dropped(channels, tally, dropped, max_bad_share)
            if tally.spikes.first:
                stamp_ns, reading_c = tally.spikes.first
                sentence = (
                    f'{_title(channels)} of {self._name} stands out alone in '
                    f'{tally.spikes.dropped} of {tally.samples} samples, first at stamp '
                    f'{stamp_ns / NANOSECONDS:.0f} s with {reading_c:.1f} °C; left out.'
                )
                yield sentence, False
            used, span_ns = tally.samples - dropped, tally.last_ns - tally.first_ns
            if used > _BURST and span_ns * _FASTEST_HZ < used * NANOSECONDS:
                sentence = (
                    f'{_title(channels)} of {self._name}: {used} samples within '
                    f'{span_ns / NANOSECONDS:.3g} s; no sensor makes more than {_FASTEST_HZ:g} a '
                    f'second. {UNIT_OF_STAMPS}'
                )
                yield sentence, True
            if _is_temperature(channels) and _HOT_C[0] < tally.least <= tally.largest < _HOT_C[1]:
                sentence = (
                    f'{_title(channels)} of {self._name} is hot throughout: {tally.least:.1f} to '
                    f'{tally.largest:.1f} °C. {self._remedy(channels, tally.least)}'
                )
                yield sentence, False

    def _describe_dropped(
        self, channels: tuple[str, ...], tally: Tally, dropped: int, max_bad_share: float
    ) -> tuple[str, bool]:
        """Say what was dropped of a group, and whether it is too much."""
        strange = why_unusable(channels[0], tally.first_implausible)
        reasons = (
            (tally.not_finite, 'are not finite'),
            (tally.out_of_order, 'have a stamp that does not increase'),
            (tally.implausible, f'are {strange}'),
        )
        first, *others = [(count, reason) for count, reason in reasons if count]
        sentence = f'{_title(channels)} of {self._name}: {first[0]} of {tally.samples} samples '
        sentence += ' and '.join([first[1], *(f'{count} {reason}' for count, reason in others)])
        if dropped <= max_bad_share * tally.samples:
            return f'{sentence}; they were dropped.', False
        remedy = 'Record again, or remove those samples.'
        if _is_temperature(channels) and 2 * tally.implausible > dropped:
            remedy = self._remedy(channels, tally.first_implausible)
        return f'{sentence}; at most {max_bad_share:.1%} may be unusable. {remedy}', True

    def _remedy(self, channels: tuple[str, ...], value: float) -> str:
        """Say how to name a temperature that is probably in another unit."""
        source = self._sources.get(channels[0])
        column = channels[0].removesuffix('c')
        return unit_remedy(value, source.in_unit if source else lambda u: column + u.lower())


def why_unusable(channel: str, value: float) -> str:
    """Say what is wrong with readings of a channel such as a value that no sensor makes."""
    if not math.isfinite(value):
        return 'not finite'
    (low, high), unit = _limits(channel), ' °C' if _is_temperature((channel,)) else ''
    return f'outside {low:g} to {high:g}{unit}, which no sensor reads, such as {value:.4g}{unit}'


def _in_order(stamps_ns: IntArray, last_ns: int) -> BoolArray:
    """Mark the stamps, (n,), that are later than all before them but single strays."""
    before = np.concatenate(([last_ns], stamps_ns))
    this, following, second = stamps_ns[:-2], stamps_ns[1:-1], stamps_ns[2:]
    ahead = (this > following) & (this > second) & (following > before[:-3])
    before[1:-2][ahead] = NO_TIME
    return np.asarray(before[1:] > np.maximum.accumulate(before)[:-1])


def _limits(channel: str) -> tuple[float, float]:
    """Return what a channel can read, exclusive."""
    return PLAUSIBLE_C if _is_temperature((channel,)) else (-LARGEST, LARGEST)


def _is_temperature(channels: tuple[str, ...]) -> bool:
    """Whether a group is a thermometer."""
    return channels[0].startswith('temperature')


def _title(channels: tuple[str, ...]) -> str:
    """Name a group of channels."""
    return channels[0] if len(channels) == 1 else f'{channels[0]} … {channels[-1]}'
