"""The service that learns what is mounted: its answers, what it keeps, and when it refuses."""

import json
import math

from moments import SECOND, START
import numpy as np
import pytest

from wrist_ft_comp.node import calibration_services
from wrist_ft_comp.simulation import robot_at_work

RATE_HZ = 20
IMU = {'gravity.source': 'imu'}


@pytest.fixture
def working(rig, make_model):
    """A node whose drift model runs, and which knows where down is."""
    model = make_model('m.yaml', {'force_z': (2.0, 0.0, 600.0)})
    node = rig(model=model, parameters=IMU)
    node.warm_up(20.0)
    node.node.broadcast('on_specific_force', START, (0.0, 0.0, 9.8), None)
    return node


@pytest.fixture(scope='module')
def minute():
    """A minute of a robot's work, and a little more: its tool, motion, and what its IMU says."""
    rng = np.random.default_rng([2024, 50])
    work = robot_at_work.draw_work(robot_at_work.WorkSettings(part_kg=0.0), rng)
    time_s = np.arange(0, 62, 1 / RATE_HZ)
    motion = robot_at_work.move(work, time_s)
    accelerometer = robot_at_work.draw_accelerometer(rng)
    imu = robot_at_work.read_imu(accelerometer, motion, np.zeros(len(time_s)), rng)
    return work.payloads[0], motion, imu


def send(node, minute, rows, torques=1.0):
    _, motion, imu = minute
    for k in rows:
        stamp = START + 2 * SECOND + k * SECOND // RATE_HZ
        felt, speed = tuple(imu[k, :3].tolist()), math.hypot(*imu[k, 3:])
        node.node.broadcast('on_specific_force', stamp, felt, speed)
        wrench = motion.weight[k] + motion.contact[k] + 1.0
        node.ask_output(stamp, (wrench * np.repeat([1.0, torques], 3)).tolist())


@pytest.mark.parametrize('torques', [1.0, np.nan], ids=['six axes', 'forces alone'])
def test_a_minute_of_work_gives_the_payload_and_the_next_step(working, minute, torques):
    tool, center_m = minute[0], minute[0].center_m * (torques == 1)
    answers = working.ask('identify_payload')
    send(working, minute, range(600), torques)
    assert working.diagnosis('payload').message == 'identifying a payload: 50% of a minute'
    send(working, minute, range(600, 1202), torques)
    answer = working.answered(answers)
    assert answer.success, answer.message
    path = working.directory / 'models/payloads.json'
    (kept,) = json.loads(path.read_text('utf-8'))['payloads'].items()
    assert (kept[0], kept[1]['source']) == ('identified-1', 'imu')
    assert kept[1]['wrench_frame'] == 'tool0'
    assert kept[1]['mass_kg'] == pytest.approx(tool.mass_kg, rel=0.03)
    np.testing.assert_allclose(kept[1]['center_of_mass_m'], center_m, atol=5e-3)
    assert answer.message.startswith(f'identified-1: {kept[1]["mass_kg"]:.3f} ± 0.0')
    assert 'Specific force is turned by roll, pitch, yaw of ' in answer.message
    name = working.node.get_fully_qualified_name()
    use = f'ros2 param set {name} payload.active identified-1'
    assert answer.message.endswith(use)
    assert working.node.external.wanted is False, 'nobody wants wrenches any more'
    assert working.set('payload.active', 'identified-1').successful
    send(working, minute, range(1202, 1210))
    assert working.externals.qsize() == 8


def test_an_identification_needs_specific_force_and_a_drift_model(rig, working):
    bare = rig(parameters=IMU)
    assert 'No specific force has come. Set gravity.source' in bare.refusal('identify_payload')
    bare.node.broadcast('on_specific_force', START, (0.0, 0.0, 9.8), None)
    said = bare.refusal('identify_payload')
    assert 'No drift model runs, and drift would be taken for weight' in said
    assert working.node.external.collector is None


@pytest.mark.parametrize(('patience_s', 'happens', 'words'), [
    (60.0, lambda node: node.compensator.reset_tare(),
     'The tare or the model changed meanwhile. Call again.'),
    (0.05, lambda _: None, 'Wrenches with specific force have stayed away for 0.05 s'),
], ids=['tare', 'silence'])  # fmt: skip
def test_a_caller_is_answered_where_an_identification_cannot_go_on(  # noqa: PLR0913, PLR0917
    working, minute, monkeypatch, patience_s, happens, words
):
    monkeypatch.setattr(calibration_services, '_PATIENCE_S', patience_s)
    answers = working.ask('identify_payload')
    send(working, minute, range(10))
    happens(working.node)
    assert words in working.answered(answers).message
