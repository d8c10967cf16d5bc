"""
An own file: what it may replace, writing it in one step, reading it, and setting it aside.

``Output`` is a kind of file that this package writes, ``Kind`` one that it reads as well. A file
is replaced by its successor only, and is known by how it begins: a text that quotes ours is none.
What stands in it are records, by ``to_plain`` and ``from_plain``.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack, suppress
from dataclasses import dataclass, fields, is_dataclass
import fcntl
from functools import cache, partial
import inspect
import json
import os
from pathlib import Path
import re
import sys
import threading
import time
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints, Literal, TypeVar, Union

import numpy as np

from wrist_ft_comp.errors import OutputError, RecordingError, WristFtCompError

Document = dict[str, Any]
Record = TypeVar('Record')
#: End of the name of a temporary file beside the target.
_SUFFIX = '.wrist_ft_comp.tmp'
#: What to do where a node's own file is refused by the disk; what is lost until then follows.
MAKE_ROOM = 'Make room, or choose another data_directory;'
#: A disk that takes longer than this for a file hangs, s.
_HANGS_S = 10.0
#: Endings that promise a content: a new file of another content may not have them.
_PROMISING = '.yaml .yml .json .html .htm .png .svg .jpg .pdf .csv .xlsx .parquet .mcap .db3'
#: What no path holds: a NUL, or half of a character of two; bytes that are no text are others.
_IN_NO_PATH = re.compile('[\0\ud800-\udc7f\udd00-\udfff]')
#: What a single value may be by its annotation, the words for it, and what else has to hold.
_SCALARS: dict[Any, tuple[tuple[type, ...], str, Callable[[Any], bool]]] = {
    float: ((int, float), 'a finite number', lambda value: abs(value) <= sys.float_info.max),
    int: ((int,), 'an integer of 64 bits', lambda value: abs(value) < 1 << 63),
    str: ((str,), 'text', lambda _: True),
    bool: ((bool,), 'true or false', lambda _: True),
    Path: ((str,), 'a path', lambda value: not _IN_NO_PATH.search(value)),
}


def replace_file(target: Path, content: str | bytes) -> None:
    """
    Write a file; an existing one is replaced in one step, when the new one is on the disk.

    Where it raises OSError, the file from before stays. File names in the text may hold bytes that
    are no text; they become "?".
    """
    data = content.encode(errors='replace') if isinstance(content, str) else content
    neighbour = target.parent / f'.{target.name}.{os.urandom(4).hex()}{_SUFFIX}'
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
        neighbour.unlink(missing_ok=True)
        raise


def remove_leftovers(folder: Path) -> None:
    """Remove temporary neighbours that killed processes left behind."""
    for path in folder.glob(f'.*{_SUFFIX}'):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > 60.0:  # nobody is writing it any more
                path.unlink()


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn errors of the operating system while writing a file into a RecordingError."""
    try:
        yield
    except OSError as error:
        raise RecordingError(f'{path} cannot be written: {error.strerror}.') from error


