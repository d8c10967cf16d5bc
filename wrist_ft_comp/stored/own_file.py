"""
An own file: what it may replace, writing it in one step, reading it, and setting it aside.

``Output`` is a kind of file that this package writes, ``Kind`` one that it reads as well. A file
is replaced by its successor only, and is known by how it begins: a text that quotes ours is none.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
import fcntl
import json
import os
from pathlib import Path
import re
from secrets import token_hex
import time
from typing import Any, TypeVar

from wrist_ft_comp.errors import OutputError, RecordingError, WristFtCompError
from wrist_ft_comp.stored.plain_values import Document, from_plain, parse_json

Record = TypeVar('Record')
#: What stands first in every file that is read.
HEADER = ('format', 'version')
#: End of the name of a temporary file beside the target.
_SUFFIX = '.wrist_ft_comp.tmp'
#: A temporary file that is older than this, s, was left by a killed process.
_ABANDONED_S = 60.0
#: Bytes at the beginning of a file that show its kind.
_BEGINNING = 4096
#: Endings that promise a content: a new file of another content may not have them.
_PROMISING = '.yaml .yml .json .html .htm .png .svg .jpg .pdf .csv .mcap .db3'


def replace_file(target: Path, content: str | bytes) -> None:
    """
    Write a file; an existing one is replaced in one step, when the new one is on the disk.

    Where it raises OSError, the file from before stays. File names in the text may hold bytes that
    are no text; they become "?".
    """
    data = content.encode(errors='replace') if isinstance(content, str) else content
    neighbour = target.parent / f'.{target.name}.{token_hex(4)}{_SUFFIX}'
    try:
        with neighbour.open('xb') as file:
            if target.exists():
                neighbour.chmod(target.stat().st_mode & 0o777)
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        neighbour.replace(target)
        # The folder's entry is to be on the disk, too; some disks cannot.
        with suppress(OSError):
            folder = os.open(target.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
    except BaseException:
        with suppress(FileNotFoundError):
            neighbour.unlink()
        raise


def remove_leftovers(folder: Path) -> int:
    """Remove temporary neighbours that killed processes left behind; says how many."""
    removed = 0
    for path in folder.glob(f'.*{_SUFFIX}'):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > _ABANDONED_S:
                path.unlink()
                removed += 1
    return removed


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn errors of the operating system while writing a file into a RecordingError."""
    try:
        yield
    except OSError as error:
        raise RecordingError(f'{path} cannot be written: {error.strerror}.') from error


@contextmanager
def exclusive(folder: Path) -> Iterator[None]:
    """Let one process at a time change the files of a folder; a kill releases the lock."""
    handle = None
    with suppress(OSError):  # writing says why nothing can be written; some disks know no locks
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
        fcntl.flock(handle, fcntl.LOCK_EX)
    try:
        yield
    finally:
        if handle is not None:
            os.close(handle)


def beginning(path: Path) -> str:
    """Read the beginning of a file, which shows its kind; empty where there is no file."""
    return _first_bytes(path).decode(errors='replace')


def _first_bytes(path: Path) -> bytes:
    try:
        if not path.is_file():
            return b''  # a pipe would keep whoever reads it waiting
        with path.open('rb') as file:
            return file.read(_BEGINNING)
    except (OSError, ValueError):
        return b''


def _set_aside(path: Path) -> None:
    """Rename a file to ``NAME.kept``, unless one is kept there already."""
    kept = path.with_name(f'{path.name}.kept')
    if not kept.exists():
        path.rename(kept)


@dataclass(frozen=True, kw_only=True)
class Output:
    """A kind of file that this package writes; ``write`` is the only door to it."""

    #: Such as ``model file``.
    name: str
    #: Regular expression of how every such file begins, and no other; empty where an existing
    #: file is never replaced.
    begins: str = ''
    #: Endings that its name may have, among those that promise a content: ``.html .htm``.
    endings: str
    #: What is raised.
    error: type[WristFtCompError] = OutputError
    #: What is said where the disk refuses one, with {path} and {reason}.
    unwritable: str = '{path} cannot be written: {reason}. Name another path, or make room.'
    #: Whether another file in its place is renamed to ``NAME.kept``, once: a node goes on where
    #: its own file is damaged beyond recognition.
    keeps: bool = False

    def is_own(self, path: Path) -> bool:
        """Tell by its content whether a file is of this kind, of whatever version."""
        pattern = self.begins.encode()
        return bool(pattern and re.match(pattern, _first_bytes(path), re.DOTALL))

    def check_target(self, path: Path, others: Iterable[Path] = ()) -> None:
        """
        Raise ``error`` where writing would destroy something, or is not possible; change nothing.

        There may be nothing, an empty file, or a file of this kind, but none of ``others``, which
        are what the same command reads, or writes besides. The folder must be there.
        """
        folder, ending, reason = path.absolute().parent, path.suffix.lower(), ''
        filled = path.is_file() and (path.stat().st_size > 0 or not self.begins)
        promises_other = ending in _PROMISING.split() and ending not in self.endings.split()
        # Two paths may lead to one file, spelt differently or by links.
        same = [one for one in others if os.path.realpath(one) == os.path.realpath(path)
                or (path.exists() and one.exists() and path.samefile(one))]  # fmt: skip
        if same:
            reason = f'it is the same file as {same[0]}'
        elif path.is_dir():
            reason = 'it is a folder'
        elif path.is_symlink() and not path.exists():
            reason = 'it is a link that leads nowhere'
        elif path.exists() and not path.is_file():
            reason = 'it is no regular file'
        elif filled and not self.is_own(path):
            reason = f'it exists and is no {self.name} of this package'
        elif not folder.exists():
            reason = f'{folder} does not exist; make that folder first'
        elif not folder.is_dir():
            reason = f'{folder} is no folder'
        elif promises_other and not filled:
            reason = f'a {self.name} ends in {self.endings}, not in {ending}'
        elif not os.access(folder, os.W_OK):
            reason = f'{folder} may not be written to'
        if reason:
            raise self.error(self.unwritable.format(path=path, reason=reason))

    def write(self, path: Path, content: str | bytes) -> None:
        """Write a file, and its folder where it is missing, in one step, as far as it may."""
        try:
            if not path.parent.exists():
                path.parent.mkdir(parents=True, exist_ok=True)
            if self.keeps and path.is_file() and path.stat().st_size and not self.is_own(path):
                _set_aside(path)
            self.check_target(path)
            replace_file(path, content)
        except OSError as error:
            reason = self.unwritable.format(path=path, reason=error.strerror)
            raise self.error(reason) from error


