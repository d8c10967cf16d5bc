"""wrist_ft_comp show: what a file is, what it holds, and the commands that would read it."""

import argparse
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
import re
import shlex

import numpy as np
from rich.table import Table

from wrist_ft_comp.channels import AXES, axis_unit, GRAVITY, SENSOR_FACTS, temperature_channel
from wrist_ft_comp.cli import options
from wrist_ft_comp.cli.terminal import filled, print_result, progress_bar, table
from wrist_ft_comp.drift.drift_model import StoredModel
from wrist_ft_comp.errors import CalibrationRefusedError, RecordingError
from wrist_ft_comp.fit.data_checks import check_recordings, silent_stretches
from wrist_ft_comp.learning import days
from wrist_ft_comp.payload.mass_and_center import CONTRAST
from wrist_ft_comp.payload.weight import Payload, payload_line
from wrist_ft_comp.recording import clock_time, Recording, Topics
from wrist_ft_comp.recordings import bag as bags
from wrist_ft_comp.recordings import read
from wrist_ft_comp.recordings.bag import Bag, RAW_WRENCH, TEMPERATURE, TF
from wrist_ft_comp.recordings.column_proposal import OPEN
from wrist_ft_comp.recordings.read_options import MAP_FILE, parse_options, recipe
from wrist_ft_comp.report.advice import run_command
from wrist_ft_comp.report.report_content import drifts_removed, model_sources, RESOLVED
from wrist_ft_comp.series import FloatArray, NANOSECONDS, part_of, Progress, rounded
from wrist_ft_comp.stored.model_file import KIND as MODEL
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.payload_file import load_payloads, payload_figures, PAYLOADS
from wrist_ft_comp.wire.temperature_source import parse_source

