"""
~/correction, added by a controller as admittance_controller 4.18.0 and later does.

The stand-in follows the controller's source (ros2_controllers 4.42.1), which was read and not run.
"""

from geometry_msgs.msg import WrenchStamped
import numpy as np
import pytest

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
TIMEOUT_S = 60.0
FRAME = 'tool0'
MODEL = {'force_z': (2.0, 2e-4, 60.0), 'torque_x': (0.05, 0.0, 60.0)}
#: Wrenches of a second, and how many of them follow one correction.
WRENCHES, CYCLES = 20, 2


class AdmittanceController:
    """Adds the last ~/wrench_reference to the measured wrench in every cycle."""

    def __init__(self):
        self.activate()

    def activate(self):
        """Begin without a reference."""
        self.reference = np.zeros(6)

    def on_reference(self, message):
        """Hold a reference of the sensor's frame; another frame is refused."""
        if message.header.frame_id in {'', FRAME}:
            force, torque = message.wrench.force, message.wrench.torque
            self.reference = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])

    def update(self, measured):
        """Give the wrench that the control law sees."""
        return measured + self.reference


class Cell:
    """A node beside a controller: both hear the driver."""

    def __init__(self, node):
        self.node, self.controller = node, AdmittanceController()
        node.node.correction_topic._publisher.publish = self.controller.on_reference

    def correct(self):
        """Let the timer of the node fire."""
        self.node.node.correction_topic.publish()

    def run(self, seconds, contact):
        """Warm up by 0.1 K/s under a contact; what the controller sees, ``wrench``, raw."""
        seen, wrenches, raws = [], [], []
        for second in seconds:
            self.node.warm(START + second * SECOND, celsius(second))
            for cycle in range(1, WRENCHES + 1):
                raw = contact + np.array([0, 0, celsius(second) - 20, 0, 0, 0])
                stamp = START + second * SECOND + cycle * SECOND // WRENCHES
                wrenches.append(self.node.ask_output(stamp, raw))
                seen.append(self.controller.update(raw))
                raws.append(raw)
                if cycle % CYCLES == 0:
                    self.correct()
        return np.array(seen), np.array(wrenches), np.array(raws)


def celsius(second):
    return 20.0 + 0.1 * second


CONTACT = np.array([3.0, -4.0, 25.0, 0.2, 0.1, -0.3])


@pytest.fixture
def cell(rig, make_model):
    model = make_model('m.yaml', MODEL)

    def make(**parameters):
        return Cell(rig(model=model, parameters=parameters))

    return make


def test_the_controller_sees_the_compensated_wrench(cell):
    """To within what drifts in one period, and 0.1 % of all that is corrected; with a tare."""
    robot = cell()
    robot.run(range(120), CONTACT)
    assert robot.node.node.compensator.compensation.zero[2] > 10.0
    robot.node.node.compensator.set_tare(CONTACT, START + 120 * SECOND)
    robot.correct()
    seen, wrenches, raws = robot.run(range(120, 150), CONTACT)
    corrected = np.abs(raws - wrenches).max(axis=0)
    drift_of_a_period = 2.0 * 0.1 * CYCLES / WRENCHES
    assert corrected[2] > 30.0
    assert np.abs(seen - wrenches)[:, 2].max() < drift_of_a_period
    assert np.abs(seen - wrenches)[:, 2].max() < 1e-3 * corrected[2]
    assert np.abs(seen - wrenches)[:, 3].max() < 1e-3 * corrected[3] + 1e-3


def test_the_gain_is_that_of_the_newest_wrench(cell):
    robot = cell()
    robot.run(range(120), CONTACT)
    gain = robot.node.node.compensator.compensation.sensitivity[2]
    assert abs(gain) > 5e-4
    for force in (0.0, 100.0):
        raw = np.array([0, 0, force, 0, 0, 0])
        wrench = robot.node.ask_output(START + 121 * SECOND, raw)
        robot.correct()
        np.testing.assert_allclose(robot.controller.update(raw), wrench, atol=1e-12)


def test_no_correction_comes_before_the_drift_and_only_the_tare_without_a_model(cell):
    robot = cell()
    robot.controller.reference += 1.0
    robot.correct()
    np.testing.assert_array_equal(robot.controller.reference, np.ones(6))
    robot.node.ask_output(START, CONTACT)
    robot.correct()
    np.testing.assert_array_equal(robot.controller.reference, np.ones(6))
    robot.run(range(30), CONTACT)
    assert robot.controller.reference[2] < -1.0
    robot.node.node.live.swap(None)
    robot.node.node.compensator.reset_tare()
    robot.correct()
    np.testing.assert_array_equal(robot.controller.reference, np.zeros(6))


def test_corrections_come_at_their_rate_with_and_without_wrenches(wired, make_model):
    node = wired(model=make_model('m.yaml', MODEL))
    topic = f'{node.namespace}/wrist_ft_comp/correction'
    corrections = node.bench.listen(WrenchStamped, topic)
    node.warm_up(40.0, seconds=30)
    wrench = node.ask_output(START + 30 * SECOND, CONTACT)
    messages = [corrections.get(timeout=TIMEOUT_S) for _ in range(5)]
    assert {message.header.frame_id for message in messages} == {FRAME}
    last = messages[-1].wrench
    assert CONTACT[2] + last.force.z == pytest.approx(wrench[2], abs=1e-9)
    assert CONTACT[3] + last.torque.x == pytest.approx(wrench[3], abs=1e-9)
