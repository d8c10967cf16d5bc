"""
~/correction, added by a controller as admittance_controller 4.18.0 and later does.

The stand-in follows the controller's source (ros2_controllers 4.42.1), which was read and not run.
"""

import numpy as np
import pytest

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
TIMEOUT_S = 60.0
MODEL = {'force_z': (2.0, 2e-4, 60.0), 'torque_x': (0.05, 0.0, 60.0)}
#: Wrenches of a second, and how many of them follow one correction.
WRENCHES, CYCLES = 20, 2
CONTACT = np.array([3.0, -4.0, 25.0, 0.2, 0.1, -0.3])


class AdmittanceController:
    """Adds the last ~/wrench_reference of its frame to the measured wrench in every cycle."""

    def __init__(self, node):
        self.node = node
        self.reference = np.zeros(6)  # as activation sets it
        self.node.node.drift_topic.correction.publish = self.on_reference

    def on_reference(self, message):
        if message.header.frame_id in {'', 'tool0'}:
            force, torque = message.wrench.force, message.wrench.torque
            self.reference = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])

    def correct(self):
        """Let the timer of the node fire."""
        self.node.node.drift_topic.poll()

    def run(self, seconds):
        """Warm up by 0.1 K/s under a contact; what the controller sees, ``wrench``, raw."""
        seen, wrenches, raws = [], [], []
        for second in seconds:
            self.node.warm(START + second * SECOND, 20.0 + 0.1 * second)
            for cycle in range(1, WRENCHES + 1):
                raw = CONTACT + np.array([0, 0, 0.1 * second, 0, 0, 0])
                stamp = START + second * SECOND + cycle * SECOND // WRENCHES
                wrenches.append(self.node.ask_output(stamp, raw))
                seen.append(raw + self.reference)
                raws.append(raw)
                if cycle % CYCLES == 0:
                    self.correct()
        return np.array(seen), np.array(wrenches), np.array(raws)


@pytest.fixture
def controller(rig, make_model):
    return AdmittanceController(rig(model=make_model('m.yaml', MODEL)))


def test_the_controller_sees_the_compensated_wrench(controller):
    """To within what drifts in one period, and 0.1 % of all that is corrected; with a tare."""
    controller.run(range(120))
    compensator = controller.node.node.compensator
    assert compensator.compensation.zero[2] > 10.0
    compensator.set_tare(CONTACT, START + 120 * SECOND)
    controller.correct()
    seen, wrenches, raws = controller.run(range(120, 150))
    corrected = np.abs(raws - wrenches).max(axis=0)
    drift_of_a_period = 2.0 * 0.1 * CYCLES / WRENCHES
    assert corrected[2] > 30.0
    assert np.abs(seen - wrenches)[:, 2].max() < min(drift_of_a_period, 1e-3 * corrected[2])
    assert np.abs(seen - wrenches)[:, 3].max() < 1e-3 * corrected[3] + 1e-3
    assert abs(compensator.compensation.sensitivity[2]) > 5e-4
    for force in (0.0, 100.0):  # the gain is that of the newest wrench
        raw = np.array([0, 0, force, 0, 0, 0])
        wrench = controller.node.ask_output(START + 150 * SECOND, raw)
        controller.correct()
        np.testing.assert_allclose(raw + controller.reference, wrench, atol=1e-12)


def test_no_correction_comes_before_the_drift_and_only_the_tare_without_a_model(controller):
    controller.reference += 1.0
    for _ in range(2):  # before the first wrench, and before the first temperature
        controller.correct()
        np.testing.assert_array_equal(controller.reference, np.ones(6))
        controller.node.ask_output(START, CONTACT)
    controller.run(range(30))
    assert controller.reference[2] < -1.0
    controller.node.node.compensator.go_live(None)
    controller.node.node.compensator.reset_tare()
    controller.correct()
    np.testing.assert_array_equal(controller.reference, np.zeros(6))
