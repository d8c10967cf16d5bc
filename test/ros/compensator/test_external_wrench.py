"""The wrench without the payload: when it comes, what it says, and who may change what is held."""

from dataclasses import replace
import queue

from geometry_msgs.msg import WrenchStamped
import numpy as np
import pytest
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Imu

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.files.payload_file import add_payloads
from wrist_ft_comp.model.payload.weight import ForceFrame, Payload
from wrist_ft_comp.ros.payload import status

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
OK, WARN = b'\0', b'\1'
TOOL = Payload(1.5, np.array([0.01, -0.02, 0.06]))
PART = Payload(2.5, np.array([0.02, 0.01, 0.1]))
#: The IMU stands on its head beside the sensor.
FRAME = ForceFrame(np.diag([1.0, -1.0, -1.0]))
UP, ASIDE = np.array([0.0, 0.0, 9.807]), np.array([9.807, 0.0, 0.0])
CONSTANT = np.array([3.0, -4.0, 5.0, 0.1, -0.2, 0.3])
IMU = {'gravity.source': 'imu'}


@pytest.fixture
def learnt(tmp_path):
    """Let two payloads have been learnt."""
    add_payloads(tmp_path / 'data/models/payloads.json', 'day', [TOOL, PART], FRAME)


@pytest.fixture
def holding(rig, learnt):  # noqa: ARG001
    """Make nodes that hold the tool; externals are in a queue."""

    def make(**parameters):
        node = rig(parameters={**IMU, 'payload.active': 'day-1', **parameters})
        node.externals = queue.Queue()
        node.node.external.publish = node.externals.put
        return node

    return make


def feel(node, stamp, force, speed=None):
    """Tell a specific force in the wrench's frame, as the IMU has it."""
    measured = tuple((FRAME.rotation.T @ force).tolist())
    node.node.tell('on_force', stamp, measured, speed)


def values(message):
    """Six numbers of a message, N and N m."""
    force, torque = message.wrench.force, message.wrench.torque
    return np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])


def head(message):
    """Stamp, ns, and frame."""
    stamp = message.header.stamp
    return stamp.sec * SECOND + stamp.nanosec, message.header.frame_id


def ask(node, stamp, wrench):
    """Send a wrench; return what comes on wrench, and on wrench_external or None."""
    before = node.externals.qsize()
    corrected = node.ask_output(stamp, wrench)
    if node.externals.qsize() == before:
        return corrected, None
    message = deserialize_message(node.externals.get(), WrenchStamped)
    assert head(message) == (stamp, 'tool0')
    return corrected, values(message)


