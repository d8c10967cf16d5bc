"""Model files: what is saved is what runs, and what is refused is named."""

import copy
from dataclasses import replace
from functools import partial
import hashlib
from importlib import resources
import json

import jsonschema
import numpy as np
import pytest
import yaml

from wrist_ft_comp import __version__
from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift import drift_model
from wrist_ft_comp.drift.arx_pls import Arx, ArxPls, relaxation
from wrist_ft_comp.drift.drift_model import AxisModel, DriftModel, ThermometerPrediction
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.errors import ModelFileError
from wrist_ft_comp.fit.result import AxisFit, Calibration, Candidate
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.stored.model_file import KIND, load_model, restore_model, save_model

#: Written in C where PyYAML has it.
FAST = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)


def make_axis(kind, outputs, seed, filters=()):
    """Numbers with all their digits, of very different sizes."""
    rng = np.random.default_rng(seed)
    count = max(len(filters), 1)
    knots = (np.array([0.1, 20.0, 60.0]), np.array([1 / 3, 50.0]))
    features = Features(
        kind, reference_c=rng.uniform(20, 30, 2 * count), lower_c=rng.uniform(0, 10, 2 * count),
        upper_c=rng.uniform(40, 60, 2 * count), degree=2 if kind == 'powers' else 1,
        knots_c=() if kind == 'powers' else knots * count,
    )  # fmt: skip
    inputs = (4 if kind == 'powers' else 5) * count
    latents = (
        Arx(np.array([-np.exp(-1 / 777.0)]), np.array([1 - np.exp(-1 / 777.0)])),
        Arx(np.zeros(0), np.array([rng.uniform()])),
        Arx(np.array([-1.2, 0.5]), rng.standard_normal(2), first_lag=3),
    )
    dynamics = ArxPls(
        input_mean=rng.standard_normal(inputs) * 1e-12,
        input_weight=rng.uniform(0.1, 1, inputs) * 1e7,
        rotations=rng.standard_normal((inputs, 3)), latents=latents,
        output_loadings=rng.standard_normal((outputs, 3)),
        output_weight=rng.uniform(0.1, 3, outputs), output_mean=rng.standard_normal(outputs),
    )  # fmt: skip
    return AxisModel(features, dynamics, filters)


@pytest.fixture(scope='module')
def calibration():
    filters = (relaxation(1 / 3, 1.0), Arx(np.array([-1.2, 0.5]), np.array([0.2, 0.1]), 2))
    axes = {
        'force_x': make_axis('powers', 1, 0),
        'force_z': make_axis('powers', 2, 2, filters),
        'torque_z': make_axis('hats', 2, 1),
    }
    fits = {
        axis: AxisFit(
            model=axes.get(axis), chosen='2 time constants, degree 2' if axis in axes else 'none',
            candidates=(Candidate('none', 1 / 3), Candidate('static, degree 1', 1e-17, 0.9)),
            rms_before=1 / 3, rms_after=1e-17, expected_rms=1e-17, held_out=None,
            time_constants_s=(0.1, 777.0) if axis in axes else (),
            time_constant_errors_s=(1 / 3, float('nan')) if axis in axes else (),
            notes=('zero drift only: “constant”',),
        )
        for axis in ('force_x', 'force_y', 'force_z', 'torque_z')
    }  # fmt: skip
    deviation = {axis: fit.expected_rms for axis, fit in fits.items()}
    model = DriftModel(10**9, 2, axes, deviation, start_s=10.0)
    ranges_c = np.array([[20.1, 40.2], [19.0, 23.3]])
    return Calibration(model, fits, ranges_c, 7200.5, ('Thermometer 1 of a: b.csv is silent; –.',))


@pytest.fixture(scope='module')
def saved(calibration, tmp_path_factory):
    path = tmp_path_factory.mktemp('saved') / 'model.yaml'
    save_model(path, calibration, {'settings': {'method': 'auto', 'latents': None}})
    return path


@pytest.fixture
def document(saved):
    return copy.deepcopy(yaml.safe_load(saved.read_text(encoding='utf-8')))


@pytest.fixture
def load(tmp_path):
    def write_and_load(content):
        path = tmp_path / 'changed.yaml'
        if not isinstance(content, (str, bytes)):
            content = yaml.dump(content, Dumper=FAST)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return load_model(path).model

    return write_and_load


def run(model):
    """Also far outside the calibrated range."""
    temperature_c = 25 + 5 * np.cumsum(np.random.default_rng(0).standard_normal((300, 2)), axis=0)
    return tuple(drift_model.run_from_rest(model, temperature_c)[1])


