"""What the package's own files share: a bound on their size, a format, a version, a schema."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
import errno
from functools import cache
from importlib import resources
import json
import os
from pathlib import Path
import tempfile
import time
from typing import Any, cast

import jsonschema

from wrist_ft_comp.errors import WristFtCompError

#: What a temporary neighbour's name ends with.
_SUFFIX = '.wrist_ft_comp.tmp'


#: One that is older than this is nobody's any more, s.
_ABANDONED_S = 60.0


@contextmanager
def replaced_on_success(target: Path) -> Iterator[Path]:
    """
    Lend a temporary neighbour of a file; on success it is synced and takes the file's place.

    Parameters
    ----------
    target : Path
        The file to make or replace; its folder must exist.

    Yields
    ------
    Path
        The neighbour: write it, and close it. It is removed when the block raises.

    Raises
    ------
    OSError
        When the target is a device or a pipe, which must not be replaced, or the disk refuses.

    """
    if target.exists() and not (target.is_file() or target.is_dir()):
        raise FileExistsError(errno.EEXIST, 'It is no regular file', str(target))
    handle, name = tempfile.mkstemp(_SUFFIX, f'.{target.name}.', target.parent)
    os.fchmod(handle, _mode(target))
    os.close(handle)
    neighbour = Path(name)
    try:
        yield neighbour
        sync(neighbour)
        neighbour.replace(target)
        sync(target.parent)
    except BaseException:
        with suppress(FileNotFoundError):
            neighbour.unlink()
        raise


def remove_leftovers(folder: Path) -> int:
    """
    Remove temporary neighbours that a killed process left behind.

    Parameters
    ----------
    folder : Path
        Where to look; it need not exist.

    Returns
    -------
    int
        How many were removed.

    """
    removed = 0
    for path in folder.glob(f'.*{_SUFFIX}'):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > _ABANDONED_S:
                path.unlink()
                removed += 1
    return removed


def _mode(target: Path) -> int:
    """Permissions of the file that is replaced, or what a new file would get."""
    if target.exists():
        return target.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def sync(path: Path) -> None:
    """Wait until a file's content, or a folder's entries, are on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


Document = dict[str, Any]


#: Longest sentence that is quoted from the schema's checker.
_QUOTED = 200


@dataclass(frozen=True)
class Kind:
    """
    A kind of file.

    Attributes
    ----------
    name : str
        Such as ``model file``.
    says : str
        What stands at ``format`` in it.
    version : int
        The only one that is read.
    schema : str
        Name of the schema, which lies beside this module.
    max_bytes : int
        No such file is larger.
    error : type
        What is raised.
    made_by : str
        Where to get a good one, a sentence.
    renewed_by : str
        What to do about a broken one, without its full stop.

    """

    name: str
    says: str
    version: int
    schema: str
    max_bytes: int
    error: type[WristFtCompError]
    made_by: str
    renewed_by: str


def read_bounded(kind: Kind, path: Path) -> bytes:
    """
    Read a file that must not be larger than any of its kind is.

    Parameters
    ----------
    kind : Kind
        Its kind.
    path : Path
        The file.

    Returns
    -------
    bytes
        Its content.

    Raises
    ------
    WristFtCompError
        The kind's, when it cannot be read or is too large.

    """
    try:
        with path.open('rb') as file:
            content = file.read(kind.max_bytes + 1)
    except OSError as error:
        raise kind.error(f'{path} cannot be read: {error.strerror}. {kind.made_by}') from error
    if len(content) > kind.max_bytes:
        raise kind.error(
            f'{path} is larger than {kind.max_bytes} bytes, which no {kind.name} is. '
            f'{kind.made_by}'
        )
    return content


def check(kind: Kind, path: Path, document: Any) -> None:
    """
    Refuse other formats, other versions, and whatever breaks the schema.

    Parameters
    ----------
    kind : Kind
        What it must be.
    path : Path
        The file, for messages.
    document : object
        Its content, parsed.

    Raises
    ------
    WristFtCompError
        The kind's.

    """
    if not isinstance(document, dict) or document.get('format') != kind.says:
        raise kind.error(
            f'{path} is not a {kind.name}: expected "format: {kind.says}" in it. {kind.made_by}'
        )
    if document.get('version') != kind.version:
        raise kind.error(
            f'{path} is of version {document.get("version")!r}; this package reads version '
            f'{kind.version}. {kind.renewed_by}, or install the package that wrote it.'
        )
    errors = list(jsonschema.Draft202012Validator(_schema(kind.schema)).iter_errors(document))
    if errors:
        first = jsonschema.exceptions.best_match(errors)
        where = '/'.join(str(part) for part in first.absolute_path) or 'the top level'
        message = first.message
        if len(message) > _QUOTED:
            message = f'{message[:_QUOTED]} …'
        raise kind.error(
            f'{path} breaks the schema at {where}: {message}. {kind.renewed_by}, or restore the '
            'file.'
        )


@cache
def _schema(name: str) -> Document:
    """Load a schema."""
    text = resources.files(__package__).joinpath(name).read_text('utf-8')
    return cast('Document', json.loads(text))