def test_it_comes_over_dds_with_the_header_of_the_wrench(wired, messages, learnt):  # noqa: ARG001
    node = wired(parameters={**IMU, 'payload.active': 'day-1'})
    externals = node.bench.listen(
        WrenchStamped, node.topic('wrench_external'), QoSProfile(depth=9)
    )
    imu = node.bench.publisher(Imu, node.topic('imu'))
    imu.publish(messages.imu(START, (FRAME.rotation.T @ ASIDE).tolist(), [0.0, 0.1, 0.0]))
    forces = node.node.external.forces
    node.wait_until(lambda: forces.count == 1, 'the specific force')
    node.wait_until(node.node.external.output.get_subscription_count, 'the listener')
    raw = TOOL.weight(ASIDE) + CONSTANT
    assert node.ask_output(START + SECOND // 10, raw) == tuple(raw)
    message = externals.get(timeout=20.0)
    assert head(message) == (START + SECOND // 10, 'tool0')
    np.testing.assert_allclose(values(message), CONSTANT, atol=1e-12)
    assert node.node.external.speed == pytest.approx(0.1)


def test_who_holds_nothing_pays_nothing(rig):
    node = rig(parameters=IMU)
    feel(node, START, UP)
    node.ask_output(START, CONSTANT)
    assert node.node.external.wanted is False
    assert node.node.external.published == 0
    found = node.diagnosis('payload')
    assert (found.level, found.message) == (OK, 'no payload is active')
    assert found.values['active'] == 'none'


def test_without_fresh_specific_force_it_rests_and_the_wrench_goes_on(holding):
    node = holding()
    assert ask(node, START, CONSTANT) == (tuple(CONSTANT), None)
    found = node.diagnosis('payload')
    assert (found.level, found.message) == (
        WARN, 'no specific force has come; wrench_external rests',
    )  # fmt: skip
    feel(node, START, UP)
    for late, comes in ((0, True), (SECOND // 5, True), (SECOND // 5 + 1, False)):
        corrected, external = ask(node, START + late, CONSTANT)
        assert corrected == tuple(CONSTANT)
        assert (external is not None) == comes
    found = node.diagnosis('payload')
    assert (found.level, found.values['force_age_s']) == (WARN, '0.200')
    assert found.message.startswith('specific force is older than gravity.timeout')
    assert node.set('gravity.timeout', 0.3).successful
    _, external = ask(node, START + SECOND // 4, TOOL.weight(UP))
    np.testing.assert_allclose(external, 0.0, atol=1e-12)
    feel(node, START + SECOND, ASIDE)
    _, external = ask(node, START + SECOND, TOOL.weight(ASIDE))
    np.testing.assert_allclose(external, 0.0, atol=1e-12)
    found = node.diagnosis('payload')
    assert (found.level, found.message) == (OK, 'subtracting day-1')
    assert found.values['active'] == 'day-1, 1.5000 kg at (0.0100, -0.0200, 0.0600) m'


def test_an_imu_is_asked_when_its_newest_sample_is_behind_the_wrench(holding):
    node = holding()
    asked = []
    node.node.gravity.poll = lambda: asked.append(True)
    for stamp, times in ((START, 1), (START, 2)):
        ask(node, stamp, CONSTANT)
        assert len(asked) == times
    feel(node, START, UP)
    for late_ns, times in ((-SECOND // 100, 2), (0, 2), (2_000_000, 2), (2_000_001, 3)):
        ask(node, START + late_ns, CONSTANT)
        assert len(asked) == times


def test_a_payload_changes_with_the_next_wrench_and_refusals_change_nothing(holding):
    node = holding()
    feel(node, START, UP)
    for name, held in (('day-2', PART), ('day-1', TOOL)):
        assert node.set('payload.active', name).successful
        np.testing.assert_allclose(ask(node, START, held.weight(UP))[1], 0.0, atol=1e-12)
    refused = node.set('payload.active', 'day-3')
    assert not refused.successful
    assert 'learnt (day-1, day-2); got day-3' in refused.reason
    np.testing.assert_allclose(ask(node, START, TOOL.weight(UP))[1], 0.0, atol=1e-12)
    assert node.set('payload.active', '').successful
    assert ask(node, START, CONSTANT)[1] is None


def test_what_is_mounted_can_be_said_by_hand_and_turns_as_a_calibration_found(holding):
    node = holding(**{'payload.active': ''})
    wanted = {'payload.active': 'manual', 'payload.mass': 2.5, 'payload.center_of_mass': [1.0]}
    refused = node.node.set_parameters_atomically(
        [Parameter(n, value=v) for n, v in wanted.items()]
    )
    assert not refused.successful
    assert 'three numbers in m' in refused.reason
    wanted['payload.center_of_mass'] = PART.center_m.tolist()
    done = node.node.set_parameters_atomically([Parameter(n, value=v) for n, v in wanted.items()])
    assert done.successful, done.reason
    feel(node, START, ASIDE)
    np.testing.assert_allclose(ask(node, START, PART.weight(ASIDE))[1], 0.0, atol=1e-12)
    assert node.set('payload.mass', 2.0).successful
    assert ask(node, START, PART.weight(ASIDE))[1][0] == pytest.approx(-0.5 * 9.807)


@pytest.mark.parametrize(
    ('parameters', 'sentence'),
    [
        ({'payload.active': 'day-1'}, 'gravity.source is none, so nobody knows where down is'),
        ({**IMU, 'payload.active': 'nail'}, r'learnt \(there is none yet\); got nail'),
    ],
)
def test_a_payload_that_cannot_be_had_is_refused_at_the_start(rig, parameters, sentence):
    with pytest.raises(SettingsError, match=sentence):
        rig(parameters=parameters)


def test_a_payload_that_another_source_told_is_refused(rig, tmp_path):
    path = tmp_path / 'data/models/payloads.json'
    add_payloads(path, 'day', [TOOL], replace(FRAME, source='tf'))
    with pytest.raises(SettingsError, match='day-1, which was learnt by tf, and'):
        rig(parameters={**IMU, 'payload.active': 'day-1'})


def test_by_hand_it_waits_at_the_start_for_what_only_tf_can_tell(rig):
    by_hand = {'payload.active': 'manual', 'payload.mass': 1.5}
    node = rig(parameters={**IMU, **by_hand, 'payload.center_of_mass': TOOL.center_m.tolist()})
    feel(node, START, UP)
    node.ask_output(START, CONSTANT)
    found = node.diagnosis('payload')
    assert (found.level, node.node.external.published) == (WARN, 0)
    assert 'nobody knows how specific force is turned' in found.message
    refused = node.set('payload.mass', 2.5)
    assert 'nobody knows how specific force is turned' in refused.reason
    node.node.gravity.mount = lambda: FRAME
    assert node.diagnosis('payload').message == 'subtracting manual'
    feel(node, START, ASIDE)
    weight = node.node.external.weight_at(START)
    np.testing.assert_allclose(weight, TOOL.weight(ASIDE), atol=1e-12)


def test_a_tare_zeroes_both_and_outlives_a_restart(holding):
    node = holding(**{'tare.duration': 0.2})
    answers = node.ask('tare')
    for k in range(21):
        stamp = START + k * SECOND // 100
        feel(node, stamp, UP)
        ask(node, stamp, TOOL.weight(UP) + CONSTANT)
    answer = answers.get(timeout=20.0)
    assert answer.success
    assert answer.message.endswith('; wrench_external is tared, too')
    numbers = node.diagnosis('payload').values
    assert (numbers['force_y_tare'], numbers['torque_z_tare']) == ('-4 N', '0.3 N m')
    node.node.state_keeper.end()
    for again in (node, holding()):
        feel(again, START + SECOND, UP)
        both = ask(again, START + SECOND, TOOL.weight(UP) + CONSTANT)
        np.testing.assert_allclose(both, 0.0, atol=1e-12)
        feel(again, START + 2 * SECOND, ASIDE)
        corrected, external = ask(again, START + 2 * SECOND, TOOL.weight(ASIDE) + CONSTANT)
        np.testing.assert_allclose(external, 0.0, atol=1e-12)
        assert abs(corrected[0]) > 10.0
    assert node.call('reset_tare').success
    both = ask(node, START + 2 * SECOND, TOOL.weight(ASIDE) + CONSTANT)
    np.testing.assert_allclose(both, [TOOL.weight(ASIDE) + CONSTANT, CONSTANT])


def test_a_tare_without_specific_force_leaves_the_external_one_alone(holding):
    node = holding(**{'tare.duration': 0.2})
    answers = node.ask('tare')
    for k in range(21):
        ask(node, START + k * SECOND // 100, CONSTANT)
    assert answers.get(timeout=20.0).message.endswith(
        'is not: specific force stayed away meanwhile'
    )
    assert not node.node.compensator.external_tare.any()


@pytest.mark.parametrize(
    ('forces', 'sentence'),
    [
        ([UP / 9.807] * 2, 'specific force is 1 m/s², and 9.807 at rest; check its unit'),
        ([UP] * (status._FROZEN + 1), 'has not changed by a bit for seconds; is the IMU frozen?'),
    ],
)
def test_specific_force_that_cannot_be_right_is_told(holding, forces, sentence):
    node = holding()
    for force in forces:
        feel(node, START, force)
        ask(node, START, CONSTANT)
        found = node.diagnosis('payload')
    assert (found.level, sentence in found.message) == (WARN, True)


def test_specific_force_of_another_clock_is_told(holding):
    node = holding()
    feel(node, START - 7200 * SECOND, UP)
    assert ask(node, START, CONSTANT)[1] is None
    assert '7200 s apart: two clocks; wrench_external rests' in node.diagnosis('payload').message