#: Most of what happened that is listed, the newest.
MOST_EVENTS = 40
REFERENCE = 'reference'
SPECIFIC_FORCE = 'specific force'
HELP = 'say what a model, a recording, payloads.json or a diary holds'
DESCRIPTION = """\
Say what a model file or a recording holds. Of a bag, which topics could be
wrench, temperature (also inside other messages), IMU and TF, how good they
are, and the commands that learn from them, judge the model and run it."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        'file', type=Path, metavar='FILE',
        help='MODEL.yaml, REC, payloads.json, or a data_directory with days')  # fmt: skip
    parser.add_argument(
        '--picture', type=Path, metavar='PICTURE.png',
        help="draw a node's days: what drifted, and what was left")  # fmt: skip
    options.add_topics(parser)
    options.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    path, code = arguments.file, 0
    lines: Sequence[str | Table]
    document: dict[str, object]
    if arguments.picture and not (path / 'days').is_dir():
        raise RecordingError(f'{path} is no folder of a node that learns, whose days are drawn.')
    if (path / 'days').is_dir():
        diary, memory = days.survey(path), days.load_memory(path) or days.Memory()
        lines = days_text(path, diary, memory)
        described_days = {
            'days': [{**vars(day), 'known': sorted(day.known)} for day in diary.days],
            'paused': diary.paused, 'summary': summary(diary),
            'node': {**vars(memory), 'change': days.last_change(diary.history)},
        }  # fmt: skip
        document = {str(path): described_days}
        if arguments.picture:
            from wrist_ft_comp.report import pictures  # noqa: PLC0415 -- matplotlib

            dates, drift = [when(day) for day in diary.days], drift_left(diary)
            pictures.PICTURE.check_target(arguments.picture)
            figure = pictures.days_figure(summary(diary), dates, drift)
            pictures.PICTURE.write(arguments.picture, pictures.png(figure))
    elif path.suffix in {'.yaml', '.yml'} or MODEL.is_own(path):
        stored = load_model(path)
        document, lines = {'sha256': stored.sha256, **stored.document}, [*_model_lines(stored)]
    elif path.name == PAYLOADS and path.exists():
        payloads = {name: payload for name, (payload, _) in load_payloads(path).items()}
        document = {'payloads': payloads_json(payloads)}
        head = f'{path}: payloads, by the names that payload.active takes'
        lines = [head, *(payload_line(name, payload) for name, payload in payloads.items())]
    else:
        with progress_bar('reading') as progress:
            topics = options.topics_from(arguments, [path])
            described, recording = describe_recording(path, topics, progress)
            refusal = _refusal(described, recording)
            code = int(recording is None and not described.candidates)  # nothing could be read
            doubts = [*described.warnings]
            if recording and not refusal:
                doubts += [*recording.warnings, *silent_stretches(recording)]
            said = tuple(doubt for doubt in dict.fromkeys(doubts) if doubt not in refusal)
            described = replace(described, warnings=said)
        words = next_commands(described, path)
        usable = words if described.is_open or not refusal else []
        document = {**vars(described), 'commands': usable, 'refusal': refusal}
        lines = [*_recording_lines(described, words, refusal)]
    print_result(lines, document, as_json=arguments.json)
    return code


def _model_lines(stored: StoredModel) -> Iterator[str | Table]:
    """Describe a model for people, who may have edited its provenance."""
    document, axes = stored.document, stored.document['axes']
    created = document['provenance'].get('created', 'at an unknown time')
    count = len(model_sources(stored))
    yield f'{stored.path}: a drift model, sha256 {stored.sha256[:12]}'
    yield filled(
        'It predicts from temperatures how a wrist force/torque sensor drifts. The node '
        '"compensator" runs it (parameter model_file); wrist_ft_comp evaluate judges it.'
    )
    yield (
        f'made {created} from {document["duration_s"] / 3600:.2f} h in {count} '
        f'recording{"" if count == 1 else "s"}; thermal period '
        f'{stored.model.period_ns / NANOSECONDS:g} s'
    )
    for fact in SENSOR_FACTS[:-1]:
        yield from (f'{fact}: {name}' for name in stored.sensor.get(fact, ()))
    names = [f', {entry}' for entry in stored.sensor.get('temperature_topics', ())]
    for j, thermometer in enumerate(document['thermometers']):
        low, high = thermometer['range_c']
        name = names[j] if j < len(names) else ''
        yield f'thermometer {j + 1}: calibrated from {low:.1f} to {high:.1f} °C{name}'
    rows = [
        [axis, axis_unit(axis), rounded(entry['rms_before'], 4), rounded(entry['rms_after'], 4),
         drifts_removed(stored.model.axes.get(axis)), entry['chosen']]
        for axis, entry in axes.items()
    ]  # fmt: skip
    yield ''
    yield table(['axis', 'unit', 'before', 'left', 'removes drift of', 'chosen'], rows)
    yield from (f'warning: {warning}' for warning in document['warnings'])


@dataclass(frozen=True)
class ChannelSummary:
    """One topic of a bag, or one channel of a file."""

    name: str
    #: Message type or unit.
    kind: str
    samples: int
    #: RAW_WRENCH, TEMPERATURE, both, REFERENCE, SPECIFIC_FORCE, or '' where it is not used.
    role: str
    #: Lowest and highest usable reading of a temperature in a file, °C.
    reads: tuple[float, float] | None = None


@dataclass(frozen=True)
class RecordingSummary:
    """What a file or folder holds."""

    name: str
    #: Such as ``rosbag2, sqlite3``.
    kind: str
    #: In the file's order.
    channels: tuple[ChannelSummary, ...]
    #: Earliest and latest stamp, ns; of a bag, the times of recording. None without samples.
    first_ns: int | None
    last_ns: int | None
    #: What is used.
    topics: Topics
    #: What could not be read, in sentences.
    warnings: tuple[str, ...] = ()
    #: What may be used, of a bag only.
    candidates: tuple[bags.Candidate, ...] = ()
    #: Along how many directions gravity moved in the sensor's frame; a payload needs two. None
    #: where no specific force was recorded, or nothing can be learnt.
    gravity_directions: int | None = None
    #: Whether the columns of ``topics`` are a guess, because nobody gave any.
    guessed: bool = False
    #: Why it cannot be read as a recording; empty where it can.
    refusal: str = ''
    #: Whether a reference was recorded that is zero throughout.
    is_unloaded: bool = False

    @property
    def is_open(self) -> bool:
        """Whether a person has to name some of the columns."""
        return OPEN in self.topics.columns


#: What was found, and the recording where it can be read.
Description = tuple[RecordingSummary, Recording | None]


def describe_recording(path: Path, topics: Topics, progress: Progress) -> Description:
    """
    Describe a recording of any kind; it need not hold all that a calibration wants.

    Of a bag, the topics say which role which one has; what they don't name is chosen.
    RecordingError when it is none at all.
    """
    with read.open_recording(path, topics) as opened:
        if isinstance(opened, read.OpenTable):
            summary, recording = _describe_table(opened, progress)
        else:
            summary, recording = _describe_bag(opened.bag, topics, progress)
    if recording is None or recording.specific_force is None:
        return summary, recording
    return replace(summary, gravity_directions=directions_of(recording.specific_force)), recording


def _describe_bag(bag: Bag, topics: Topics, progress: Progress) -> Description:
    """Take topics, counts and times from the bag's own index, survey what may be used, read it."""
    candidates, warnings = bags.survey_bag(bag, part_of(progress, 0, 2))
    asked, topics = topics.gravity_frame, bags.suggested_topics(candidates, topics)
    if topics.wrench and not topics.force_source and any(c.role == TF for c in candidates):
        with suppress(RecordingError):
            topics = replace(topics, gravity_frame=bags.uppermost_frame(bag, topics))
    recording, refusal = None, ''
    # A frame that nobody asked for, and that TF does not tell, is left out.
    for frame in dict.fromkeys((topics.gravity_frame, asked)) if topics.wrench else ():
        topics = replace(topics, gravity_frame=frame)
        try:
            opened = read.OpenBag(bag, parse_options(topics))
            recording = read.read_opened(opened, 1.0, progress=part_of(progress, 1, 2))
            refusal = ''
            break
        except RecordingError as error:
            refusal = str(error)

    temperatures = {parse_source(entry).topic.strip('/') for entry in topics.temperatures}
    wrench = topics.wrench.strip('/')
    roles = {
        (topics.imu or ('tf' if topics.gravity_frame else '')).strip('/'): SPECIFIC_FORCE,
        topics.reference.strip('/'): REFERENCE,
        **dict.fromkeys(temperatures, TEMPERATURE),
        wrench: f'{RAW_WRENCH}, {TEMPERATURE}' if wrench in temperatures else RAW_WRENCH,
    }
    counts: Counter[tuple[str, str]] = Counter()
    for connection in bag.connections:
        counts[connection.topic, connection.msgtype] += connection.msgcount
    first_ns, last_ns = bag.span_ns if sum(counts.values()) else (None, None)
    channels = tuple(
        ChannelSummary(topic, kind, count, roles.get(topic.strip('/'), ''))
        for (topic, kind), count in sorted(counts.items())
    )
    compressed = f', {bag.compression} compression' if bag.compression else ''
    summary = RecordingSummary(
        bag.name, f'{read.BAG}, {bag.storage}{compressed}', channels, first_ns, last_ns, topics,
        (*bag.warnings, *warnings), candidates, refusal=refusal)  # fmt: skip
    return summary, recording


