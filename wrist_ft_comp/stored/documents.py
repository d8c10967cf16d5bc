"""Common to all our own files: what they may replace, atomic writing, size, schema, records."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from importlib import resources
import json
import os
from pathlib import Path
import re
from secrets import token_hex
import time
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints, Union

import numpy as np

from wrist_ft_comp.errors import OutputError, RecordingError, WristFtCompError

Document = dict[str, Any]
#: End of the name of a temporary file beside the target.
_SUFFIX = '.wrist_ft_comp.tmp'
#: A temporary file that is older than this, s, was left by a killed process.
_ABANDONED_S = 60.0
#: Most letters that are quoted of a number, or of the schema's checker.
_QUOTED = 200
#: Most levels of brackets; our files have fewer.
_DEEPEST = 30
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
        _sync_folder(target.parent)
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


def _sync_folder(folder: Path) -> None:
    """Wait until a folder's entries are on the disk."""
    with suppress(OSError):  # some disks cannot; the file is in its place already
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn errors of the operating system while writing a file into a RecordingError."""
    try:
        yield
    except OSError as error:
        raise RecordingError(f'{path} cannot be written: {error.strerror}.') from error


def plain(value: Any) -> Any:
    """Turn records and arrays into plain values; NaN and infinity become None."""
    if is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(item) for item in value]
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not np.isfinite(value) else value


_type_hints = cache(get_type_hints)


def restored(kind: Any, value: Any) -> Any:
    """Turn plain values back into what an annotation names, such as a record; null is NaN."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in {Union, UnionType}:
        return None if value is None else restored(arguments[0], value)
    if is_dataclass(kind) or hasattr(kind, '_fields'):
        types = _type_hints(kind)
        return kind(**{name: restored(types[name], item) for name, item in value.items()})
    if kind is float:
        return np.nan if value is None else float(value)
    if kind is Path:
        return Path(value)
    return _restored_items(origin, arguments, value)


def _restored_items(origin: Any, arguments: tuple[Any, ...], value: Any) -> Any:
    """Restore a collection of some items; what is none stays as it is."""
    if origin is np.ndarray:
        return np.array(value, dtype=float)
    if origin is tuple and arguments[-1] is not ...:
        return tuple(restored(*pair) for pair in zip(arguments, value, strict=True))
    if origin in {tuple, Sequence, frozenset}:
        items = (restored(arguments[0], item) for item in value)
        return frozenset(items) if origin is frozenset else tuple(items)
    if origin in {dict, Mapping}:
        return {key: restored(arguments[1], item) for key, item in value.items()}
    return value


def parse_json(text: str | bytes) -> Any:
    """Read JSON of finite numbers, no deeper and with no longer integers than files have."""
    try:
        value = json.loads(text, parse_constant=_refuse, parse_int=_integer, parse_float=_finite)
    except RecursionError as error:
        raise ValueError('it is nested too deep') from error
    depth, level = 0, [value]
    while level := [item for item in level if isinstance(item, (dict, list))]:
        depth += 1
        if depth > _DEEPEST:
            raise ValueError('it is nested too deep')
        level = [v for item in level for v in (item.values() if isinstance(item, dict) else item)]
    return value


def _refuse(name: str) -> None:
    """Refuse NaN and infinities, which Python's JSON would take; ValueError."""
    raise ValueError(f'{name} stands in it')


def _finite(digits: str) -> float:
    """Read a number that is not so large that Python would take it for infinity."""
    value = float(digits)
    if not np.isfinite(value):
        _refuse(digits[:_QUOTED])
    return value


def _integer(digits: str) -> int:
    """Read an integer that fits 64 bits."""
    value = int(digits)
    if abs(value) >= 1 << 63:
        raise ValueError(f'an integer of {len(digits)} digits stands in it')
    return value


def beginning(path: Path) -> str:
    """Read the beginning of a file, which shows its kind; empty where there is no file."""
    try:
        if not path.is_file():
            return ''  # a pipe would keep whoever reads it waiting
        with path.open('rb') as file:
            return file.read(_BEGINNING).decode(errors='replace')
    except (OSError, ValueError):
        return ''


def _same(path: Path, other: Path) -> bool:
    """Whether two paths, spelt differently or by links, lead to the same file."""
    if path.exists() and other.exists():
        return path.samefile(other)
    return os.path.realpath(path) == os.path.realpath(other)


def set_aside(path: Path) -> None:
    """Rename a file to ``NAME.kept``, unless one is kept there already."""
    kept = path.with_name(f'{path.name}.kept')
    if not kept.exists():
        path.rename(kept)