def places(node, path=()):
    """Yield the path to everything inside a document."""
    items = node if isinstance(node, dict) else dict(enumerate(node))
    for key, value in items.items():
        yield (*path, key)
        if isinstance(value, dict | list):
            yield from places(value, (*path, key))


def parent_of(document, path):
    node = document
    for key in path[:-1]:
        node = node[key]
    return node


def with_value(document, path, value):
    changed = copy.deepcopy(document)
    parent_of(changed, path)[path[-1]] = value
    return changed


def one_of_each_kind(document):
    """Yield path and value of places: one stands for those of other axes and positions."""
    seen = set()
    for path in places(document):
        value = parent_of(document, path)[path[-1]]
        kind = (*(key for key in path if isinstance(key, str) and key not in AXES), type(value))
        if kind not in seen and (path[0] != 'provenance' or len(path) == 1):
            seen.add(kind)
            yield path, value


def test_the_drift_is_equal_to_the_last_bit_with_its_deviation(calibration, saved):
    loaded = load_model(saved).model
    np.testing.assert_array_equal(run(loaded), run(calibration.model))
    for column in (0, 2, 5):
        assert np.ptp(run(loaded)[0][:, column]) > 0
    assert loaded.period_ns == calibration.model.period_ns
    assert loaded.thermometers == 2
    assert loaded.deviation == calibration.model.deviation
    assert set(loaded.deviation) == {'force_x', 'force_y', 'force_z', 'torque_z'}


def test_sensor_limits_predictions_and_sources_come_back(calibration, tmp_path):
    rng = np.random.default_rng(0)
    parts = np.array([0.0, 1 / 3]), rng.random((2, 2, 2)), *rng.random((4, 2))
    prediction = ThermometerPrediction(*parts)
    sensor = {'wrench_topic': ['/w'], 'temperature_topics': ['/t1', '/t2'], 'frame_id': ['flange']}
    limited = replace(calibration.fits['force_x'], day_limit=1 / 7)
    whole = replace(
        calibration,
        model=replace(calibration.model, day_limits={'force_x': 1 / 7}, prediction=prediction),
        fits={**calibration.fits, 'force_x': limited},
        sensor=sensor, sources=('a.csv', 'b'), settings=CalibrationSettings('constant'),
    )  # fmt: skip
    stored = save_model(str(tmp_path / 'model.yaml'), whole)
    assert stored.sensor == sensor
    assert stored.model.day_limits == {'force_x': 1 / 7}
    for name, values in vars(prediction).items():
        np.testing.assert_array_equal(getattr(stored.model.prediction, name), values)
    provenance = stored.document['provenance']
    assert provenance['wrist_ft_comp'] == __version__
    assert provenance['recordings'] == [{'path': 'a.csv'}, {'path': 'b'}]
    assert provenance['settings']['reference'] == 'constant'


def test_the_evidence_is_there_for_people_and_what_nobody_knows_is_null(calibration, saved):
    stored, text = load_model(saved), saved.read_text(encoding='utf-8')
    assert stored.document == yaml.safe_load(text)
    assert stored.path == saved
    assert stored.sha256 == hashlib.sha256(saved.read_bytes()).hexdigest()
    assert stored.document['warnings'] == list(calibration.warnings)
    assert stored.document['thermometers'][1]['range_c'] == [19.0, 23.3]
    assert stored.document['provenance']['settings'] == {'method': 'auto', 'latents': None}
    axes = stored.document['axes']
    assert axes['force_y']['model'] is None
    assert axes['force_x']['rms_after'] == 1e-17
    assert axes['force_z']['time_constant_errors_s'] == [1 / 3, None]
    assert '“constant”' in text
    assert '.nan' not in text.lower()


def test_every_key_of_a_model_file_but_stands_is_needed(document, load):
    for thermometer in document['thermometers']:
        del thermometer['stand_s']
    load(document)
    removed = 0
    for path, _ in one_of_each_kind(document):
        if isinstance(path[-1], str) and path[:-1] != ('axes',):
            changed = copy.deepcopy(document)
            del parent_of(changed, path)[path[-1]]
            with pytest.raises(ModelFileError, match=path[-1]):
                load(changed)
            removed += 1
    assert removed > 40


def test_arrays_have_the_shape_that_fits_the_others(document, load):
    tried = 0
    for path in places(document):
        values = parent_of(document, path)[path[-1]]
        inside = 'latents' in path and path[-1] != 'latents'
        if 'dynamics' in path and isinstance(values, list) and not inside:
            with pytest.raises(ModelFileError):
                load(with_value(document, path, [*values, values[-1]]))
            tried += 1
    assert tried > 20


