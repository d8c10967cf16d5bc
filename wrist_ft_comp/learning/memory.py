"""What a node that learns by itself remembers over a restart: ``learning.json``."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from wrist_ft_comp.errors import StateFileError
from wrist_ft_comp.learning.day_files import day_number
from wrist_ft_comp.stored.documents import Kind
from wrist_ft_comp.stored.model_store import HistoryEntry

KIND = Kind(
    name='learning state', says='wrist_ft_comp learning', version=2,
    schema='learning.schema.json', keeps=True, max_bytes=1_000_000, error=StateFileError,
    made_by='A node that learns makes one.', renewed_by='Remove it',
    unwritable='{path} cannot be written: {reason}. Make room, or choose another '
    'data_directory; until then a restart may forget an offered model.')  # fmt: skip


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


def memory_path(directory: Path) -> Path:
    """Path of the memory in a node's folder."""
    return directory / 'learning.json'


def load_memory(directory: Path) -> Memory | None:
    """Read a memory; None where there is none."""
    document = KIND.load_json(memory_path(directory))
    if document is None:
        return None
    # The name of a stray file, such as day_1.csv, would be newer than every day to come.
    if not day_number(document.get('judged', '')):
        document['judged'] = ''
    return Memory(**document)


def save_memory(directory: Path, memory: Memory) -> None:
    """Write a memory in one step; one that cannot be read is kept beside it, once."""
    KIND.set_aside_unreadable(memory_path(directory))
    KIND.write_json(memory_path(directory), asdict(memory))


def last_change(history: Sequence[HistoryEntry]) -> str:
    """Say when and why the live model changed last; empty where it never did."""
    return f'{history[-1].since[:10]}: {history[-1].why}' if history and history[-1].since else ''