class FileWriter:
    """
    Writes files in a thread of its own, so that no wrench waits for a slow disk.

    They are written in turn; what waits for one file is written once, by the newest request.
    """

    def __init__(self) -> None:
        #: By name of a file, why its last write failed; empty when it did not.
        self.problems: dict[str, str] = {}
        self._waiting: dict[str, tuple[Callable[[], None], list[Callable[[str], None]]]] = {}
        #: What is to be called with the outcomes of writes.
        self._outcomes: list[tuple[Callable[[str], None], str]] = []
        self._ended = False
        #: What is being written, and since when, s.
        self._writing = '', 0.0
        self._changed = threading.Condition()
        # A daemon: a disk that never answers must not keep the process.
        self._thread = threading.Thread(target=self._run, name='file writer', daemon=True)

    def put(
        self, name: str, write: Callable[[], None], then: Callable[[str], None] | None = None
    ) -> None:
        """Have a file written; return at once. ``poll`` tells ``then`` why that failed, or ''."""
        with self._changed:
            _, callers = self._waiting.pop(name, (None, []))
            self._waiting[name] = write, [*callers, then] if then else callers
            self._changed.notify()
        if self._ended and not self._thread.is_alive():  # else the disk does not answer
            self._run()
            self.poll()
        elif self._thread.ident is None:
            self._thread.start()

    def poll(self) -> None:
        """Tell the outcomes of writes to whoever waits for them."""
        with self._changed:
            outcomes, self._outcomes = self._outcomes, []
            name, since_s = self._writing
            if name and time.monotonic() - since_s > _HANGS_S:
                for hung in (name, *self._waiting):
                    self.problems[hung] = (
                        f'{hung} is not written: the disk does not answer; until it does, a '
                        'restart loses what is newer.'
                    )
        for then, problem in outcomes:
            then(problem)

    def end(self, timeout_s: float) -> bool:
        """Write what waits, and stop; False where the disk takes longer than the timeout."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        if self._thread.ident is not None:
            self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._ended)
                if not self._waiting:
                    return
                name = next(iter(self._waiting))
                write, callers = self._waiting.pop(name)
                self._writing = name, time.monotonic()
            problem = ''
            try:
                write()
            except Exception as error:  # the next file is written all the same
                fault = f'{name} was not written, by a fault of this program: {error!r}'
                problem = str(error) if isinstance(error, WristFtCompError) else fault
            with self._changed:
                self._writing = '', 0.0
                self.problems[name] = problem
                self._outcomes += [(then, problem) for then in callers]


@contextmanager
def exclusive(folder: Path) -> Iterator[None]:
    """Let one process at a time change the files of a folder; a kill releases the lock."""
    with ExitStack() as stack:
        with suppress(OSError):  # writing says why nothing can be written; some disks don't lock
            folder.mkdir(parents=True, exist_ok=True)
            handle = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
            stack.callback(os.close, handle)
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield


def beginning(path: Path) -> str:
    """Read the beginning of a file, which shows its kind; empty where there is no file."""
    with suppress(OSError, ValueError):
        if path.is_file():  # a pipe would keep whoever reads it waiting
            with path.open('rb') as file:
                return file.read(4096).decode(errors='replace')
    return ''


def parse_json(text: str | bytes) -> Any:
    """Read JSON; ValueError where it is none, or nested too deep."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError('it is nested too deep') from error


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
    #: What to do where the disk refuses one, a sentence.
    remedy: str = 'Name another path, or make room.'

    def is_own(self, path: Path) -> bool:
        """Tell by its content whether a file is of this kind, of whatever version."""
        return bool(self.begins and re.match(self.begins, beginning(path), re.DOTALL))

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
        same = [
            one for one in others
            if os.path.realpath(one) == os.path.realpath(path)
            or (path.exists() and one.exists() and path.samefile(one))
        ]  # fmt: skip
        if same:
            reason = f'it is the same file as {same[0]}'
        elif path.is_dir():
            reason = 'it is a folder'
        elif not path.is_file() and (path.exists() or path.is_symlink()):
            reason = 'it is no regular file, or a link that leads nowhere'
        elif filled and not self.is_own(path):
            reason = f'it exists and is no {self.name} of this package'
        elif not folder.is_dir():
            reason = f'{folder} is no folder; make it first'
        elif promises_other and not filled:
            reason = f'a {self.name} ends in {self.endings}, not in {ending}'
        elif not os.access(folder, os.W_OK):
            reason = f'{folder} may not be written to'
        if reason:
            raise self.error(f'{path} cannot be written: {reason}. {self.remedy}')

    def write(self, path: Path, content: str | bytes) -> None:
        """Write a file, and its folder where it is missing, in one step, as far as it may."""
        try:
            if not path.parent.exists():
                path.parent.mkdir(parents=True, exist_ok=True)
            self.check_target(path)
            replace_file(path, content)
        except OSError as error:
            why = f'{path} cannot be written: {error.strerror}. {self.remedy}'
            raise self.error(why) from error


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

    def _refusal(self, path: Path, why: str) -> WristFtCompError:
        return self.error(f'{path} {why}. {self.made_by}')

    def read(self, path: Path) -> bytes:
        """Read a file that must not be larger than any of its kind is."""
        try:
            if path.exists() and not (path.is_file() or path.is_dir()):
                # A pipe would hold up the stream until somebody writes into it.
                raise self._refusal(path, 'is no regular file')
            with path.open('rb') as file:
                content = file.read(self.max_bytes + 1)
        except OSError as error:
            raise self._refusal(path, f'cannot be read: {error.strerror}') from error
        if len(content) > self.max_bytes:
            raise self._refusal(path, f'is larger than {self.max_bytes} bytes')
        return content

    def document(self, path: Path, content: bytes) -> Document:
        """Parse what was read; other formats and other versions are refused."""
        try:
            document: Any = self.parse(content)
        except ValueError as error:
            language = 'JSON' if self.parse is parse_json else 'YAML'
            why = f'is not a {self.name}: expected {language}, but {error}'
            raise self._refusal(path, why) from error
        if not isinstance(document, dict) or document.get('format') != self.says:
            raise self._refusal(path, f'is not a {self.name}: expected "format: {self.says}"')
        version = document.get('version')
        if version != self.version:
            other = 'an older' if version in range(1, self.version) else 'another'
            raise self.error(
                f'{path} was written by {other} version of wrist_ft_comp (format {version!r}); '
                f'this one reads format {self.version}. {self.renewed_by}, or install that one.'
            )
        return document

    def restore(
        self, record: type[Record], path: Path, document: Document, *, whole: bool = False
    ) -> Record:
        """Fill a record with what a document holds; the record checks itself."""
        content = {key: document[key] for key in document if key not in {'format', 'version'}}
        try:
            restored: Record = from_plain(record, content, whole=whole)
        except (ValueError, RecursionError, WristFtCompError) as error:
            raise self.damaged(path, str(error)) from error
        return restored

    def damaged(self, path: Path, problem: str) -> WristFtCompError:
        """Make the refusal of a file of this kind and version that holds what it cannot hold."""
        why = problem.rstrip('.')
        return self.error(f'{path} is damaged: {why}. {self.renewed_by}, or restore the file.')

    def load(self, record: type[Record], path: Path) -> Record | None:
        """Read a file into a record; None when there is none."""
        with suppress(OSError):  # reading says why nothing may be looked at
            if not path.exists():
                return None
        return self.restore(record, path, self.document(path, self.read(path)))

    def save(
        self, path: Path, content: Document, indent: int | None = 1, record: Any = None
    ) -> None:
        """
        Write plain values as a JSON file of this kind and version.

        One in its place that cannot be read, such as that of another version, is renamed to
        ``NAME.kept``, once: a node goes on where its own file is damaged beyond recognition.
        """
        kept = path.with_name(f'{path.name}.kept')
        if beginning(path) and not kept.exists():
            try:
                document = self.document(path, self.read(path))
                if record is not None:
                    self.restore(record, path, document)
            except self.error:
                with suppress(OSError):  # writing says why it cannot be written
                    path.rename(kept)
        document = {'format': self.says, 'version': self.version, **content}
        self.write(path, json.dumps(document, indent=indent, allow_nan=False))


