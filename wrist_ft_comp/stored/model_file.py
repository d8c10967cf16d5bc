"""Model files: YAML that people can read, checked against a schema, exact to the last digit."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from datetime import datetime, timezone
import hashlib
from pathlib import Path
import platform
from typing import Any, TYPE_CHECKING

import numpy as np
import yaml

import wrist_ft_comp
from wrist_ft_comp.drift.arx import Arx
from wrist_ft_comp.drift.arx_pls import ArxPls
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.drift_model import Document, DriftModel, StoredModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.drift.thermometer_prediction import ThermometerPrediction
from wrist_ft_comp.errors import ModelFileError, SettingsError
from wrist_ft_comp.signals import FloatArray, SENSOR_FACTS
from wrist_ft_comp.stored.documents import Kind, plain

if TYPE_CHECKING:  # what runs live reads models without loading what fits them
    from wrist_ft_comp.fit.result import Calibration

#: Models are nested by less than half of this.
_MAX_DEPTH = 30
#: Values in a file, which is read in a second or two; models have some thousands.
_MAX_EVENTS = 100_000
#: libyaml's, where PyYAML was built with it, is six times as fast.
_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
_DUMPER: Any = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)
#: What is written of an axis.
_KEPT = (
    'chosen', 'rms_before', 'rms_after', 'expected_rms', 'day_limit', 'reason',
    'time_constants_s', 'time_constant_errors_s', 'notes', 'candidates', 'model',
)  # fmt: skip
# A model of six axes with hats and banks takes some tens of kilobytes.
KIND = Kind(
    name='model file', says='wrist_ft_comp drift model', version=2, schema='model.schema.json',
    max_bytes=4_000_000, endings='.yaml .yml', error=ModelFileError,
    made_by='Make one with wrist_ft_comp calibrate.',
    renewed_by='Calibrate again',
    unwritable='{path} cannot be written: {reason}. Name another file, or make room; no file was '
    'changed.')  # fmt: skip


def load_model(path: Path | str) -> StoredModel:
    """
    Read a model file, which is checked against the schema.

    ModelFileError when it is missing, not YAML, of another version, or breaks the schema.
    """
    path = Path(path)
    content = KIND.read(path)
    try:
        document = _parse(content)
    except (yaml.YAMLError, ValueError, LookupError, AttributeError, RecursionError) as error:
        # PyYAML's constructors raise the plain ones for scalars such as "!!bool maybe".
        reason = ' '.join(str(error).split())
        raise ModelFileError(
            f'{path} is not a model file: expected YAML, but {reason}. {KIND.made_by}'
        ) from error
    KIND.check(path, document)
    return restore_model(path, hashlib.sha256(content).hexdigest(), document)


def restore_model(path: Path, sha256: str, document: Document) -> StoredModel:
    """Build a stored model from a document that was checked against the schema."""
    try:
        return StoredModel(path, sha256, _build_model(document), document)
    except (ModelFileError, SettingsError) as error:
        raise ModelFileError(f'{path}: {error}') from error


def _parse(content: bytes) -> Any:
    """
    Read safe YAML: plain values only.

    Aliases, which no model file needs, can blow up when they are expanded, deep nesting exhausts
    the stack, and many values take long: these are refused by the events, which build nothing.
    """
    depth = 0
    for number, event in enumerate(yaml.parse(content, Loader=_LOADER)):
        problem = 'aliases are not allowed' if isinstance(event, yaml.AliasEvent) else ''
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > _MAX_DEPTH:
            problem = f'no more than {_MAX_DEPTH} levels are allowed'
        if number > _MAX_EVENTS:
            problem = f'no more than {_MAX_EVENTS} values are allowed'
        if problem:
            raise yaml.YAMLError(f'{problem} {event.start_mark}')
    return yaml.load(content, Loader=_LOADER)  # noqa: S506 -- a SafeLoader


def _build_model(document: Document) -> DriftModel:
    thermometers = len(document['thermometers'])
    return DriftModel(
        period_ns=document['period_ns'], thermometers=thermometers,
        axes={
            axis: _build_axis(entry['model'], thermometers)
            for axis, entry in document['axes'].items()
            if entry['model'] is not None
        },
        deviation={
            axis: entry['rms_after'] if entry['expected_rms'] is None else entry['expected_rms']
            for axis, entry in document['axes'].items()
        },
        day_limits={
            axis: entry['day_limit']
            for axis, entry in document['axes'].items()
            if entry['day_limit'] is not None
        },
        start_s=document['start_s'],
        prediction=_build_prediction(document['thermometers']))  # fmt: skip


def _build_prediction(entries: Sequence[Document]) -> ThermometerPrediction | None:
    """Build what thermometers predict of each other; a single one has no others."""
    if not all('prediction' in entry for entry in entries):
        return None
    parts = {
        part.name: [entry['prediction'][part.name] for entry in entries]
        for part in fields(ThermometerPrediction)
    }
    (time_constants_s, *others) = parts.pop('time_constants_s')
    if any(other != time_constants_s for other in others):
        raise ModelFileError('All predictions must have the same time_constants_s.')
    arrays = {name: _array(name, values) for name, values in parts.items()}
    return ThermometerPrediction(_array('time_constants_s', time_constants_s), **arrays)


def _build_axis(entry: Document, thermometers: int) -> AxisModel:
    features, dynamics = entry['features'], entry['dynamics']
    filtered = (thermometers * max(len(entry['filters']), 1),)
    blocks = [block.name for block in fields(ArxPls) if block.name != 'latents']
    return AxisModel(
        Features(
            kind=features['kind'],
            degree=features['degree'],
            beyond=features['beyond'],
            knots_c=tuple(_array('knots_c', knots) for knots in features['knots_c']),
            **{k: _array(k, features[k], filtered) for k in ('reference_c', 'lower_c', 'upper_c')},
        ),
        ArxPls(
            latents=tuple(map(_build_arx, dynamics['latents'])),
            **{key: _array(key, dynamics[key]) for key in blocks},
        ),
        tuple(map(_build_arx, entry['filters'])),
    )


def _build_arx(entry: Document) -> Arx:
    return Arx(_array('a', entry['a']), _array('b', entry['b']), entry['first_lag'])


def _array(name: str, values: Any, shape: tuple[int, ...] | None = None) -> FloatArray:
    """Turn nested lists into a finite array, of a given shape where the record can't check it."""
    try:
        array = np.array(values, dtype=float)
    except (ValueError, OverflowError) as error:
        raise ModelFileError(f'{name} must be an array of numbers; restore the file.') from error
    if shape not in {None, array.shape}:
        raise ModelFileError(
            f'{name} must have shape {shape}; got {array.shape}. Restore the file.'
        )
    if not np.isfinite(array).all():
        raise ModelFileError(f'{name} must hold finite numbers only; restore the file.')
    return array


