"""
What versions 0.1.0 and 0.2.0 wrote: every later one loads it and runs it to the same drift.

A README.md beside the files says how they were made. They are never made again: a later
version has to read them, however it writes its own.
"""

import csv
from dataclasses import asdict, replace
import hashlib
import json
from pathlib import Path
import shutil

import numpy as np
import pytest
import yaml

from wrist_ft_comp.cli.main import main
from wrist_ft_comp.learning.memory import load_memory
from wrist_ft_comp.payload.live_weight import LivePayload
from wrist_ft_comp.recordings.recordings import read_recording
from wrist_ft_comp.signals import AXES, Topics

# All that these tests know of the package; what moves is renamed here and in the four helpers.
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.model_store import ModelStore
from wrist_ft_comp.stored.payload_file import load_payloads
from wrist_ft_comp.stored.state_file import load_state
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings
from wrist_ft_comp.stream.offline import simulate_drift

FIXTURES = Path(__file__).parent / 'fixtures'
V0_1_0, V0_2_0 = VERSIONS = sorted(FIXTURES.glob('v*'))
#: Of every method and structure.
MODELS = sorted([*FIXTURES.glob('*/models/*.yaml'), *FIXTURES.glob('*/store/models/*.yaml')])
#: N, N m, and without unit for sensitivity.
TOLERANCE = 1e-9
SECOND = 1_000_000_000
#: Model and recording that recordings/compensated.csv was made with.
COMPENSATED = {
    V0_1_0: ('models/arx_pls_oe_loaded.yaml', 'recordings/loaded.csv'),
    V0_2_0: ('models/at_work.yaml', 'store/days/day_00003.csv'),
}


def read_json(path):
    return json.loads(path.read_text(encoding='utf-8'))


def home(path):
    """The folder of the version that wrote a file."""
    return FIXTURES / path.relative_to(FIXTURES).parts[0]


def named(value):
    """Name a version's folder, an evaluation or a recording."""
    return value.name if isinstance(value, Path) else value.get('path') or value['words'][0]


EVALUATIONS = [
    (version, expected)
    for version in VERSIONS
    for expected in read_json(version / 'evaluations.json').values()
]
RECORDINGS = [
    (version, expected)
    for version in VERSIONS
    for expected in read_json(version / 'recordings.json')
]

every_version = pytest.mark.parametrize('version', VERSIONS, ids=lambda version: version.name)
every_model = pytest.mark.parametrize('path', MODELS, ids=lambda path: path.stem)


def simulated(model, path):
    """Zero and sensitivity drift by batch, shape (N, 6) each."""
    recording = read_recording(path, period_s=model.period_ns / SECOND)
    return tuple(simulate_drift(in_newtons(model), recording))


def fresh(model):
    """A compensator that runs a model."""
    return Compensator(model.thermometers, StreamSettings(), in_newtons(model))


def in_newtons(model):
    """A model of a chamber table, too, as if it were in N: 0.1.0 ran it on any wrench."""
    return replace(model, unit='')


def resumed(model, state):
    """A compensator that goes on from a saved state, as the node does."""
    compensator = fresh(model)
    compensator.restore_tare(state.tare, state.external_tare)
    compensator.resume(state.thermal, 0.0)
    return compensator


def stream(compensator, path, first_ns):
    """Feed temperatures one by one; the corrected wrench of every fourth row."""
    outputs = []
    with path.open(encoding='utf-8') as file:
        rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    for number, row in enumerate(rows):
        stamp_ns = first_ns + round(row['stamp_s'] * SECOND)
        names = [name for name in row if name.startswith('temperature')]
        for thermometer, name in enumerate(names):
            compensator.add_temperature(thermometer, stamp_ns, row[name])
        if number % 4 == 3:
            raw = [row.get(axis, 1.0) for axis in AXES]
            outputs.append(compensator.correct(stamp_ns + SECOND, raw))
    return outputs


@pytest.fixture
def printed(monkeypatch, capsys):
    """Run the command line where the fixtures lie; it has to succeed."""

    def run(version, *words):
        monkeypatch.chdir(version)
        capsys.readouterr()
        assert main([str(word) for word in words]) == 0, words
        return capsys.readouterr().out

    return run


@pytest.fixture
def store(tmp_path):
    """Copy a node's folder."""
    return lambda version: ModelStore(Path(shutil.copytree(version / 'store', tmp_path / 'moved')))


def close(expected):
    return pytest.approx(expected, abs=TOLERANCE, rel=0)


@every_model
def test_a_model_gives_the_same_drift_in_a_batch(path):
    expected = read_json(path.with_suffix('.json'))
    stored = load_model(path)
    assert stored.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    drifts = dict(
        zip(
            ('zero', 'sensitivity'),
            simulated(stored.model, home(path) / expected['input']),
            strict=True,
        )
    )
    for part, drift in drifts.items():
        wanted = np.zeros(drift.shape)
        for axis, values in expected[part].items():
            wanted[:, AXES.index(axis)] = values
        np.testing.assert_allclose(drift, wanted, rtol=0, atol=TOLERANCE)


@every_model
def test_a_model_corrects_a_stream_to_the_same_wrenches(path):
    expected = read_json(path.with_suffix('.json'))
    outputs = stream(fresh(load_model(path).model), home(path) / expected['input'], 0)
    np.testing.assert_allclose(outputs, expected['stream'], rtol=0, atol=TOLERANCE)


def same_numbers(value, expected):
    """Numbers that were printed are printed again; there may be more."""
    if isinstance(expected, dict):
        for key, wanted in expected.items():
            same_numbers(value[key], wanted)
    elif isinstance(expected, list):
        for element, wanted in zip(value, expected, strict=True):
            same_numbers(element, wanted)
    elif isinstance(expected, float):
        assert value == pytest.approx(expected, rel=1e-9, abs=0)
    else:
        assert value == expected


