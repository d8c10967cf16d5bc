"""
What a node that learns by itself keeps: its diary and its memory.

The diary, ``days/diary.json``, has an entry for every day, which decides whether it may be learnt
from, and whether its recording is kept. Only the learning job writes it; a broken or missing diary
is made anew. The memory, ``learning.json``, is what the newest job said; the node writes it.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from wrist_ft_comp.channels import AXES, LARGEST
from wrist_ft_comp.errors import ModelFileError, RecordingError, StateFileError
from wrist_ft_comp.stored.node_folder import HistoryEntry, NodeFolder
from wrist_ft_comp.stored.safe_file import Kind, MAKE_ROOM, to_plain

KIND = Kind(
    name='diary', says='wrist_ft_comp diary', version=2,
    max_bytes=20_000_000, error=RecordingError, made_by='A node that learns makes one.',
    renewed_by='Remove it',
    remedy=f'{MAKE_ROOM} until then nothing is learnt.')  # fmt: skip
MEMORY = Kind(
    name='learning state', says='wrist_ft_comp learning', version=2,
    max_bytes=1_000_000, error=StateFileError,
    made_by='A node that learns makes one.', renewed_by='Remove it',
    remedy=f'{MAKE_ROOM} until then a restart may forget an offered model.')  # fmt: skip

#: Key of the drift without any model, in ``DayEntry.left``.
NONE = 'none'
#: Key of what a new model leaves: a fit to the other days that it was learnt from.
CHALLENGER = 'challenger'

#: What happened on a day: nothing; what only that day cannot be learnt from; another tool, whose
#: drift is learnt all the same; or what changed the sensor, its zero, or its gain or mounting.
IncidentKind = Literal['', 'unreadable', 'contacts', 'thermometer', 'tool', 'zero', 'sensor']
#: Days of these kinds are learnt from, ...
LEARNT_FROM: tuple[IncidentKind, ...] = ('', 'tool')
#: ... and days of these kinds stop learning.
PAUSING: tuple[IncidentKind, ...] = ('zero', 'sensor')


@dataclass(frozen=True)
class DayEntry:
    """What is kept of a day at work, also after its recording was deleted."""

    #: Name of its file.
    name: str
    #: Stamp of its first cell, ns.
    first_ns: int = 0
    #: Duration of all its cells.
    hours: float = 0.0
    #: Lowest and highest temperature of every thermometer, °C.
    temperature_c: tuple[tuple[float, float], ...] = ()
    #: Coarse temperatures of the day, of the first thermometer and of the others relative to it:
    #: rare ones make it worth keeping.
    known: tuple[tuple[int, ...], ...] = ()
    #: RMS of the drift that a model left, tared in the first minute, N and N m, axis order AXES;
    #: NaN on axes without a figure. Keys are the first twelve digits of a model's SHA-256, NONE
    #: and CHALLENGER.
    left: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    #: Key of the live model in ``left``; empty when none was live.
    live: str = ''
    #: Why there is a new model, or none, in a sentence or two.
    verdict: str = ''
    #: What happened to the sensor, with size and time; empty when nothing did.
    incident: str = ''
    kind: IncidentKind = ''
    #: Whether a model was learnt.
    challenged: bool = False
    #: File of the better model that was found after this day; empty where none was.
    better: str = ''
    #: Mass, kg, and centre of mass, m, of every payload.
    payloads: tuple[tuple[float, ...], ...] = ()
    #: Rotation from the specific force's frame to the wrench's, row by row; empty where unknown.
    rotation: tuple[float, ...] = ()
    #: Standard deviation of a cell, N and N m, axis order AXES; empty where unknown.
    noise: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        axes = len(AXES)
        sizes = {len(left) - axes for left in self.left.values()} | {len(self.noise) % axes}
        sizes |= {len(payload) - 4 for payload in self.payloads} | {len(self.rotation) % 9}
        if sizes - {0}:
            raise RecordingError(f'The entry of {self.name} has too few or too many figures.')

    def rms_left(self, model: str) -> float:
        """Compute the RMS that a model left of a force's drift, N, or NaN."""
        values = np.array(self.left.get(model, ())[: AXES.index('torque_x')])
        present = values[np.abs(values) < LARGEST]
        return float(np.sqrt(np.mean(present**2))) if len(present) else np.nan


@dataclass(frozen=True)
class Diary:
    """All days, oldest first, also those whose recordings were deleted."""

    days: tuple[DayEntry, ...] = ()
    #: Models that were live, newest last: from active.json, and not in the diary's own file.
    history: tuple[HistoryEntry, ...] = ()
    #: Why learning has stopped on its own; empty when it has not.
    paused: str = ''
    #: Why its file cannot be read; empty where it can, or where there is none.
    problem: str = ''


def diary_path(directory: Path) -> Path:
    """Path of the diary in a node's folder."""
    return directory / 'days' / 'diary.json'


def load_diary(directory: Path) -> Diary:
    """Read a diary; an empty one where none can be read."""
    try:
        return KIND.load(Diary, diary_path(directory)) or Diary()
    except (RecordingError, OSError) as error:
        return Diary(problem=str(error))


def save_diary(directory: Path, diary: Diary) -> None:
    """Write a diary in one step; one that cannot be read is kept beside it, once."""
    content = {'days': to_plain(diary.days), 'paused': diary.paused}
    KIND.save(diary_path(directory), content, record=Diary)


def survey(directory: Path) -> Diary:
    """Read a folder's diary, and add changes of the live model; RecordingError without days."""
    diary = load_diary(directory)
    if not diary.days:
        raise RecordingError(
            diary.problem
            or f'{directory} holds no days that were judged. A node with the parameter learning '
            'set to propose or auto judges each day after its end.'
        )
    with suppress(ModelFileError):  # the days can be shown without it
        return replace(diary, history=tuple(NodeFolder(directory).history()))
    return diary


@dataclass(frozen=True)
class Memory:
    """What the newest job said, and which model is offered; days are empty without one."""

    #: SHA-256 of the live model that all this is about; None when none was live.
    champion: str | None = None
    #: Newest day that a job has judged, or that a person's decision ended.
    judged: str = ''
    #: The verdict on that day.
    verdict: str = ''
    #: What happened to the sensor on that day.
    incident: str = ''
    #: Why learning has stopped by itself; empty when it has not.
    paused: str = ''
    #: File of the offered model below models/; empty where none is offered.
    offered: str = ''
    #: SHA-256 of the offered model.
    sha256: str = ''
    #: Why it is better.
    why: str = ''


def load_memory(directory: Path) -> Memory | None:
    """Read a memory; None where there is none."""
    return MEMORY.load(Memory, directory / 'learning.json')


def save_memory(directory: Path, memory: Memory) -> None:
    """Write a memory in one step; one that cannot be read is kept beside it, once."""
    MEMORY.save(directory / 'learning.json', asdict(memory), record=Memory)


def last_change(history: Sequence[HistoryEntry]) -> str:
    """Say when and why the live model changed last; empty where it never did."""
    return f'{history[-1].since[:10]}: {history[-1].why}' if history and history[-1].since else ''