THREE = [{'a': [], 'b': [1.0], 'first_lag': 0} for _ in range(3)]


@pytest.mark.parametrize(('place', 'value', 'sentence'), [
    ('axes force_q', {}, 'force_q'),
    ('format', 'another', 'expected "format: wrist_ft_comp drift model"'),
    *(('version', n, 'version of .* reads format 4') for n in (0, 5, '1', 1.5, None, [1])),
    ('period_ns', 0, 'period_ns'), ('period_ns', 1.5, 'period_ns'),
    ('period_ns', 10_000_000, 'period_ns'),
    ('duration_s', -1.0, 'duration_s must be .* at least 0'),
    ('start_s', -1.0, 'start_s must be .* from 0'),
    ('axes force_x rms_after', -1.0, 'rms_after must be .* at least 0'),
    ('thermometers', [], 'number of thermometers'),
    ('thermometers', [{'range_c': [1.0, 2.0], 'stand_s': 5.0}], 'number of thermometers'),
    ('axes force_x model features degree', 0, 'degree must be a number from 1 to 10'),
    ('axes force_x model features degree', 1, 'number of features'),
    ('axes force_x model features upper_c', [-9.0, -9.0], 'calibrated range'),
    ('axes force_x model dynamics output_weight', [0.0], 'output_weight'),
    ('axes force_x model dynamics latents 0 a', [-1.0001], 'a pole'),
    ('axes force_z model filters 0 b', [0.5], 'gain of a filter'),
    ('axes force_z model filters 1 a', [-2.2, 1.5], 'a pole'),
    ('axes force_z model filters', THREE, 'number of filters'),
    ('axes force_z model filters', [], 'number of thermometers'),
    ('axes torque_z model features knots_c', [[0.0, 1.0]], 'length of knots_c'),
    ('axes torque_z model features knots_c 0', [20.0, 20.0, 60.0], 'knots_c cannot be right'),
])  # fmt: skip
def test_an_impossible_value_is_refused_with_its_place(document, load, place, value, sentence):
    path = [int(word) if word.isdigit() else word for word in place.split()]
    with pytest.raises(ModelFileError, match=sentence) as refusal:
        load(with_value(document, path, value))
    assert 'changed.yaml' in str(refusal.value)
    assert len(str(refusal.value)) < 600


ALIASES = [f'a{i}: &a{i} [{", ".join([f"*a{i - 1}"] * 9)}]' for i in range(1, 30)]


@pytest.mark.parametrize(('content', 'sentence'), [
    ('\n'.join(['a0: &a0 [x, x, x, x, x, x, x, x, x]', *ALIASES]), 'aliases are not allowed'),
    ('- ' * 20_000, 'no more than 30 levels are allowed|nesting depth'),
    ('- 1\n' * 500_000, 'no more than 100000 values are allowed'),
], ids=range(3))  # fmt: skip
def test_bombs_are_refused_before_they_go_off(load, content, sentence):
    with pytest.raises(ModelFileError, match=sentence):
        load(content)


def test_a_huge_file_is_refused_unread(tmp_path):
    path = tmp_path / 'huge.yaml'
    with path.open('wb') as file:
        file.truncate(50 * KIND.max_bytes)
    with pytest.raises(ModelFileError, match=f'larger than {KIND.max_bytes} bytes'):
        load_model(path)
    with pytest.raises(ModelFileError, match='cannot be read: Is a directory'):
        load_model(tmp_path)


def test_the_schema_and_the_records_agree(document, load, tmp_path):
    """The schema is a document: it takes what is written, and what it refuses is refused."""
    name = 'model.schema.json'
    schema = json.loads(resources.files('wrist_ft_comp.stored').joinpath(name).read_text('utf-8'))
    validator = jsonschema.Draft202012Validator(schema)
    validator.validate(document)
    refused = 0
    for path, value in one_of_each_kind(document):
        take = load if len(path) == 1 else partial(restore_model, tmp_path, '')  # 5 times as fast
        for other in ('text', True, None, -1.0, [], {}):
            changed = with_value(document, path, other)
            if type(other) is not type(value) and not validator.is_valid(changed):
                with pytest.raises(ModelFileError):
                    take(changed)
                refused += 1
        for other in (float('nan'), float('inf')):
            if 'model' in path and isinstance(value, int | float):
                with pytest.raises(ModelFileError):
                    take(with_value(document, path, other))
    assert refused > 200
