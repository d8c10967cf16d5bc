from dataclasses import replace
import json

from geometry_msgs.msg import WrenchStamped
from moments import SECOND, six_of, START
import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from scipy.spatial.transform import Rotation

from wrist_ft_comp.channels import GRAVITY
from wrist_ft_comp.cli.main import main
from wrist_ft_comp.payload.weight import Payload

TOOL = Payload(1.3, np.array([0.01, -0.02, 0.09]))
#: Drift per kelvin from 20 °C on, as make_working_day makes it.
DRIFT = np.array([0.3, -0.2, 0.5, 0.01, 0.02, -0.01])
WARM_C = 30.0
#: Poses of free motion, one after the other, and half a second in each.
POSES = Rotation.random(12, random_state=5)
#: Errors that no standard error of a mass holds: of the turn, rad, and of the bias, m/s².
TURN, BIAS = np.deg2rad(0.3), 0.03


def free_motion(node, messages, read):
    """Move freely: errors of the weight that is taken off, and wrench_external less its mean."""
    node.warm_up(WARM_C)
    wrong, externals = [], []
    for k, pose in enumerate(POSES):
        stamp, up = START + (4 + k) * SECOND // 2, pose.inv().apply([0, 0, GRAVITY])
        felt = messages.imu(stamp, read(up).tolist(), [0.0, 0.0, 0.1])
        node.node.specific_force.on_imu(felt)
        node.ask_output(stamp, TOOL.weight(up) + (WARM_C - 20.0) * DRIFT + 1.0)
        wrong.append(node.node.external.weight_at(stamp) - TOOL.weight(up))
        externals.append(six_of(deserialize_message(node.externals.get_nowait(), WrenchStamped)))
    return np.array(wrong), np.array(externals) - np.mean(externals, axis=0)


def test_a_payload_learnt_by_an_imu_is_subtracted_by_its_raw_samples(
    make_working_day, write_working_day, rig, messages, tmp_path
):
    day = make_working_day(1, cells=1200, part=False)
    scale, bias = 1.05, np.array([0.2, -0.1, 0.15])
    turn = Rotation.from_rotvec([0.6, 2.9, -1.2])
    felt = day.specific_force @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    noise = np.random.default_rng(1).normal(0, 0.005, felt.shape)

    def read(up):
        return scale * turn.inv().apply(up) + bias

    path = write_working_day(tmp_path / 'day.csv', replace(day, specific_force=read(felt) + noise))
    model, options = tmp_path / 'tool.yaml', ['--reference', 'payload', '--method', 'pls']
    assert main(['calibrate', str(path), '-o', str(model), *options]) == 0
    ((name, entry),) = json.loads((tmp_path / 'payloads.json').read_text())['payloads'].items()
    np.testing.assert_allclose(entry['scale'], scale, rtol=0.01)
    assert entry['mass_kg'] == pytest.approx(TOOL.mass_kg, abs=3 * entry['mass_error_kg'])
    chosen = {'gravity.source': 'imu', 'payload.active': name, 'model_file': str(model)}
    wrong, external = free_motion(rig(parameters=chosen), messages, read)
    # Three standard errors of the mass, and what it does not hold: turn, bias, and drift.
    weight, three_kg = entry['mass_kg'] * GRAVITY, 3 * entry['mass_error_kg']
    allowed = three_kg * GRAVITY + (TURN + BIAS / GRAVITY) * weight
    assert np.abs(wrong[:, :3]).max() < allowed
    assert np.abs(external[:, :3]).max() < 2 * allowed
    assert np.abs(external[:, 3:]).max() < 0.2 * allowed
