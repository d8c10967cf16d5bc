"""
What version 0.1.0 wrote: every later version loads it and runs it to the same drift.

How the files were made is told beside them, in fixtures/v0_1_0/README.md. They are never made
again: a later version has to read them, however it writes its own.
"""

import csv
from dataclasses import replace
import hashlib
import json
from pathlib import Path
import shutil

import numpy as np
import pytest
import yaml

from wrist_ft_comp.cli.main import main
from wrist_ft_comp.recordings.recordings import read_recording
from wrist_ft_comp.signals import AXES, Topics

# All that these tests know of the package; what moves is renamed here and in the four helpers.
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.model_store import ModelStore
from wrist_ft_comp.stored.state_file import load_state
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings
from wrist_ft_comp.stream.offline import simulate_drift

HERE = Path(__file__).parent / 'fixtures' / 'v0_1_0'
MODELS = sorted([*HERE.glob('models/*.yaml'), *HERE.glob('store/models/*.yaml')])
#: N, N m, and without unit for sensitivity.
TOLERANCE = 1e-9
SECOND = 1_000_000_000
STORED_HISTORY = [None, 'model_20261121T220509Z.yaml', 'model_20261121T220520Z.yaml']


def read_json(name):
    return json.loads((HERE / name).read_text(encoding='utf-8'))


EVALUATIONS = read_json('evaluations.json')
RECORDINGS = read_json('recordings.json')

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
    compensator.restore_tare(state.tare)
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
    monkeypatch.chdir(HERE)

    def run(*words):
        capsys.readouterr()
        assert main([str(word) for word in words]) == 0, words
        return capsys.readouterr().out

    return run


@pytest.fixture
def store(tmp_path):
    """A copy of the node's folder."""
    return ModelStore(Path(shutil.copytree(HERE / 'store', tmp_path / 'moved')))


def close(expected):
    return pytest.approx(expected, abs=TOLERANCE, rel=0)


def test_the_models_are_of_every_method_and_structure():
    assert len(MODELS) == 18
    axes = [
        axis
        for path in MODELS
        for axis in yaml.safe_load(path.read_text(encoding='utf-8'))['axes'].values()
    ]
    chosen = {axis['chosen'].split(',')[0] for axis in axes}
    assert chosen >= {
        'none', 'static', 'pcr', 'pls', 'filtered_pls', 'arx_pls', 'PLS on a bank',
        '1 time constant', '2 time constants', '3 time constants',
    }  # fmt: skip
    running = [axis['model'] for axis in axes if axis['model'] is not None]
    assert {model['features']['kind'] for model in running} == {'powers', 'hats'}
    assert {model['features']['degree'] for model in running} == {1, 2, 3}
    assert {len(model['dynamics']['output_mean']) for model in running} == {1, 2}
    assert any(model['filters'] for model in running)


@every_model
def test_a_model_gives_the_same_drift_in_a_batch(path):
    expected = read_json(str(path.relative_to(HERE).with_suffix('.json')))
    stored = load_model(path)
    assert stored.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    drifts = dict(
        zip(
            ('zero', 'sensitivity'), simulated(stored.model, HERE / expected['input']), strict=True
        )
    )
    for part, drift in drifts.items():
        wanted = np.zeros(drift.shape)
        for axis, values in expected[part].items():
            wanted[:, AXES.index(axis)] = values
        np.testing.assert_allclose(drift, wanted, rtol=0, atol=TOLERANCE)


@every_model
def test_a_model_corrects_a_stream_to_the_same_wrenches(path):
    expected = read_json(str(path.relative_to(HERE).with_suffix('.json')))
    outputs = stream(fresh(load_model(path).model), HERE / expected['input'], 0)
    np.testing.assert_allclose(outputs, expected['stream'], rtol=0, atol=TOLERANCE)


