"""The payload in operation: specific force, weight, and the second tare."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrist_ft_comp.payload.weight import ForceFrame, LivePayload, Payload
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
CONSTANT = np.array([3.0, -4.0, 5.0, 0.1, -0.2, 0.3])


def test_a_tool_that_is_tared_stays_at_zero_however_it_turns(make_model):
    """By an accelerometer that is crooked, biased and of the wrong scale."""
    rotation = Rotation.from_rotvec([0, 0, 0.3]).as_matrix()
    frame = ForceFrame(rotation, np.array([0.1, -0.2, 0.3]), np.array([1.02, 0.97, 1.0]))
    tool = LivePayload('tool-1', Payload(1.5, np.array([0.01, -0.02, 0.06])), frame)
    assert str(tool) == 'tool-1, 1.5000 kg at (0.0100, -0.0200, 0.0600) m'
    model = make_model({'force_z': (0.4, 2e-3, 1e-9), 'torque_x': (0.01, 0.0, 1e-9)})
    compensator = Compensator(1, StreamSettings(), model)
    for second in range(2):
        compensator.add_temperature(0, START + second * SECOND, 35.0)
    drift, stamp = compensator.compensation, START + 2 * SECOND
    assert drift.sensitivity[2] == pytest.approx(0.03)

    def measured(true):
        return tuple((rotation.T @ true * frame.scale + frame.bias).tolist())

    def raw(force, contact=0.0):
        pushed = -1.5 * force
        true = np.append(pushed, np.cross(tool.payload.center_m, pushed)) + contact
        return ((1 + drift.sensitivity) * true + drift.zero + CONSTANT).tolist()

    def external(force, contact=0.0):
        corrected = compensator.correct(stamp, raw(force, contact), external=True)
        return tool.taken_off(corrected, measured(force))

    first, *others = 9.807 * Rotation.random(20, random_state=1).as_matrix()[:, 0]
    weight = np.array(tool.weight(measured(first)))
    compensator.set_tare(np.array(raw(first)), stamp, weight)
    np.testing.assert_allclose(compensator.correct(stamp, raw(first)), 0.0, atol=1e-12)
    for force in (first, *others):
        np.testing.assert_allclose(external(force), 0.0, atol=1e-12)
        np.testing.assert_allclose(external(force, CONSTANT), CONSTANT, atol=1e-12)
    assert np.abs(compensator.correct(stamp, raw(others[0]))).max() > 1.0
    compensator.set_tare(CONSTANT + drift.zero, stamp)  # of the empty sensor
    np.testing.assert_allclose(external(first), 0.0, atol=1e-12)
    compensator.reset_tare()
    np.testing.assert_allclose(external(first), CONSTANT / (1 + drift.sensitivity), atol=1e-12)


def test_roll_pitch_and_yaw_are_turns_about_fixed_axes():
    turn = Rotation.from_euler('xyz', [10.0, 20.0, -30.0], degrees=True)
    frame = ForceFrame(turn.as_matrix())
    assert '10.0, 20.0, -30.0 degrees' in str(frame)
    assert frame.apart_deg(ForceFrame()) == pytest.approx(np.degrees(turn.magnitude()))
