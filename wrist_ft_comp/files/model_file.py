"""
Model files: YAML that people can read, checked against a schema, refused when of another version.

A file holds what runs (per axis the features and the dynamics), the evidence (candidates, scores,
time constants) and where it came from. Numbers are written so that they read back exactly.
"""

import hashlib
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, cast

import jsonschema
import numpy as np
import scipy
import yaml

import wrist_ft_comp
from wrist_ft_comp import ModelFileError, SettingsError
from wrist_ft_comp.core.arx import Arx
from wrist_ft_comp.core.arx_pls import ArxPls
from wrist_ft_comp.core.calibration import Calibration
from wrist_ft_comp.core.drift import AxisModel, DriftModel
from wrist_ft_comp.core.features import Features
from wrist_ft_comp.core.identification import AxisFit
from wrist_ft_comp.core.recording import FloatArray
from wrist_ft_comp.files.atomic import replaced_on_success

FORMAT = 'wrist_ft_comp drift model'
VERSION = 1
#: A model of six axes with hats and banks takes some tens of kilobytes.
MAX_BYTES = 4_000_000

Document = dict[str, Any]


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
        'axes': {axis: _axis_document(fit) for axis, fit in calibration.fits.items()},
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


def _axis_document(fit: AxisFit) -> Document:
    """Turn one axis into plain values."""
    return {
        'chosen': fit.chosen,
        'rms_before': fit.rms_before,
        'rms_after': fit.rms_after,
        'time_constants_s': list(fit.time_constants_s),
        'notes': list(fit.notes),
        'candidates': [{'name': c.name, 'rms': c.rms} for c in fit.candidates],
        'model': None if fit.model is None else _model_document(fit.model),
    }


def _model_document(model: AxisModel) -> Document:
    """Turn what runs into plain values."""
    features, dynamics = model.features, model.dynamics
    return {
        'features': {
            'kind': features.kind,
            'reference_c': features.reference_c.tolist(),
            'lower_c': features.lower_c.tolist(),
            'upper_c': features.upper_c.tolist(),
            'degree': features.degree,
            'knots_c': [knots.tolist() for knots in features.knots_c],
        },
        'dynamics': {
            'input_mean': dynamics.input_mean.tolist(),
            'input_weight': dynamics.input_weight.tolist(),
            'rotations': dynamics.rotations.tolist(),
            'latents': [
                {'a': arx.a.tolist(), 'b': arx.b.tolist(), 'first_lag': arx.first_lag}
                for arx in dynamics.latents
            ],
            'output_loadings': dynamics.output_loadings.tolist(),
            'output_weight': dynamics.output_weight.tolist(),
            'output_mean': dynamics.output_mean.tolist(),
        },
    }


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
        return StoredModel(path, sha256, _build_model(document), document)
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


def _array(name: str, values: Any, shape: tuple[int, ...]) -> FloatArray:
    """Turn nested lists into a finite array of a given shape."""
    try:
        array = np.array(values, dtype=float)
    except (ValueError, OverflowError) as error:
        raise ModelFileError(f'{name} must have shape {shape}; restore the file.') from error
    if array.shape != shape:
        raise ModelFileError(
            f'{name} must have shape {shape}; got {array.shape}. Restore the file.'
        )
    if not np.isfinite(array).all():
        raise ModelFileError(f'{name} must hold finite numbers only; restore the file.')
    return array


def _build_model(document: Document) -> DriftModel:
    """Build what runs from a checked document."""
    thermometers = len(document['thermometers'])
    return DriftModel(
        period_ns=document['period_ns'],
        thermometers=thermometers,
        axes={
            axis: _build_axis(entry['model'], thermometers)
            for axis, entry in document['axes'].items()
            if entry['model'] is not None
        },
    )


def _build_axis(entry: Document, thermometers: int) -> AxisModel:
    """Build one axis from a checked document."""
    features, dynamics = entry['features'], entry['dynamics']
    inputs, latents = len(dynamics['input_mean']), len(dynamics['latents'])
    outputs = len(dynamics['output_mean'])
    per_thermometer = {
        key: _array(key, features[key], (thermometers,))
        for key in ('reference_c', 'lower_c', 'upper_c')
    }
    return AxisModel(
        Features(
            kind=features['kind'],
            degree=features['degree'],
            knots_c=tuple(_array('knots_c', k, (len(k),)) for k in features['knots_c']),
            **per_thermometer,
        ),
        ArxPls(
            input_mean=_array('input_mean', dynamics['input_mean'], (inputs,)),
            input_weight=_array('input_weight', dynamics['input_weight'], (inputs,)),
            rotations=_array('rotations', dynamics['rotations'], (inputs, latents)),
            latents=tuple(
                Arx(
                    _array('a', latent['a'], (len(latent['a']),)),
                    _array('b', latent['b'], (len(latent['b']),)),
                    latent['first_lag'],
                )
                for latent in dynamics['latents']
            ),
            output_loadings=_array(
                'output_loadings', dynamics['output_loadings'], (outputs, latents)
            ),
            output_weight=_array('output_weight', dynamics['output_weight'], (outputs,)),
            output_mean=_array('output_mean', dynamics['output_mean'], (outputs,)),
        ),
    )