def _describe_table(opened: read.OpenTable, progress: Progress) -> Description:
    """Describe a table, and read it; what cannot be read as it is, by a map that is proposed."""
    topics, lacking = opened.options.topics, opened.lacks()
    if lacking:
        proposal = opened.propose()
        columns = ','.join([*filter(None, [topics.columns]), proposal.columns])
        topics = replace(topics, columns=columns, time=topics.time or proposal.time)
        if OPEN in columns:
            refusal = proposal.refusal(opened.name, opened.names, lacking, 'as below.')
            return RecordingSummary(
                opened.name, read.TABLE, (), None, None, topics, guessed=True, refusal=refusal
            ), None
        opened = read.OpenTable(opened.tables, parse_options(topics))
    recording, refusal = None, opened.compensated
    try:
        period_s = read.fitting_period_s([opened.slowness_s])
        recording = read.read_opened(opened, period_s, progress=progress)
    except RecordingError as error:
        if not opened.is_read:
            raise
        refusal = refusal or str(error)
    columns_c = recording.temperature_c.T if recording else ()
    reads = {temperature_channel(j): (c.min(), c.max()) for j, c in enumerate(columns_c)}
    channels = []
    for channel, count in opened.counts.items():
        role = RAW_WRENCH if channel in AXES else SPECIFIC_FORCE
        role = REFERENCE if channel.startswith(REFERENCE) else role
        role = TEMPERATURE if channel.startswith(TEMPERATURE) else role
        unit = axis_unit(channel)
        channels.append(ChannelSummary(channel, unit, count, role, reads.get(channel)))
    first_ns, last_ns = opened.span_ns or (None, None)
    summary = RecordingSummary(
        opened.name, read.TABLE, tuple(channels), first_ns, last_ns, topics, opened.warnings,
        guessed=bool(lacking), refusal=refusal,
        is_unloaded=bool(recording and not np.nan_to_num(recording.reference).any()))  # fmt: skip
    return summary, recording


