"""
Model files: YAML that people can read, checked against a schema, refused when of another version.

A file holds what runs (per axis the features and the dynamics), the evidence (candidates, scores,
time constants) and where it came from. Numbers are written so that they read back exactly.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from functools import cache
import hashlib
from importlib import resources
from pathlib import Path
import platform
from typing import Any, cast

import jsonschema
import numpy as np
import scipy
import yaml

import wrist_ft_comp
from wrist_ft_comp import ModelFileError, SettingsError
from wrist_ft_comp.core.calibration import Calibration
from wrist_ft_comp.core.drift import DriftModel
from wrist_ft_comp.files.atomic import replaced_on_success
from wrist_ft_comp.files.model_document import axis_document, build_model, Document

FORMAT = 'wrist_ft_comp drift model'
VERSION = 1
#: A model of six axes with hats and banks takes some tens of kilobytes.
MAX_BYTES = 4_000_000


@dataclass(frozen=True, eq=False)
class StoredModel:
    """
    A model as it lies on disk.

    Attributes
    ----------
    path : Path
        The file.
    sha256 : str
        Of its bytes.
    model : DriftModel
        Ready to run.
    document : dict
        Everything in the file, as plain values.

    """

    path: Path
    sha256: str
    model: DriftModel
    document: Document


class _Loader(yaml.SafeLoader):
    """Safe YAML without aliases, which no model file needs and which can blow up when expanded."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Refuse aliases."""
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()  # type: ignore[no-untyped-call] # PyYAML's stubs lack it
            raise yaml.constructor.ConstructorError(
                None, None, 'aliases are not allowed', event.start_mark
            )
        return super().compose_node(parent, index)


class _Dumper(yaml.SafeDumper):
    """Safe YAML with vectors on one line and without aliases."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 -- the library's signature
        """Write everything out."""
        return True


def _represent_list(dumper: _Dumper, data: list[Any]) -> yaml.Node:
    """Write lists of plain values on one line."""
    flat = not any(isinstance(item, (list, dict, str)) for item in data)
    return dumper.represent_sequence('tag:yaml.org,2002:seq', data, flow_style=flat)


_Dumper.add_representer(list, _represent_list)


def save_model(path: Path, calibration: Calibration, provenance: Mapping[str, Any]) -> StoredModel:
    """
    Write a model file; an existing one is replaced in one step.

    Parameters
    ----------
    path : Path
        Target; its folder is made when missing.
    calibration : Calibration
        Model and evidence.
    provenance : mapping
        Plain values: recordings with hashes, settings.

    Returns
    -------
    StoredModel
        What ``load_model`` gives for it.

    Raises
    ------
    ModelFileError
        When the file cannot be written.

    """
    document = {
        'format': FORMAT,
        'version': VERSION,
        'period_ns': calibration.model.period_ns,
        'thermometers': [{'range_c': row.tolist()} for row in calibration.temperature_range_c],
        'duration_s': calibration.duration_s,
        'warnings': list(calibration.warnings),
        'provenance': {
            'created': datetime.now(timezone.utc).isoformat(timespec='seconds'),
            'versions': {
                'wrist_ft_comp': wrist_ft_comp.__version__,
                'python': platform.python_version(),
                'numpy': np.__version__,
                'scipy': scipy.__version__,
            },
            **provenance,
        },
        'axes': {axis: axis_document(fit) for axis, fit in calibration.fits.items()},
    }
    text = yaml.dump(document, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=99)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replaced_on_success(path) as neighbour:
            neighbour.write_text(text, encoding='utf-8')
    except OSError as error:
        raise ModelFileError(
            f'{path} cannot be written: {error.strerror}. Choose a folder that can be written to, '
            'or make room; no file was changed.'
        ) from error
    return load_model(path)


def load_model(path: Path) -> StoredModel:
    """
    Read a model file.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    StoredModel
        Checked against the schema, and able to run.

    Raises
    ------
    ModelFileError
        When it is missing, not YAML, of another version, or breaks the schema.

    """
    content = _read_bounded(path)
    try:
        document = yaml.load(content, Loader=_Loader)  # noqa: S506 -- _Loader is a SafeLoader
    except (yaml.YAMLError, ValueError, LookupError, AttributeError, RecursionError) as error:
        # PyYAML's constructors raise the plain ones for scalars such as "!!bool maybe".
        reason = ' '.join(str(error).split())
        raise ModelFileError(
            f'{path} is not a model file: expected YAML, but {reason}. '
            'Make one with wrist_ft_comp calibrate.'
        ) from error
    _check_document(path, document)
    return restore_model(path, hashlib.sha256(content).hexdigest(), document)


def restore_model(path: Path, sha256: str, document: Document) -> StoredModel:
    """
    Build a stored model from a document that was checked against the schema.

    Parameters
    ----------
    path : Path
        Where it lies.
    sha256 : str
        Of its bytes.
    document : dict
        Its content.

    Returns
    -------
    StoredModel
        Able to run.

    Raises
    ------
    ModelFileError
        When its parts do not fit together.

    """
    try:
        return StoredModel(path, sha256, build_model(document), document)
    except (ModelFileError, SettingsError) as error:
        raise ModelFileError(f'{path}: {error}') from error


def _read_bounded(path: Path) -> bytes:
    """Read a file that must not be larger than any model is."""
    try:
        with path.open('rb') as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise ModelFileError(
            f'{path} cannot be read: {error.strerror}. '
            'Give the path of a file that wrist_ft_comp calibrate made.'
        ) from error
    if len(content) > MAX_BYTES:
        raise ModelFileError(
            f'{path} is larger than {MAX_BYTES} bytes, which no model file is. Give the path of a '
            'file that wrist_ft_comp calibrate made.'
        )
    return content


@cache
def _schema() -> Document:
    """Load the schema of this version, which lies beside this module."""
    text = resources.files(__package__).joinpath('model.schema.json').read_text('utf-8')
    return cast('Document', yaml.safe_load(text))


def _check_document(path: Path, document: Any) -> None:
    """Refuse other formats, other versions, and whatever breaks the schema."""
    if not isinstance(document, dict) or document.get('format') != FORMAT:
        raise ModelFileError(
            f'{path} is not a model file: expected "format: {FORMAT}" in it. '
            'Make one with wrist_ft_comp calibrate.'
        )
    if document.get('version') != VERSION:
        raise ModelFileError(
            f'{path} is of version {document.get("version")!r}; this package reads version '
            f'{VERSION}. Calibrate again, or install the package that wrote it.'
        )
    errors = list(jsonschema.Draft202012Validator(_schema()).iter_errors(document))
    if errors:
        first = jsonschema.exceptions.best_match(errors)
        where = '/'.join(str(part) for part in first.absolute_path) or 'the top level'
        message = first.message if len(first.message) < 200 else f'{first.message[:200]} …'
        raise ModelFileError(
            f'{path} breaks the schema at {where}: {message}. Restore the file, or calibrate '
            'again.'
        )