def save_model(
    path: Path | str, calibration: 'Calibration', provenance: Mapping[str, Any] | None = None
) -> StoredModel:
    """
    Write a model file, and its folder; an existing model file is replaced in one step.

    ``provenance`` holds plain values that are added to those of the calibration, or replace them.
    Gives what ``load_model`` reads. ModelFileError when the file cannot be written, or another
    file than a model is in its place.
    """
    from importlib.metadata import version  # noqa: PLC0415 -- a node that only loads starts faster

    path = Path(path)
    document = {
        'format': KIND.says,
        'version': KIND.version,
        'period_ns': calibration.model.period_ns,
        'thermometers': _thermometers(calibration),
        'duration_s': calibration.duration_s,
        'start_s': calibration.model.start_s,
        'warnings': calibration.warnings,
        'provenance': {
            'created': datetime.now(timezone.utc).isoformat(timespec='seconds'),
            'versions': {
                'wrist_ft_comp': wrist_ft_comp.__version__,
                'python': platform.python_version(),
                'numpy': np.__version__,
                'scipy': version('scipy'),
            },
            'recordings': [{'path': source} for source in calibration.sources],
            'settings': calibration.settings,
            **{
                fact: names if fact == 'temperature_topics' else names[0]
                for fact, names in calibration.sensor.items()
                if fact in SENSOR_FACTS
            },
            **(provenance or {}),
        },
        'axes': {
            axis: {name: getattr(fit, name) for name in _KEPT}
            for axis, fit in calibration.fits.items()
        },
    }
    # In plain values no list occurs twice, which YAML would write as an alias.
    text = yaml.dump(
        plain(document), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=99
    )
    KIND.write(path, text)
    return load_model(path)


def _thermometers(calibration: 'Calibration') -> list[Document]:
    """List the ranges of thermometers, and how each is predicted from the others."""
    entries: list[Document] = [{'range_c': row} for row in calibration.temperature_range_c]
    prediction = calibration.model.prediction
    for j, entry in enumerate(entries if prediction is not None else ()):
        entry['prediction'] = {
            name: values if name == 'time_constants_s' else values[j]
            for name, values in vars(prediction).items()
        }
    return entries


class _Dumper(_DUMPER):  # type: ignore[misc]
    """Safe YAML with vectors on one line."""


def _represent_list(dumper: _Dumper, data: list[Any]) -> Any:
    flat = not any(isinstance(item, (list, dict, str)) for item in data)
    return dumper.represent_sequence('tag:yaml.org,2002:seq', data, flow_style=flat)


_Dumper.add_representer(list, _represent_list)