def to_plain(value: Any) -> Any:
    """Turn records, named tuples and arrays into plain values; NaN and infinity become None."""
    if is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if hasattr(value, '_asdict'):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {key: to_plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [to_plain(item) for item in value]
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not np.isfinite(value) else value


def from_plain(kind: Any, value: Any, where: str = '', *, whole: bool = False) -> Any:
    """
    Turn plain values back into what an annotation names, such as a record.

    Numbers are finite; a single one may be null, which is NaN, and entries of a record that have
    a default may be absent. Not so where it is ``whole``: then only a default of None counts.
    ValueError, which names the place, when a value has another type, an entry of a record is
    missing or unknown, or a record refuses its values.
    """
    origin, arguments, inner = get_origin(kind), get_args(kind), partial(from_plain, whole=whole)
    place = where.strip('/') or 'the top level'

    def require(holds: bool, expected: str, got: Any = value) -> None:
        if not holds:
            raise ValueError(f'{place} must be {expected}; got {repr(got)[:60]}')

    if origin in {Union, UnionType}:
        return None if value is None else inner(arguments[0], value, where)
    if is_dataclass(kind) or hasattr(kind, '_fields'):
        types, optional = _entries(kind, whole=whole)
        require(isinstance(value, dict), 'named values')
        for name in sorted({*value, *types} - optional, key=str):
            require(name in value, f'named values with {name}', list(value))
        for name in value:
            require(name in types, f'without {name}, only with {", ".join(types)}', list(value))
        items = {key: inner(types[key], item, f'{where}/{key}') for key, item in value.items()}
        try:
            return kind(**items)
        except WristFtCompError as error:
            raise ValueError(f'{place}: {error}') from error
    if origin in {dict, Mapping}:
        require(isinstance(value, dict), 'named values')
        return {key: inner(arguments[1], item, f'{where}/{key}') for key, item in value.items()}
    if origin in {np.ndarray, np.typing.NDArray}:  # since numpy 2.5 an alias is its own origin
        require(isinstance(value, list), 'a list of numbers')
        numbers = np.array(value, dtype=object).ravel()
        largest = sys.float_info.max
        finite = all(type(item) in {int, float} and abs(item) <= largest for item in numbers)
        require(finite, 'finite numbers, in rows of one length')
        return np.array(value, dtype=float)
    if origin in {tuple, Sequence}:
        require(isinstance(value, list), 'a list')
        kinds = arguments
        if origin is not tuple or arguments[-1] is ...:
            kinds = arguments[:1] * len(value)
        require(len(kinds) == len(value), f'{len(kinds)} values')
        pairs = enumerate(zip(kinds, value, strict=True))
        return tuple(inner(each, item, f'{where}/{i}') for i, (each, item) in pairs)
    if origin is Literal:
        require(value in arguments, f'one of {", ".join(map(str, arguments))}')
    elif kind in _SCALARS:
        if kind is float and value is None and not whole:
            return np.nan
        types_of_value, words, holds = _SCALARS[kind]
        require(type(value) in types_of_value and holds(value), words)
        return kind(value)
    return value


@cache
def _entries(kind: Any, *, whole: bool) -> tuple[dict[str, Any], frozenset[str]]:
    """Give the annotations of a record's entries, and which of them may be absent."""
    absent = {
        name
        for name, entry in inspect.signature(kind).parameters.items()
        if entry.default is not entry.empty and (entry.default is None or not whole)
    }
    return get_type_hints(kind), frozenset(absent)
