"""What the package's own files share: a bound on their size, a format, a version, a schema."""

from dataclasses import dataclass
from functools import cache
from importlib import resources
import json
from pathlib import Path
from typing import Any, cast

import jsonschema

from wrist_ft_comp import WristFtCompError

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
