"""The wrench without the payload: when it comes, what it says, and who may change what is held."""

from dataclasses import replace

from geometry_msgs.msg import WrenchStamped
import numpy as np
import pytest
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Imu

from wrist_ft_comp.node import external_wrench
from wrist_ft_comp.payload.weight import ForceFrame, FrameIds, Payload
from wrist_ft_comp.stored.payload_file import add_payloads

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
    """Make nodes that hold the tool."""
    return lambda **more: rig(parameters={**IMU, 'payload.active': 'day-1', **more})


def feel(node, stamp, force, speed=None):
    """Tell a specific force in the wrench's frame, as the IMU has it."""
    measured = tuple((FRAME.rotation.T @ force).tolist())
    node.node.broadcast('on_specific_force', stamp, measured, speed)


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


def test_the_external_wrench_has_the_header_of_the_wrench_over_dds(wired, messages, learnt):  # noqa: ARG001
    node = wired(parameters={**IMU, 'payload.active': 'day-1'})
    externals = node.bench.listen(
        WrenchStamped, node.topic('wrench_external'), QoSProfile(depth=9)
    )
    imu = node.bench.publisher(Imu, node.topic('imu'))
    imu.publish(messages.imu(START, (FRAME.rotation.T @ ASIDE).tolist(), [0.0, 0.1, 0.0]))
    forces = node.node.specific_force.forces
    node.wait_until(lambda: forces.count == 1, 'the specific force')
    node.wait_until(node.node.external.output.get_subscription_count, 'the listener')
    raw = TOOL.weight(ASIDE) + CONSTANT
    assert node.ask_output(START + SECOND // 10, raw) == tuple(raw)
    message = externals.get(timeout=20.0)
    assert head(message) == (START + SECOND // 10, 'tool0')
    np.testing.assert_allclose(values(message), CONSTANT, atol=1e-12)
    assert node.node.specific_force.speed == pytest.approx(0.1)


def test_without_a_payload_no_external_wrench_is_computed(rig):
    node = rig(parameters=IMU)
    feel(node, START, UP)
    node.ask_output(START, CONSTANT)
    assert node.node.external.wanted is False
    assert node.node.external.published == 0
    found = node.diagnosis('payload')
    assert (found.level, found.message) == (OK, 'no payload is active')
    assert found.values['active'] == 'none'


def test_without_fresh_specific_force_only_the_wrench_goes_on(holding):
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
    assert found.values['turn'].endswith('learnt with it by an unknown source')


def test_an_imu_is_asked_when_its_newest_sample_is_behind_the_wrench(holding):
    node = holding()
    asked = []
    node.node.specific_force.poll = lambda: asked.append(True)
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
    assert 'learnt (day-1, day-2); got day-3' in node.refused_value('payload.active', 'day-3')
    np.testing.assert_allclose(ask(node, START, TOOL.weight(UP))[1], 0.0, atol=1e-12)
    assert node.set('payload.active', '').successful
    assert ask(node, START, CONSTANT)[1] is None


def by_hand(payload=PART, **parameters):
    """Parameters of a payload by hand."""
    center = payload.center_m.tolist()
    body = {'payload.mass': payload.mass_kg, 'payload.center_of_mass': center}
    return {'payload.active': 'manual', **body, **parameters}


def set_all(node, parameters):
    """Set parameters in one request; return the verdict."""
    return node.node.set_parameters_atomically(
        [Parameter(name, value=value) for name, value in parameters.items()]
    )


def test_a_payload_by_hand_turns_as_this_sensor_learnt(holding, tmp_path):
    path = tmp_path / 'data/models/payloads.json'
    add_payloads(path, 'node', [TOOL], replace(FRAME, source='imu', wrench_frame='tool0'))
    node = holding(**{'payload.active': ''})
    for spoiled, sentence in (
        ({'payload.center_of_mass': [1.0]}, 'three numbers in m'),
        ({'payload.mass': 0.0}, 'payload.mass is 0'),
    ):
        refused = set_all(node, by_hand(**spoiled))
        assert not refused.successful
        assert sentence in refused.reason
    node.refused_value('payload.center_of_mass', [0.1, 0.2])
    done = set_all(node, by_hand())
    assert done.successful, done.reason
    feel(node, START, ASIDE)
    np.testing.assert_allclose(ask(node, START, PART.weight(ASIDE))[1], 0.0, atol=1e-12)
    assert node.set('payload.mass', 2.0).successful
    assert ask(node, START, PART.weight(ASIDE))[1][0] == pytest.approx(-0.5 * 9.807)
    turn = node.diagnosis('payload').values['turn']
    assert 'yaw of 180.0, 0.0, 0.0 degrees, learnt with node-1' in turn


@pytest.mark.parametrize(
    'entry',
    [
        {},
        {'source': 'tf'},
        {'source': 'imu'},
        {'source': 'imu', 'wrench_frame': 'left'},
        {'source': 'imu', 'wrench_frame': 'tool0', 'force_frame': 'x'},
    ],
)
def test_a_payload_by_hand_never_turns_as_another_sensor(holding, tmp_path, entry):
    path = tmp_path / 'data/models/payloads.json'
    other = replace(FRAME, rotation=np.diag([-1.0, -1.0, 1.0]), **entry)
    add_payloads(path, 'other', [TOOL], other)
    node = holding(**{'payload.active': ''})
    ask(node, START, CONSTANT)
    node.node.specific_force.frames = lambda: FrameIds('imu', 'tool0')
    assert 'the rotation from the IMU' in set_all(node, by_hand()).reason
    node.node.specific_force.mount = lambda: FRAME
    assert set_all(node, by_hand()).successful
    feel(node, START, ASIDE)
    np.testing.assert_allclose(ask(node, START, PART.weight(ASIDE))[1], 0.0, atol=1e-12)
    assert node.diagnosis('payload').values['turn'].endswith('degrees, by /tf_static')


def test_the_live_model_selects_its_payloads_of_a_shared_folder(rig, make_model, tmp_path):
    models = [make_model(f'{side}.yaml', {'force_z': (2.0, 0.0, 600.0)}) for side in 'ab']
    path = models[0].path.with_name('payloads.json')
    for side, rotation in (('a', FRAME.rotation), ('b', np.eye(3))):
        add_payloads(path, side, [TOOL], ForceFrame(rotation, source='imu'))
    for model, roll in zip(models, ('180.0', '0.0'), strict=True):
        chosen = {**IMU, **by_hand(), 'model_file': str(model.path)}
        node = rig(parameters=chosen, directory=tmp_path / model.path.stem)
        assert f'yaw of {roll}, 0.0' in node.diagnosis('payload').values['turn']


def test_by_tf_no_turn_is_needed_and_payloads_learnt_by_an_imu_are_refused(rig, tmp_path):
    path = tmp_path / 'data/models/payloads.json'
    frames = [FRAME, replace(FRAME, source='imu'), ForceFrame(source='imu'), ForceFrame()]
    for frame in frames:
        add_payloads(path, 'day', [TOOL], frame)
    node = rig(parameters=IMU)
    # Of the package that is missing here, the node needs nothing for what is asked of it.
    node.node.external.files.source = 'tf'
    for name in ('day-1', 'day-2', 'day-3'):
        assert 'learnt by imu, and gravity.source is tf' in node.set('payload.active', name).reason
    for name, held in (('day-4', 'by an unknown source'), ('manual', 'as TF gives it')):
        assert set_all(node, by_hand(TOOL, **{'payload.active': name})).successful
        assert held in node.diagnosis('payload').values['turn']


def test_turns_that_disagree_are_a_warning_and_reset_the_other_tare(holding, tmp_path):
    node = holding(**{'payload.active': '', 'tare.duration': 0.2})
    mounted = ForceFrame(np.eye(3), source='imu')
    node.node.specific_force.mount = lambda: mounted
    ask(node, START, CONSTANT)
    assert set_all(node, by_hand(TOOL)).successful
    taken, tare = tare_at_rest(node)
    assert taken.success
    assert abs(tare[2]) > 10.0, 'the wrong turn is in it'
    path = tmp_path / 'data/models/payloads.json'
    add_payloads(path, 'node', [TOOL], replace(FRAME, source='imu', wrench_frame='tool0'))
    assert set_all(node, by_hand(TOOL)).successful
    assert not node.node.compensator.external_tare.any()
    assert tare_at_rest(node, START + 10 * SECOND)[0].success
    assert node.diagnosis('payload', '/tf_static says otherwise, by 180 degrees').level == WARN
    assert node.set('payload.active', 'node-1').successful
    assert node.node.compensator.external_tare.any(), 'the same turn needs no second tare'
    assert node.diagnosis('payload', '/tf_static says otherwise, by 180 degrees').level == OK


def test_a_frame_id_other_than_the_payload_s_is_a_warning(holding, tmp_path):
    path = tmp_path / 'data/models/payloads.json'
    add_payloads(path, 'node', [TOOL], replace(FRAME, source='imu', wrench_frame='left'))
    node = holding(**{'payload.active': 'node-1'})
    feel(node, START, UP)
    ask(node, START, CONSTANT)
    assert node.diagnosis('payload', 'left is now tool0').level == WARN


def tare_at_rest(node, start=START):
    """Tare upright under the tool; the answer, and the tare of the external wrench."""
    answers = node.ask('tare')
    for k in range(21):
        feel(node, start + k * SECOND // 100, UP)
        ask(node, start + k * SECOND // 100, TOOL.weight(UP) + CONSTANT)
    return answers.get(timeout=20.0), node.node.compensator.external_tare


def test_a_payload_by_hand_rests_where_its_turn_is_not_known_any_more(holding, tmp_path):
    path = tmp_path / 'data/models/payloads.json'
    add_payloads(path, 'node', [TOOL], replace(FRAME, source='imu', wrench_frame='left'))
    node = holding(**by_hand())
    assert node.diagnosis('payload').values['active'].startswith('manual')
    feel(node, START, UP)
    ask(node, START, CONSTANT)  # tells that the frame is tool0
    found = node.diagnosis('payload', 'the rotation from the IMU to the frame of the wrench')
    assert found.level == WARN
    assert ask(node, START, CONSTANT)[1] is None
    path.write_text('{')
    node.put(START, CONSTANT, frame='left')
    assert 'payloads.json' in node.diagnosis('payload', 'payloads.json').message
    assert not node.node.external.stopped


def test_a_tare_zeroes_both_and_outlives_a_restart(holding):
    node = holding(**{'tare.duration': 0.2})
    answer, _ = tare_at_rest(node)
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


@pytest.mark.parametrize(
    ('felt_s', 'changed', 'reason'),
    [
        (-1.0, '', 'specific force was fresh for 0 of 21 wrenches. Both tares stay'),
        (0.0, 'day-2', 'payload.active changed meanwhile'),
    ],
)
def test_a_tare_without_force_or_of_two_payloads_is_refused(holding, felt_s, changed, reason):
    node = holding(**{'tare.duration': 0.2})
    feel(node, START + round(felt_s * SECOND), UP)
    answers = node.ask('tare')
    for k in range(21):
        ask(node, START + k * SECOND // 100, CONSTANT)
        if k == 10 and changed:
            assert node.set('payload.active', changed).successful
    answer = answers.get(timeout=20.0)
    assert not answer.success
    assert reason in answer.message
    assert not node.node.compensator.external_tare.any()
    assert not node.node.compensator.tare.any()


def test_an_accelerometer_that_disagrees_with_the_learnt_one_is_a_warning(holding):
    node = holding()
    for k in range(external_wrench._DEVIATION_REPORTS):
        feel(node, START + k * SECOND, (1.05 + 1e-6 * k) * UP)
        ask(node, START + k * SECOND, CONSTANT)
        found = node.diagnosis('payload')
        assert (found.level == WARN) == (k == external_wrench._DEVIATION_REPORTS - 1)
    assert 'specific force is +5% off gravity by the accelerometer of day-1' in found.message


@pytest.mark.parametrize(
    ('later_s', 'forces', 'sentence'),
    [
        (0, [UP / 9.807] * 2, 'specific force is 1 m/s², and 9.807 at rest; check its unit'),
        (
            0, [UP] * (external_wrench._FROZEN_REPORTS + 1),
            'has not changed by a bit for seconds; is the IMU frozen?',
        ),
        (-7200, [UP], '7200 s apart: two clocks; wrench_external rests'),
    ],
)  # fmt: skip
def test_impossible_specific_force_is_a_warning(holding, later_s, forces, sentence):
    node = holding()
    for force in forces:
        feel(node, START + later_s * SECOND, force)
        ask(node, START, CONSTANT)
        found = node.diagnosis('payload')
    assert (found.level, sentence in found.message) == (WARN, True)