@pytest.mark.parametrize(('version', 'expected'), EVALUATIONS, ids=named)
def test_a_model_is_evaluated_to_the_same_figures(printed, version, expected):
    now = json.loads(printed(version, 'evaluate', *expected['words'], '--json'))
    assert expected['printed']['axes']
    same_numbers(now, expected['printed'])


@pytest.mark.parametrize('path', [version / names[0] for version, names in COMPENSATED.items()])
def test_a_model_is_shown(printed, path):
    content = path.read_bytes()
    shown = json.loads(printed(home(path), 'show', path, '--json'))
    assert shown['sha256'] == hashlib.sha256(content).hexdigest()
    for axis, entry in yaml.safe_load(content)['axes'].items():
        assert shown['axes'][axis]['chosen'] == entry['chosen']
        assert axis in printed(home(path), 'show', path)


@every_version
def test_a_stream_goes_on_from_the_saved_state(version, store):
    expected, stored = read_json(version / 'state.json'), load_model(store(version).history()[-1])
    state = load_state(version / 'store/state.json')
    assert state is not None
    assert state.thermal is not None
    assert state.model_sha256 == stored.sha256
    assert state.tare.all()
    assert state.external_tare.all() == ('external' in expected)
    compensator, end_ns = resumed(stored.model, state), state.thermal.end_ns
    assert compensator.correct(end_ns, [1.0] * len(AXES)) == close(expected['held'])
    for live in live_payloads(version / 'store/models/payloads.json'):
        external = compensator.correct(end_ns, [1.0] * len(AXES), external=True)
        for force, wanted in zip(FORCES, expected['external'], strict=True):
            assert live.taken_off(external, force) == close(wanted)
    first_ns, inputs = end_ns + 3 * stored.model.period_ns, V0_1_0 / 'input_2.csv'
    outputs = stream(compensator, inputs, first_ns)
    np.testing.assert_allclose(outputs, expected['stream'], rtol=0, atol=TOLERANCE)
    new = stream(fresh(stored.model), inputs, first_ns)
    assert not np.allclose(outputs, new, rtol=0, atol=0.1), 'the state counts'


@every_version
def test_the_list_of_models_is_read_where_it_was_moved_to_and_rolled_back(version, store):
    models = store(version)
    history = read_json(version / 'store/active.json')['history']
    expected = [name and Path(name).name for name in history]

    def names():
        return [path and path.name for path in ModelStore(models.directory).history()]

    assert expected[0] is None
    assert names() == expected
    assert models.given() == ''
    recordings = sorted(path.name for path in version.glob('store/recordings/*.csv'))
    assert [path.name for path in models.recordings()] == recordings
    assert all(load_model(path).model.thermometers == 2 for path in models.history()[1:])
    models.activate(models.history()[:-1])
    assert names() == expected[:-1]


#: Specific forces, m/s².
FORCES = ((0.0, 0.0, 9.807), (9.0, -3.0, 2.0), (-1.0, 8.0, -5.0))


def live_payloads(path):
    """The payloads of a file, as the node takes them off."""
    return [LivePayload(name, *entry) for name, entry in load_payloads(path).items()]


@pytest.mark.parametrize('path', read_json(V0_2_0 / 'payloads.json'))
def test_a_payload_weighs_the_same(path):
    expected = read_json(V0_2_0 / 'payloads.json')[path]
    for live in live_payloads(V0_2_0 / path):
        assert str(live) == expected[live.name]['line']
        for force, weight in zip(FORCES, expected[live.name]['weight'], strict=True):
            assert live.weight(force) == close(weight)


def test_the_diary_and_the_memory_of_a_node_that_learns_are_read(printed):
    expected = read_json(V0_2_0 / 'days.json')
    same_numbers(json.loads(printed(V0_2_0, 'show', 'store', '--json')), expected['shown'])
    same_numbers(asdict(load_memory(V0_2_0 / 'store')), expected['memory'])


@pytest.mark.parametrize(('version', 'expected'), RECORDINGS, ids=named)
def test_a_recording_is_read_to_the_same_cells(version, expected, printed):
    words = 'show', expected['path'], '--wrench-topic', expected['wrench_topic']
    assert 'temperature' in printed(version, *words)
    topics = Topics(wrench=expected['wrench_topic'])
    recording = read_recording(
        version / expected['path'], period_s=expected['period_s'], topics=topics
    )
    channels = np.hstack([recording.temperature_c, recording.wrench, recording.reference])
    weights = np.arange(1, len(channels) + 1)[:, np.newaxis]
    assert recording.first_cell == expected['first_cell']
    assert np.isfinite(channels).sum(axis=0).tolist() == expected['present']
    for key, sums in (('sum', channels), ('weighted_sum', weights * channels)):
        np.testing.assert_allclose(np.nansum(sums, axis=0), expected[key], rtol=1e-9, atol=1e-9)


@every_version
def test_a_recording_is_compensated_to_the_same_wrenches(version, printed, tmp_path):
    model, source = COMPENSATED[version]
    printed(version, 'compensate', model, source, '-o', tmp_path / 'now.csv')
    computed, expected, raw = (
        np.genfromtxt(path, delimiter=',', names=True)
        for path in (
            tmp_path / 'now.csv',
            version / 'recordings/compensated.csv',
            version / source,
        )
    )
    for column in expected.dtype.names:
        np.testing.assert_allclose(computed[column], expected[column], rtol=0, atol=TOLERANCE)
    assert np.nanmax(np.abs(computed['force_z'] - raw['force_z'])) > 1.0