def same_numbers(value, expected):
    """Whatever was printed then is printed now; there may be more."""
    if isinstance(expected, dict):
        for key, each in expected.items():
            same_numbers(value[key], each)
    elif isinstance(expected, float):
        assert value == pytest.approx(expected, rel=1e-9, abs=0)
    else:
        assert value == expected


@pytest.mark.parametrize('name', EVALUATIONS)
def test_a_model_is_evaluated_to_the_same_figures(printed, name):
    then = EVALUATIONS[name]
    now = json.loads(printed('evaluate', *then['words'], '--json'))
    assert then['printed']['axes']
    same_numbers(now, then['printed'])


@every_model
def test_a_model_is_shown(printed, path):
    content = path.read_bytes()
    shown = json.loads(printed('show', path, '--json'))
    assert shown['sha256'] == hashlib.sha256(content).hexdigest()
    for axis, entry in yaml.safe_load(content)['axes'].items():
        assert shown['axes'][axis]['chosen'] == entry['chosen']
        assert axis in printed('show', path)


def test_a_stream_goes_on_from_the_saved_state():
    expected = read_json('state.json')
    stored = load_model(HERE / 'store/models' / str(STORED_HISTORY[-1]))
    state = load_state(HERE / 'store/state.json')
    assert state is not None
    assert state.thermal is not None
    assert state.model_sha256 == stored.sha256
    assert state.tare.all()
    compensator = resumed(stored.model, state)
    held = compensator.correct(state.thermal.end_ns, [1.0] * len(AXES))
    assert held == close(expected['held'])
    first_ns = state.thermal.end_ns + 3 * stored.model.period_ns
    outputs = stream(compensator, HERE / 'input_2.csv', first_ns)
    np.testing.assert_allclose(outputs, expected['stream'], rtol=0, atol=TOLERANCE)
    new = stream(fresh(stored.model), HERE / 'input_2.csv', first_ns)
    assert not np.allclose(outputs, new, rtol=0, atol=0.1), 'the state counts'


def test_the_list_of_models_is_read_where_it_was_moved_to_and_rolled_back(store):
    def names():
        return [path and path.name for path in ModelStore(store.directory).history()]

    assert names() == STORED_HISTORY
    assert store.given() == ''
    assert [path.name for path in store.recordings()] == ['recording_20261121T220452Z.csv']
    assert all(load_model(path).model.thermometers == 2 for path in store.history()[1:])
    store.activate(store.history()[:-1])
    assert names() == STORED_HISTORY[:-1]


@pytest.mark.parametrize('then', RECORDINGS, ids=lambda r: f'{r["path"]} {r["wrench_topic"]}')
def test_a_recording_is_read_to_the_same_cells(then, printed):
    assert 'temperature' in printed('show', then['path'], '--wrench-topic', then['wrench_topic'])
    topics = Topics(wrench=then['wrench_topic'])
    recording = read_recording(HERE / then['path'], period_s=then['period_s'], topics=topics)
    channels = np.hstack([recording.temperature_c, recording.wrench, recording.reference])
    weights = np.arange(1, len(channels) + 1)[:, np.newaxis]
    assert recording.first_cell == then['first_cell']
    assert np.isfinite(channels).sum(axis=0).tolist() == then['present']
    for key, sums in (('sum', channels), ('weighted_sum', weights * channels)):
        np.testing.assert_allclose(np.nansum(sums, axis=0), then[key], rtol=1e-9, atol=1e-9)


def test_a_recording_is_compensated_to_the_same_wrenches(printed, tmp_path):
    model, source = 'models/arx_pls_oe_loaded.yaml', 'recordings/loaded.csv'
    printed('compensate', model, source, '-o', tmp_path / 'now.csv')
    now, then, raw = (
        read_recording(path, period_s=20).wrench
        for path in (tmp_path / 'now.csv', HERE / 'recordings/compensated.csv', HERE / source)
    )
    np.testing.assert_allclose(now, then, rtol=0, atol=TOLERANCE)
    assert np.nanmax(np.abs(now - raw)) > 1.0