def next_commands(summary: RecordingSummary, path: Path) -> list[str]:
    """Write the commands that learn from a recording and judge; of a bag, that run, too."""
    topics, usual, is_bag = summary.topics, Topics(), bool(summary.candidates)
    referred = any(c.role == REFERENCE and c.samples for c in summary.channels)
    referred &= not summary.is_unloaded
    at_work = bool(summary.gravity_directions) and not referred
    reference = 'recorded' if referred else 'payload' if at_work else ''
    words = ['--reference', reference] if reference else []
    if topics.wrench.strip('/') != usual.wrench.strip('/'):
        words += ['--wrench-topic', topics.wrench]
    if topics.temperatures != usual.temperatures:
        for entry in topics.temperatures:
            words += ['--temperature-topic', entry]
    words += topics.options(reference)
    if not at_work:
        topics = replace(topics, imu='', gravity_frame='')
    # Two recordings in one folder have two models, and none is the map of their columns.
    first = path.name.partition('+')[0]
    name = re.sub(r'(\.[a-z]\w*)+$', '', first, flags=re.IGNORECASE)
    model = 'model.yaml' if f'{name}.yaml' in {'.yaml', MAP_FILE} else f'{name}.yaml'
    another = f'ANOTHER_DAY{"" if is_bag else first.removeprefix(name)}'
    calibrate = ['wrist_ft_comp', 'calibrate', str(path), '-o', model]
    evaluate = ['wrist_ft_comp', 'evaluate', model, another]
    if not is_bag:
        return [shlex.join([*command, *words]) for command in (calibrate, evaluate)]
    calibrate += ['--report', f'{Path(model).stem}.html', *words]
    evaluate += ['--report', 'evaluation.html', *words]
    return [shlex.join(calibrate), shlex.join(evaluate), run_command(topics, model)]


def directions_of(force: FloatArray) -> int:
    """Count the directions along which specific force, (n, 3), moved."""
    force = force[np.isfinite(force).all(axis=1)]
    norm = np.sqrt(np.mean(np.sum(force**2, axis=1)))
    moved = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(force.T, bias=True)), 0))
    return int(np.sum(moved * GRAVITY / norm > CONTRAST))


def _recording_lines(
    summary: RecordingSummary, commands: Sequence[str], refusal: str
) -> Iterator[str | Table]:
    """Describe what a recording holds, and what it is good for."""
    span_s = ((summary.last_ns or 0) - (summary.first_ns or 0)) / NANOSECONDS
    span = 'no samples' if summary.first_ns is None else f'{span_s:.1f} s'
    rows = [
        [channel.name, ', '.join(filter(None, [channel.kind, _range(channel.reads)])),
         str(channel.samples),
         rounded((channel.samples - 1) / span_s, 4) if channel.samples > 1 and span_s else '-',
         channel.role or '-']
        for channel in summary.channels
    ]  # fmt: skip
    if summary.is_open:  # nothing was read
        yield f'{summary.name}: {summary.kind}'
    else:
        yield f'{summary.name}: {summary.kind}, {span}'
        yield table(['channel', 'type or unit', 'samples', 'per second', 'used as'], rows)
    if summary.candidates:
        yield '\nWhat could be used, with the values of temperatures as they are read:'
        rows = [[c.role, _range(c.reads), c.entry] for c in summary.candidates]
        yield table(['as', 'values', 'topic'], rows)
        yield ''
    if (directions := summary.gravity_directions) is not None:
        frame = summary.topics.gravity_frame
        source = f' by TF, if z of {frame} is up' if frame else ''
        yield filled(
            f'specific force{source}: gravity moved along {directions} of 3 directions; a payload '
            'needs 2: tilt the tool about two axes.'
        )
    yield from _use(summary, commands, refusal)
    yield from (f'warning: {warning}' for warning in summary.warnings)


def _range(reads: tuple[float, float] | None) -> str:
    """Write lowest and highest reading of a temperature, if there are any."""
    return '{:.1f} to {:.1f}'.format(*reads) if reads and reads[0] <= reads[1] else ''


def _refusal(summary: RecordingSummary, recording: Recording | None) -> str:
    """Say why nothing can be learnt from a recording; empty where something can."""
    if summary.is_open:
        return summary.refusal
    held = [channel.role for channel in summary.channels if channel.samples]
    if lacks := [part for part in (RAW_WRENCH, TEMPERATURE) if not any(part in h for h in held)]:
        named = ' of that name' if any(c.role in lacks for c in summary.candidates) else ''
        words = {RAW_WRENCH: 'raw wrench in a form that can be read'}
        what = ' and no '.join(words.get(role, role) for role in lacks)
        return f'It holds no {what}{named}, so nothing can be learnt from it.'
    if summary.refusal or not recording:
        which = ' with these topics' if summary.candidates else ''
        return f'Nothing can be learnt from it{which}. {summary.refusal}'
    try:
        check_recordings([recording], 'unloaded', 0.0)
    except CalibrationRefusedError as error:
        return f'Nothing can be learnt from it. {error}'
    return ''


