"""A node that is started on what nodes of versions 0.1.0 and 0.2.0 left behind."""

import csv
import json
from pathlib import Path
import shutil

import pytest

V0_1_0, V0_2_0 = VERSIONS = sorted((Path(__file__).parents[2] / 'fixtures').glob('v*'))
SECOND = 1_000_000_000
AXES = ('force_x', 'force_y', 'force_z', 'torque_x', 'torque_y', 'torque_z')
every_version = pytest.mark.parametrize('version', VERSIONS, ids=lambda version: version.name)


@pytest.fixture
def start(rig, tmp_path):
    """Start a node in a copy of a store; by simulated time, or the state would be too old."""

    def make(version, **parameters):
        shutil.copytree(version / 'store', tmp_path / 'data')
        return rig(thermometers=2, parameters={'use_sim_time': True, **parameters})

    return make


def read_json(path):
    return json.loads(path.read_text(encoding='utf-8'))


def close(expected):
    return pytest.approx(expected, abs=1e-9, rel=0)


@every_version
def test_a_node_goes_on_from_the_saved_state(start, version):
    node, expected = start(version), read_json(version / 'state.json')
    thermal = read_json(version / 'store/state.json')['thermal']
    assert node.ask_output(thermal['end_ns'], [1.0] * 6) == close(expected['held'])
    with (V0_1_0 / 'input_2.csv').open(encoding='utf-8') as file:
        rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    first_ns = thermal['end_ns'] + 3 * thermal['period_ns']
    outputs = []
    for number, row in enumerate(rows[:16]):
        stamp = first_ns + round(row['stamp_s'] * SECOND)
        node.warm(stamp, row['temperature_c'], row['temperature_2_c'])
        if number % 4 == 3:
            outputs.append(node.ask_output(stamp + SECOND, [row[axis] for axis in AXES]))
    for output, wanted in zip(outputs, expected['stream'][:4], strict=True):
        assert output == close(wanted)


def test_a_node_goes_on_learning(start):
    chosen = {'learning': 'propose', 'calibration.reference': 'payload', 'gravity.source': 'imu'}
    node = start(V0_2_0, **chosen)
    learning = node.node.learning
    assert learning.memory.judged == 'day_00003.csv'
    assert [path.name for path in learning.diary.files.ended()][-1] == 'day_00003.csv'
    assert learning.diary.files.path.name == 'day_00004.csv'
    assert node.diagnosis('learning').level == b'\0'