@dataclass(frozen=True, kw_only=True)
class Output:
    """A kind of file that this package writes; ``write`` is the only door to it."""

    #: Such as ``model file``.
    name: str
    #: Regular expression that matches in the beginning of every such file, and of no other; empty
    #: where an existing file is never replaced.
    says: str
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
        return bool(self.says and re.search(self.says, beginning(path)))

    def check_target(self, path: Path, others: Iterable[Path] = ()) -> None:
        """
        Raise ``error`` where writing would destroy something, or is not possible; change nothing.

        There may be nothing, an empty file, or a file of this kind, but none of ``others``, which
        are what the same command reads, or writes besides.
        """
        exists = path.exists()
        filled = exists and (path.stat().st_size > 0 or not self.says)
        same = next((other for other in others if _same(path, other)), None)
        ending = path.suffix.lower()
        misnamed = ending in _PROMISING.split() and ending not in self.endings.split()
        above = next((folder for folder in path.absolute().parents if folder.exists()), path)
        obstacles = {
            f'it is the same file as {same}': same,
            'it is a folder': path.is_dir(),
            'it is a link that leads nowhere': path.is_symlink() and not exists,
            'it is no regular file': exists and not path.is_file(),
            f'it exists and is no {self.name} of this package': filled and not self.is_own(path),
            f'a {self.name} ends in {self.endings}, not in {ending}': misnamed and not filled,
            f'{above} is no folder': not above.is_dir(),
            f'{above} may not be written to': not os.access(above, os.W_OK),
        }  # fmt: skip
        for reason, met in obstacles.items():
            if met:
                raise self.error(self.unwritable.format(path=path, reason=reason))

    def write(self, path: Path, content: str | bytes) -> None:
        """Write a file, and its folder where it is missing, in one step, as far as it may."""
        try:
            if self.keeps and path.is_file() and path.stat().st_size and not self.is_own(path):
                set_aside(path)
            self.check_target(path)
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, content)
        except OSError as error:
            reason = self.unwritable.format(path=path, reason=error.strerror)
            raise self.error(reason) from error


@dataclass(frozen=True, kw_only=True)
class Kind(Output):
    """A kind of file that this package reads as well; ``says`` stands at ``format`` in it."""

    #: The only version that is read.
    version: int
    #: Name of the schema, which lies beside this module.
    schema: str
    #: No such file is larger.
    max_bytes: int
    #: Where to get a good one, a sentence.
    made_by: str
    #: What to do about a broken one.
    renewed_by: str
    endings: str = '.json'

    def is_own(self, path: Path) -> bool:
        """Tell by its content whether a file is of this kind, of whatever version."""
        return bool(re.search(rf'format["\']?:\s*["\']?{self.says}', beginning(path)))

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

    def write_json(self, path: Path, content: Document, indent: int | None = 1) -> None:
        """Write values as a JSON file of this kind and version."""
        document = {'format': self.says, 'version': self.version, **content}
        self.write(path, json.dumps(document, indent=indent, allow_nan=False))

    def load_json(self, path: Path) -> Document | None:
        """Read and check a JSON file, but for what write_json adds; None when there is none."""
        if not path.exists():
            return None
        try:
            document: Document = parse_json(self.read(path))
        except ValueError as error:
            raise self.error(
                f'{path} is not a {self.name}: expected JSON, but {error}.'
            ) from error
        self.check(path, document)
        return {key: document[key] for key in document if key not in {'format', 'version'}}

    def problem(self, path: Path) -> str:
        """Say why a JSON file cannot be read; empty where it can, or where there is none."""
        try:
            self.load_json(path)
        except (WristFtCompError, OSError) as error:
            return str(error)
        return ''

    def set_aside_unreadable(self, path: Path) -> None:
        """Keep a JSON file that cannot be read, such as that of a later version, beside it."""
        try:
            if path.is_file() and self.problem(path):
                set_aside(path)
        except OSError as error:
            reason = self.unwritable.format(path=path, reason=error.strerror)
            raise self.error(reason) from error

    def check(self, path: Path, document: Any) -> None:
        """Refuse other formats, other versions, and whatever breaks the schema."""
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
        import jsonschema  # noqa: PLC0415 -- a node without model and state starts faster

        errors = list(jsonschema.Draft202012Validator(_schema(self.schema)).iter_errors(document))
        if errors:
            first = jsonschema.exceptions.best_match(errors)
            where = '/'.join(str(part) for part in first.absolute_path) or 'the top level'
            message = first.message
            if len(message) > _QUOTED:
                message = f'{message[:_QUOTED]} …'
            raise self.error(
                f'{path} breaks the schema at {where}: {message}. {self.renewed_by}, or restore '
                'the file.'
            )


@cache
def _schema(name: str) -> Any:
    return json.loads(resources.files(__package__).joinpath(name).read_text('utf-8'))
