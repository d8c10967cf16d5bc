"""Model files: YAML for people, exact to the last digit; its records check themselves."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from datetime import datetime, timezone
import hashlib
from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING

import yaml

import wrist_ft_comp
from wrist_ft_comp.channels import SENSOR_FACTS
from wrist_ft_comp.drift import drift_model
from wrist_ft_comp.drift.drift_model import StoredModel
from wrist_ft_comp.errors import check_range, ModelFileError, WristFtCompError
from wrist_ft_comp.recording import PERIODS_S
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stored.safe_file import Document, Kind, to_plain

if TYPE_CHECKING:  # what runs live reads models without loading what fits them
    from wrist_ft_comp.fit.result import Calibration

#: Models are nested by less than half of this.
_MAX_DEPTH = 30
#: Values in a file, which is read in a second or two; models have some thousands.
_MAX_EVENTS = 100_000
#: libyaml's, where PyYAML was built with it, is six times as fast.
_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
_DUMPER = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)


def _parse(content: bytes) -> Any:
    """
    Read safe YAML, plain values only, or raise ValueError.

    Aliases, which no model file needs, can blow up when they are expanded, deep nesting exhausts
    the stack, and many values take long: these are refused by the events, which build nothing.
    """
    depth = 0
    try:
        for number, event in enumerate(yaml.parse(content, Loader=_LOADER)):
            problem = 'aliases are not allowed' if isinstance(event, yaml.AliasEvent) else ''
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > _MAX_DEPTH:
                problem = f'no more than {_MAX_DEPTH} levels are allowed'
            if number > _MAX_EVENTS:
                problem = f'no more than {_MAX_EVENTS} values are allowed'
            if problem:
                raise ValueError(f'{problem} {event.start_mark}')  # noqa: TRY301 -- as YAML's own
        return yaml.load(content, Loader=_LOADER)  # noqa: S506 -- a SafeLoader
    except (yaml.YAMLError, ValueError, LookupError, AttributeError, RecursionError) as error:
        # PyYAML's constructors raise the plain ones for scalars such as "!!bool maybe".
        raise ValueError(' '.join(str(error).split())) from error


# A model of six axes with hats and banks takes some tens of kilobytes.
KIND = Kind(
    name='model file', says='wrist_ft_comp drift model',
    begins=r'format: wrist_ft_comp drift model\nversion: \d+\n\w', version=4, max_bytes=4_000_000,
    endings='.yaml .yml', error=ModelFileError, parse=_parse,
    made_by='Make a model with wrist_ft_comp calibrate.',
    renewed_by='Calibrate again',
    remedy='Name another file, or make room; no file was changed.')  # fmt: skip


class _Candidate(NamedTuple):
    """What a file says of a fit that was tried, as fit/result.py does."""

    name: str
    rms: float
    weight: float


@dataclass(frozen=True)
class _Axis:
    """What a file says of an axis, as fit/result.py does; N or N m."""

    chosen: str
    rms_before: float
    rms_after: float
    expected_rms: float
    day_limit: float | None
    time_constants_s: tuple[float, ...]
    time_constant_errors_s: tuple[float | None, ...]
    notes: tuple[str, ...]
    candidates: tuple[_Candidate, ...]
    model: drift_model.AxisModel | None

    def __post_init__(self) -> None:
        for name in ('rms_after', 'expected_rms', 'day_limit'):
            if getattr(self, name) is not None:
                check_range(name, getattr(self, name), 0.0)


class _Thermometer(NamedTuple):
    range_c: tuple[float, float]
    stand_s: float | None = None


@dataclass(frozen=True)
class _Model:
    """All that a model file holds; ``model.schema.json`` explains it."""

    period_ns: int
    thermometers: tuple[_Thermometer, ...]
    duration_s: float
    start_s: float
    warnings: tuple[str, ...]
    provenance: dict[str, Any]
    #: What thermometers show of each other; None of a single one.
    prediction: drift_model.ThermometerPrediction | None
    axes: dict[str, _Axis]

    def __post_init__(self) -> None:
        shortest_s, longest_s = PERIODS_S
        check_range('period_ns', self.period_ns, shortest_s * NANOSECONDS, longest_s * NANOSECONDS)
        check_range('duration_s', self.duration_s, 0.0)
        check_range('start_s', self.start_s, 0.0, longest_s)


def load_model(path: Path | str) -> StoredModel:
    """Read a model file; ModelFileError when it is missing, of another version, or damaged."""
    path = Path(path)
    content = KIND.read(path)
    return restore_model(path, hashlib.sha256(content).hexdigest(), KIND.document(path, content))


def restore_model(path: Path, sha256: str, document: Document) -> StoredModel:
    """Build a stored model from the document of a model file of this version."""
    record = KIND.restore(_Model, path, document, whole=True)
    entries = record.axes.items()
    try:
        model = drift_model.DriftModel(
            period_ns=record.period_ns, thermometers=len(record.thermometers),
            axes={axis: entry.model for axis, entry in entries if entry.model is not None},
            deviation={axis: entry.expected_rms for axis, entry in entries},
            day_limits={
                axis: entry.day_limit for axis, entry in entries if entry.day_limit is not None
            },
            start_s=record.start_s, prediction=record.prediction,
            stands_s=[each.stand_s for each in record.thermometers])  # fmt: skip
    except WristFtCompError as error:
        raise KIND.damaged(path, str(error)) from error
    return StoredModel(path, sha256, model, document)


def save_model(
    path: Path | str, calibration: 'Calibration', provenance: Mapping[str, Any] | None = None
) -> StoredModel:
    """
    Write a model file, and its folder; an existing model file is replaced in one step.

    ``provenance`` holds plain values that are added to those of the calibration, or replace them.
    Gives what ``load_model`` reads. ModelFileError when the file cannot be written, or another
    file than a model is in its place.
    """
    path, model = Path(path), calibration.model
    stands_s = model.stands_s or [None] * model.thermometers
    ranges_c = zip(calibration.temperature_range_c, stands_s, strict=True)
    sensor = {
        fact: names if fact == 'temperature_topics' else names[0]
        for fact, names in calibration.sensor.items() if fact in SENSOR_FACTS
    }  # fmt: skip
    document = {
        'format': KIND.says, 'version': KIND.version, 'period_ns': model.period_ns,
        'thermometers': [_Thermometer(*both) for both in ranges_c],
        'prediction': model.prediction,
        'duration_s': calibration.duration_s, 'start_s': model.start_s,
        'warnings': calibration.warnings,
        'provenance': {
            'created': datetime.now(timezone.utc).isoformat(timespec='seconds'),
            'wrist_ft_comp': wrist_ft_comp.__version__,
            'recordings': [{'path': source} for source in calibration.sources],
            'settings': calibration.settings, **sensor, **(provenance or {}),
        },
        'axes': {
            axis: {entry.name: getattr(fit, entry.name) for entry in fields(_Axis)}
            for axis, fit in calibration.fits.items()
        },
    }  # fmt: skip
    # In plain values no list occurs twice, which YAML would write as an alias.
    text = yaml.dump(
        to_plain(document), Dumper=_DUMPER, sort_keys=False, allow_unicode=True, width=99,
        default_flow_style=None)  # fmt: skip
    KIND.write(path, text)
    return load_model(path)
