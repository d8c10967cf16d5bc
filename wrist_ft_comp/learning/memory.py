"""What a node that learns by itself remembers over a restart: ``learning.json``."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from wrist_ft_comp.errors import StateFileError
from wrist_ft_comp.learning.day_files import day_number
from wrist_ft_comp.stored.documents import Kind

KIND = Kind(
    name='learning state', says='wrist_ft_comp learning', version=2,
    schema='learning.schema.json', keeps=True, max_bytes=1_000_000, error=StateFileError,
    made_by='A node that learns makes one.', renewed_by='Remove it',
    unwritable='{path} cannot be written: {reason}. Make room, or choose another '
    'data_directory; until then a restart may forget an offered model.')  # fmt: skip


@dataclass(frozen=True)
class Memory:
    """What the node and people decided about models; names of days are empty without one."""

    #: SHA-256 of the model that was live; None when none was.
    champion: str | None = None
    #: Newest day that a job has judged.
    judged: str = ''
    #: The verdict on that day.
    verdict: str = ''
    #: What happened to the sensor on that day.
    incident: str = ''
    #: Newest day before a person's last decision.
    since: str = ''
    #: Date and words of that decision.
    decision: str = ''
    #: Why learning has stopped by itself; empty when it has not.
    paused: str = ''
    #: Date and reason of the last change of the live model.
    change: str = ''
    #: File of the offered model below models/; empty where none is offered.
    offered: str = ''
    #: SHA-256 of the offered model.
    sha256: str = ''
    #: Why it is better.
    why: str = ''
    #: Whether the offered model goes live by itself. After a kill, that happens at the restart.
    automatic: bool = False
    #: File of the live model; empty when none was.
    path: str = ''
    #: By day: the file of the model that ran on it, empty when none did. These are days that a
    #: person's decision ended and no job has judged: when the job comes, another model is live.
    ran: Mapping[str, str] = field(default_factory=dict)


def memory_path(directory: Path) -> Path:
    """Path of the memory in a node's folder."""
    return directory / 'learning.json'


def load_memory(directory: Path) -> Memory | None:
    """Read a memory; None where there is none."""
    document = KIND.load_json(memory_path(directory))
    if document is None:
        return None
    # The name of a stray file, such as day_1.csv, would be newer than every day to come.
    stray = [key for key in ('judged', 'since') if not day_number(document.get(key, ''))]
    return Memory(**{**document, **dict.fromkeys(stray, '')})


def save_memory(directory: Path, memory: Memory) -> None:
    """Write a memory in one step; one that cannot be read is kept beside it, once."""
    KIND.set_aside_unreadable(memory_path(directory))
    KIND.write_json(memory_path(directory), asdict(memory))
