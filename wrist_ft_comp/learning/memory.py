"""What a node that learns by itself remembers over a restart: ``learning.json``."""

from dataclasses import asdict, dataclass
from pathlib import Path

from wrist_ft_comp.errors import StateFileError
from wrist_ft_comp.learning.day_files import day_number
from wrist_ft_comp.stored.documents import Kind

KIND = Kind(
    name='learning state', says='wrist_ft_comp learning', version=1,
    schema='learning.schema.json', keeps=True, max_bytes=1_000_000, error=StateFileError,
    made_by='A node that learns makes one.', renewed_by='Remove it',
    unwritable='{path} cannot be written: {reason}. Make room, or choose another '
    'data_directory; until then a restart may forget an offered model.')  # fmt: skip


@dataclass(frozen=True)
class Memory:
    """What the node decided and was told; names of days are empty where there is none."""

    #: SHA-256 of the model that was live; None when there was none.
    champion: str | None = None
    #: Newest day that a job has judged, its verdict, and what happened to the sensor.
    judged: str = ''
    verdict: str = ''
    incident: str = ''
    #: Newest day that a person decided after.
    since: str = ''
    #: Why learning has stopped on its own; empty when it has not.
    paused: str = ''
    #: When the live model changed last, and why.
    change: str = ''
    #: A better model: its file below models/, its SHA-256, and why; empty where none is offered.
    offered: str = ''
    sha256: str = ''
    why: str = ''
    #: Whether it goes live by itself, which a kill may delay until after the restart.
    automatic: bool = False


def memory_path(directory: Path) -> Path:
    """Tell where the memory of a node's folder lies."""
    return directory / 'learning.json'


def load_memory(directory: Path) -> Memory | None:
    """Read a memory; None where there is none."""
    document = KIND.load_json(memory_path(directory))
    if document is None:
        return None
    values = {key: document[key] for key in document if key not in {'format', 'version'}}
    # The name of a stray file, such as day_1.csv, would be newer than every day to come.
    stray = [key for key in ('judged', 'since') if not day_number(values.get(key, ''))]
    return Memory(**{**values, **dict.fromkeys(stray, '')})


def save_memory(directory: Path, memory: Memory) -> None:
    """Write a memory in one step."""
    KIND.write_json(memory_path(directory), asdict(memory))
