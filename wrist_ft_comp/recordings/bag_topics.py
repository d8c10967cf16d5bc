"""Which topics of a bag may be used, how good they are, and which are the most probable ones."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
import re

import numpy as np

from wrist_ft_comp.channels import is_plausible
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.recordings.bag import Bag, Connection, decode
from wrist_ft_comp.recordings.column_proposal import FAR, TREATED
from wrist_ft_comp.series import FloatArray, Progress
from wrist_ft_comp.wire import cdr
from wrist_ft_comp.wire.numbers_in_messages import follow, NumberReader, Path
from wrist_ft_comp.wire.temperature_source import path_text, temperatures_in

RAW_WRENCH, TEMPERATURE, IMU, TF = 'raw wrench', 'temperature', 'IMU', 'TF'
_ROLES = {cdr.WRENCH: RAW_WRENCH, cdr.TEMPERATURE: TEMPERATURE, cdr.IMU: IMU, cdr.TF: TF}
#: Names of temperatures of the sensor, or near it.
_NEAR = re.compile(r'sensor|force|wrench|torque|tool|flange|(?<![a-z])ft(?![a-z])', re.IGNORECASE)
#: A thermometer that changes by less, K, sees no warm-up.
_MOVES_K = 0.5
#: Number of thermometers that are suggested: one inside the sensor, one at the motor's side.
_SUGGESTED = 2


@dataclass(frozen=True)
class Candidate:
    """A topic, or a number in its messages, that may be used, and how good it is."""

    #: RAW_WRENCH, TEMPERATURE, IMU or TF.
    role: str
    #: As an option takes it: a topic, or ``topic:field``.
    entry: str
    samples: int
    #: Whether the stamps are the headers'; else times of arrival.
    stamped: bool
    #: Lowest and highest reading, in the driver's unit; None but for temperatures.
    reads: tuple[float, float] | None = None

    @property
    def moves(self) -> bool:
        """Whether it is a temperature that moved."""
        return self.reads is not None and self.reads[1] - self.reads[0] >= _MOVES_K


@dataclass(eq=False)
class _Tally:
    """What the messages of a connection held."""

    connection: Connection
    role: str
    #: Where the temperatures are; empty of a sensor_msgs/Temperature.
    paths: Sequence[Path] = ((),)
    reader: NumberReader | None = None
    stamped: bool = False
    #: Of each temperature, in the order of the paths.
    low: FloatArray = field(default_factory=lambda: np.array([np.nan]))
    high: FloatArray = field(default_factory=lambda: np.array([np.nan]))

    def candidates(self) -> Iterator[Candidate]:
        """Make the candidates of the connection."""
        topic, samples = self.connection.topic, self.connection.msgcount
        if self.role != TEMPERATURE:
            yield Candidate(self.role, topic, samples, self.stamped)
            return
        # What has no stamp counts at its time of arrival where it is read as a field.
        plain = topic if self.stamped else f'{topic}:temperature'
        for path, low, high in zip(self.paths, self.low, self.high, strict=True):
            entry = f'{topic}:{path_text(path)}' if path else plain
            yield Candidate(TEMPERATURE, entry, samples, self.stamped, (float(low), float(high)))


def survey_bag(
    bag: Bag, progress: Progress | None = None
) -> tuple[tuple[Candidate, ...], tuple[str, ...]]:
    """List what may be used of a bag, by role and topic, and warnings."""
    warnings: list[str] = []
    tallies: dict[int, _Tally] = {}
    for connection in (c for c in bag.connections if c.msgcount):
        topic, kind = connection.topic, connection.msgtype
        if role := _ROLES.get(kind):
            tallies[connection.id] = _Tally(connection, role)
        else:
            try:
                definitions = bag.define(connection)
            except RecordingError as error:
                warnings.append(f'Whether it holds temperatures is not known: {error}')
                continue
            with suppress(RecordingError):  # a message that cannot be decoded shows none
                layout = follow(definitions, kind, bag.first(connection))
                if paths := temperatures_in(layout, topic):
                    reader = NumberReader(definitions, kind, paths)
                    tallies[connection.id] = _Tally(connection, TEMPERATURE, paths, reader)
    read = [number for number, tally in tallies.items() if tally.role != TF]
    for number, _, messages in bag.grouped(read, progress):
        if not (tally := tallies.get(number)):
            continue
        try:
            stamps_ns, values = decode(bag, tally.connection, messages, tally.reader)
        except RecordingError as error:
            del tallies[number]
            warnings.append(f'{tally.connection.topic} cannot be used: {error}')
            continue
        tally.stamped |= bool(stamps_ns.any())
        if tally.role == TEMPERATURE:
            values = values[:, : len(tally.paths)]  # behind a Temperature is its variance
            tally.low = np.fmin(tally.low, np.fmin.reduce(values))
            tally.high = np.fmax(tally.high, np.fmax.reduce(values))
    found = [candidate for tally in tallies.values() for candidate in tally.candidates()]
    found.sort(key=lambda c: ([*_ROLES.values()].index(c.role), c.entry.partition(':')[0]))
    return tuple(found), tuple(warnings)


def suggested_topics(candidates: Sequence[Candidate], topics: Topics) -> Topics:
    """
    Choose the topics of a bag: the named ones that it holds, else the most probable ones.

    The raw wrench is one whose name shows no processing. Topics with the name of another wrench's
    sensor are not used. The thermometer inside the sensor comes first: the one without the name of
    a motor, with most words of the wrench's topic, or with the name of something at the tool; the
    same holds for IMUs. Of an array, the highest number. Without a raw wrench, its topic is empty.
    """
    raw = [c for c in candidates if c.role == RAW_WRENCH]
    # /wrench is what compensate adds.
    raw.sort(key=lambda c: (c.entry == '/wrench' or bool(TREATED.search(c.entry)), -c.samples))
    raw.sort(key=lambda c: c.entry.strip('/') != topics.wrench.strip('/'))
    wrench = raw[0].entry if raw else ''

    def names(entry: str) -> set[str]:
        """Split a topic into the names between its slashes, and these into words."""
        return {*entry.lower().split('/'), *re.findall(r'[a-z]+', entry.lower())}

    ours = names(wrench)
    theirs = {name for other in raw[1:] for name in names(other.entry)}

    def distance(candidate: Candidate) -> tuple[bool, int, bool, list[int]]:
        numbers = [-int(n) for n in re.findall(r'\d+', candidate.entry.partition(':')[2])]
        far, near = FAR.search(candidate.entry), _NEAR.search(candidate.entry)
        return far is not None, -len(names(candidate.entry) & ours), near is None, numbers or [1]

    def may_be_ours(candidate: Candidate) -> bool:
        words = names(candidate.entry)
        return bool(words & (ours - theirs)) or not words & (theirs - ours)

    topics = replace(topics, wrench=wrench)
    candidates = sorted(filter(may_be_ours, candidates), key=distance)
    imus = [c for c in candidates if c.role == IMU and c.stamped]
    if imus and not topics.force_source:
        topics = replace(topics, imu=imus[0].entry)
    if topics.temperatures != Topics().temperatures:
        return topics
    found = [c for c in candidates if c.role == TEMPERATURE]
    usable = [c for c in found if c.moves and all(map(is_plausible, c.reads or ()))]
    return replace(topics, temperatures=tuple(c.entry for c in (usable or found[:1])[:_SUGGESTED]))
