"""Which samples of a file a sensor can have measured; limits are those of the node."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
import math

import numpy as np

from wrist_ft_comp.channels import LARGEST, PLAUSIBLE_C, temperature_channel
from wrist_ft_comp.recording import Samples
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stream.clock import in_order, NO_TIME
from wrist_ft_comp.stream.temperature_spikes import SpikeFilter
from wrist_ft_comp.wire.temperature_source import TemperatureSource
from wrist_ft_comp.wire.units import unit_remedy

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
                        remedy = self._remedy(channels, tally.first_implausible)
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
                    f'{self._remedy(channels, tally.least)}'
                )
                yield sentence, False

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


def _limits(channel: str) -> tuple[float, float]:
    """Return what a channel can read, exclusive."""
    return PLAUSIBLE_C if _is_temperature((channel,)) else (-LARGEST, LARGEST)


def _is_temperature(channels: tuple[str, ...]) -> bool:
    """Whether a group is a thermometer."""
    return channels[0].startswith('temperature')
