"""A node that is started on what nodes of versions 0.1.0 and 0.2.0 left behind."""

import csv
import json
from pathlib import Path
import queue
import shutil

from geometry_msgs.msg import WrenchStamped
import pytest
from rclpy.serialization import deserialize_message

V0_1_0, V0_2_0 = VERSIONS = sorted((Path(__file__).parents[2] / 'fixtures').glob('v*'))
SECOND = 1_000_000_000
AXES = ('force_x', 'force_y', 'force_z', 'torque_x', 'torque_y', 'torque_z')
#: Specific forces of the expectations, m/s².
FORCES = ((0.0, 0.0, 9.807), (9.0, -3.0, 2.0), (-1.0, 8.0, -5.0))
every_version = pytest.mark.parametrize('here', VERSIONS, ids=lambda here: here.name)


@pytest.fixture
def start(rig, tmp_path):
    """Start a node in a copy of a store; by simulated time, or the state would be too old."""

    def make(here, **parameters):
        shutil.copytree(here / 'store', tmp_path / 'data')
        return rig(thermometers=2, parameters={'use_sim_time': True, **parameters})

    return make


def read_json(path):
    return json.loads(path.read_text(encoding='utf-8'))


def close(expected):
    return pytest.approx(expected, abs=1e-9, rel=0)


@every_version
def test_it_goes_on_from_the_saved_state(start, here):
    node, expected = start(here), read_json(here / 'state.json')
    thermal = read_json(here / 'store/state.json')['thermal']
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


def test_it_takes_the_payload_off_under_the_saved_tare(start, messages):
    (name,) = read_json(V0_2_0 / 'store/models/payloads.json')['payloads']
    node = start(V0_2_0, **{'gravity.source': 'imu', 'payload.active': name})
    node.node.external.publish = (externals := queue.Queue()).put
    end_ns = read_json(V0_2_0 / 'store/state.json')['thermal']['end_ns']
    for number, force in enumerate(FORCES):
        node.node.gravity.on_imu(messages.imu(end_ns + number, force, [0.0] * 3))
        node.ask_output(end_ns + number, [1.0] * 6)
        wrench = deserialize_message(externals.get_nowait(), WrenchStamped).wrench
        parts = (getattr(half, axis) for half in (wrench.force, wrench.torque) for axis in 'xyz')
        assert tuple(parts) == close(read_json(V0_2_0 / 'state.json')['external'][number])


@every_version
def test_it_goes_back_to_the_models_before_and_to_none(start, here):
    node = start(here)
    history = [
        path and Path(path).name for path in read_json(here / 'store/active.json')['history']
    ]
    while (live := history.pop()) is not None:
        assert Path(node.diagnosis('model').values['file']).name == live
        answer = node.call('rollback')
        assert answer.success
        assert (history[-1] or 'uncompensated') in answer.message
    assert not node.call('rollback').success


def test_it_goes_on_learning(start):
    chosen = {'learning': 'propose', 'calibration.reference': 'payload', 'gravity.source': 'imu'}
    node = start(V0_2_0, **chosen)
    learning = node.node.learning
    assert learning.memory.judged == 'day_00003.csv'
    assert [path.name for path in learning.diary.files.ended()][-1] == 'day_00003.csv'
    assert learning.diary.files.path.name == 'day_00004.csv'
    assert node.diagnosis('learning').level == b'\0'