def _use(summary: RecordingSummary, commands: Sequence[str], refusal: str) -> Iterator[str]:
    """Say what a recording is good for, or why for nothing."""
    topics = summary.topics
    if refusal:
        yield refusal
        yield from commands[:1] if summary.is_open else ()
    elif summary.candidates:
        if not any(candidate.moves for candidate in summary.candidates):
            yield 'No temperature moves by half a degree, and a calibration needs a warm-up.'
        yield (
            'Learn from it, judge on another day, and run. The thermometer inside the sensor '
            f'comes first; by its name it is most probably {topics.temperatures[0]}:'
        )
        yield from commands
    else:
        yield f'\nLearn from it: {commands[0]}'
        yield f'Judge it on another day: {commands[1]}'
        # How a log's columns were understood, and how that is written once for all.
        if topics.columns:
            said = 'It was read with the map of --columns.'
            if summary.guessed:
                said = (
                    'Its columns have names of another program, so what they are is a guess. Look '
                    'at the units. Write another one behind a column: :kN, :Nmm, :F, *9.81.'
                )
            yield f'\n{said} Written into {MAP_FILE} beside the recordings, it needs no option:'
            yield from recipe(topics.columns, topics.time)


def days_text(directory: Path, diary: days.Diary, memory: days.Memory) -> list[str]:
    """Sum days up, and list what happened and the last verdicts."""
    went_live = {change.day for change in diary.history if change.how == 'learnt'}
    happened = [(change.since[:10], change.why) for change in diary.history if change.day]
    for day in diary.days:
        if day.incident:
            happened.append((when(day), day.incident))
        if day.better and day.name not in went_live:
            happened.append((when(day), f'{day.better} was learnt. {day.verdict}'))
    lines = [
        'What happened:' if happened else '',
        *(f'{date}  {said}' for date, said in sorted(happened)[-MOST_EVENTS:]),
        *(f'{day.name}: {day.verdict}' for day in diary.days[-3:] if day.verdict),
        f'last change: {days.last_change(diary.history) or "none yet"}',
        f'offered: {memory.offered}; call ~/adopt to make it live' if memory.offered else '',
        f'paused: {diary.paused}' if diary.paused else '',
    ]
    head = f'{directory}: days of a node that learns, {len(diary.days)}'
    return [head, *map(filled, filter(None, [summary(diary), *lines]))]


def drift_left(diary: days.Diary) -> FloatArray:
    """Give a force's drift, RMS, N: without a model, left by the live one; or NaN; (days, 2)."""
    return np.array([(day.rms_left(days.NONE), day.rms_left(day.live)) for day in diary.days])


def summary(diary: days.Diary) -> str:
    """Say in one sentence what drifted on a usual day, and what was left of it."""
    dates = dict.fromkeys(map(when, (diary.days[0], diary.days[-1])))
    count, drifts = len(diary.days), drift_left(diary)
    head = f'{count} {"day" if count == 1 else "days"}, {" to ".join(dates)}'
    # Days with a live model, if there are any, or else all.
    with_model = np.isfinite(drifts).all(axis=1)
    judged = drifts[with_model if with_model.any() else np.isfinite(drifts[:, 0])]
    if not len(judged):
        return f'{head}: none is judged yet.'
    without, left = np.median(judged, axis=0).tolist()
    sentence = f'{head}: on a usual day a force drifted by {rounded(without, 2)} N (RMS)'
    if np.isnan(left):
        judged_by = 'the live one cannot be judged' if diary.days[-1].live else 'no model was live'
        return f'{sentence}; {judged_by}.'
    sentence += f'; the model left {rounded(left, 2)} N'
    if without > RESOLVED:
        sentence += f' ({rounded(100 * left / without, 2)} %)'
    return f'{sentence}.'


def when(day: days.DayEntry) -> str:
    """Write the date that a day began on by its stamps, UTC, or its name where it has none."""
    if day.first_ns:  # its recording could be read
        return clock_time(day.first_ns).partition(' ')[0]
    return day.name.removesuffix('.csv')


def payloads_json(payloads: Mapping[str, Payload]) -> list[dict[str, object]]:
    """Put payloads into plain values; what is not known is null."""
    return [{'name': name, **payload_figures(payload)} for name, payload in payloads.items()]
