"""
~/correction, added by a controller as admittance_controller 4.18.0 and later does.

The stand-in follows the controller's source (ros2_controllers 4.42.1), which was read and not run.
"""

from moments import SECOND, six_of, START
import numpy as np
import pytest

#: The gain of force z is 1 + 0.02 % per K.
MODEL = {'force_z': (2.0, 2e-4, 60.0), 'torque_x': (0.05, 0.0, 60.0)}
CONTACT = np.array([3.0, -4.0, 25.0, 0.2, 0.1, -0.3])


class AdmittanceController:
    """Adds the last ~/wrench_reference of its frame to the measured wrench in every cycle."""

    def __init__(self, node):
        self.node, self.reference = node, np.zeros(6)  # as activation sets it
        node.node.drift_topic.correction.publish = self.on_reference

    def on_reference(self, message):
        if message.header.frame_id in {'', 'tool0'}:
            self.reference = np.array(six_of(message))

    def hears(self, raw):
        """Let the timer of the node fire; tell whether what is seen is the compensated wrench."""
        wrench = self.node.ask_output(START + 150 * SECOND, raw)
        self.node.node.drift_topic.poll()
        return np.allclose(raw + self.reference, wrench, atol=1e-12)


@pytest.fixture
def controller(rig, make_model):
    return AdmittanceController(rig(model=make_model('m.yaml', MODEL)))


def test_the_controller_sees_the_compensated_wrench(controller):
    node = controller.node
    for second in range(150):
        node.put_temperature(START + second * SECOND, 20.0 + 0.1 * second)
    assert controller.hears(CONTACT)
    assert controller.reference[2] < -10.0
    node.node.compensator.set_tare(CONTACT, START + 149 * SECOND)
    for force in (1.0, 100.0):
        assert controller.hears(np.array([0, 0, force, 0, 0, 0]))


def test_no_correction_comes_before_the_drift_and_only_the_tare_without_a_model(controller):
    controller.reference += 1.0
    for _ in range(2):  # before the first wrench, and before the first temperature
        controller.node.node.drift_topic.poll()
        np.testing.assert_array_equal(controller.reference, np.ones(6))
        controller.node.ask_output(START, CONTACT)
    controller.node.warm_up(25.0)
    assert controller.hears(CONTACT)
    assert controller.reference[2] < -1.0
    controller.node.node.compensator.go_live(None)
    controller.node.node.compensator.reset_tare()
    controller.node.set('uncalibrated', 'silent')
    controller.node.node.drift_topic.poll()
    assert controller.reference[2] < -1.0, 'it is silent, too'
    controller.node.set('uncalibrated', 'passthrough')
    assert controller.hears(CONTACT)
    np.testing.assert_array_equal(controller.reference, np.zeros(6))