@dataclass(frozen=True, kw_only=True)
class Kind(Output):
    """A kind of file that this package reads as well: JSON, unless ``parse`` says otherwise."""

    #: What stands at ``format`` in it, first of all.
    says: str
    #: The only version that is read.
    version: int
    #: No such file is larger.
    max_bytes: int
    #: Where to get a good one, a sentence.
    made_by: str
    #: What to do about a broken one.
    renewed_by: str
    endings: str = '.json'
    #: Turns its bytes into values, or raises ValueError.
    parse: Callable[[bytes], Any] = parse_json

    def __post_init__(self) -> None:
        if not self.begins:
            object.__setattr__(self, 'begins', rf'\{{\s*"format":\s*"{self.says}"')

    def read(self, path: Path) -> bytes:
        """Read a file that must not be larger than any of its kind is."""
        if path.exists() and not (path.is_file() or path.is_dir()):
            # A pipe would hold up the stream until somebody writes into it.
            raise self.error(f'{path} is no regular file. {self.made_by}')
        try:
            with path.open('rb') as file:
                content = file.read(self.max_bytes + 1)
        except OSError as error:
            raise self.error(f'{path} cannot be read: {error.strerror}. {self.made_by}') from error
        if len(content) > self.max_bytes:
            raise self.error(
                f'{path} is larger than {self.max_bytes} bytes, which no {self.name} is. '
                f'{self.made_by}'
            )
        return content

    def document(self, path: Path, content: bytes) -> Document:
        """Parse what was read; other formats and other versions are refused."""
        try:
            document: Any = self.parse(content)
        except ValueError as error:
            language = 'JSON' if self.parse is parse_json else 'YAML'
            raise self.error(
                f'{path} is not a {self.name}: expected {language}, but {error}. {self.made_by}'
            ) from error
        if not isinstance(document, dict) or document.get('format') != self.says:
            raise self.error(
                f'{path} is not a {self.name}: expected "format: {self.says}" in it. '
                f'{self.made_by}'
            )
        version = document.get('version')
        if version in range(1, self.version):
            remedy = 'it is not used' if self.keeps else self.renewed_by.lower()
            raise self.error(
                f'{path} was written by an older version of wrist_ft_comp (format {version}); '
                f'{remedy}.'
            )
        if version != self.version:
            raise self.error(
                f'{path} is of version {version!r}; this package reads version '
                f'{self.version}. {self.renewed_by}, or install the package that wrote it.'
            )
        return document

    def restore(self, record: type[Record], path: Path, document: Document) -> Record:
        """Fill a record with what a document holds; the record checks itself."""
        content = {key: document[key] for key in document if key not in HEADER}
        try:
            restored: Record = from_plain(record, content)
        except ValueError as error:
            raise self.damaged(path, str(error)) from error
        return restored

    def damaged(self, path: Path, problem: str) -> WristFtCompError:
        """Make the refusal of a file of this kind and version that holds what it cannot hold."""
        problem = problem.rstrip('.')
        return self.error(f'{path} is damaged: {problem}. {self.renewed_by}, or restore the file.')

    def load(self, record: type[Record], path: Path) -> Record | None:
        """Read a file into a record; None when there is none."""
        if not path.exists():
            return None
        return self.restore(record, path, self.document(path, self.read(path)))

    def save(self, path: Path, content: Document, indent: int | None = 1) -> None:
        """Write plain values as a JSON file of this kind and version."""
        document = {'format': self.says, 'version': self.version, **content}
        self.write(path, json.dumps(document, indent=indent, allow_nan=False))

    def problem(self, record: type[Any], path: Path) -> str:
        """Say why a file cannot be read; empty where it can, or where there is none."""
        try:
            self.load(record, path)
        except (WristFtCompError, OSError) as error:
            return str(error)
        return ''

    def set_aside_unreadable(self, record: type[Any], path: Path) -> None:
        """Keep a file that cannot be read, such as that of a later version, beside it."""
        try:
            if path.is_file() and self.problem(record, path):
                _set_aside(path)
        except OSError as error:
            reason = self.unwritable.format(path=path, reason=error.strerror)
            raise self.error(reason) from error
