"""The wrench without the payload: when it comes, what it says, and who may change what is held."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

from geometry_msgs.msg import WrenchStamped
from moments import OK, SECOND, six_of, stamp_of, START, WARN
import numpy as np
import pytest
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Imu

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.node import specific_force
from wrist_ft_comp.node.external_wrench import ExternalWrench
from wrist_ft_comp.node.payload_choice import PayloadChoice
from wrist_ft_comp.node.raw_wrench import Counts
from wrist_ft_comp.node.specific_force import SpecificForceInput
from wrist_ft_comp.payload.motion_collector import MotionCollector
from wrist_ft_comp.payload.weight import ForceFrame, FrameIds, Payload
from wrist_ft_comp.ros.topics import wrench_message
from wrist_ft_comp.stored.payload_file import add_payloads
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.wire.cdr import locate, WRENCH_DOUBLES

TOOL = Payload(1.5, np.array([0.01, -0.02, 0.06]))
PART = Payload(2.5, np.array([0.02, 0.01, 0.1]))
#: The IMU stands on its head beside the sensor.
FRAME = ForceFrame(np.diag([1.0, -1.0, -1.0]))
MOUNTED = replace(FRAME, source='imu', wrench_frame='tool0')
UP, ASIDE, SIDEWAYS = 9.807 * np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
CONSTANT = np.array([3.0, -4.0, 5.0, 0.1, -0.2, 0.3])
IMU = {'gravity.source': 'imu'}
BY_HAND = {
    'payload.active': 'manual', 'payload.mass': PART.mass_kg,
    'payload.center_of_mass': tuple(PART.center_m.tolist()),
}  # fmt: skip


class Held:
    """The part beside a fake hub: what it is told by wrenches and an IMU, what it publishes."""

    def __init__(self, make_hub, folder, source='imu', live=None, model_file='', **chosen):
        self.chosen = {'gravity.source': source, 'gravity.frame': 'up', 'gravity.timeout': 0.2,
                       'model_file': model_file}  # fmt: skip
        self.counts = Counts(payload=chosen.pop('before', ''))
        here = chosen.pop('here', None)
        stream, store = Compensator(1), SimpleNamespace(directory=folder, locate=Path)
        self.force = SpecificForceInput(self.chosen, stream)
        self.part = ExternalWrench(
            compensator=stream,
            choice=PayloadChoice(SimpleNamespace(stored=live, store=store), self.force),
            specific_force=self.force,
            counts=self.counts,
        )
        self.hub = self.force.hub = make_hub(self.part, **self.chosen, **chosen)
        self.force.frames = lambda: here or FrameIds('imu', self.hub.frame)
        self.force.poll = lambda: None
        self.part.start()

    def feel(self, stamp, force):
        """Tell a specific force in the wrench's frame, as the IMU has it."""
        measured = tuple((FRAME.rotation.T @ force).tolist())
        self.force.on_specific_force(stamp, measured, None)

    def ask(self, stamp, wrench):
        """Send a wrench; return what comes on wrench_external, or None."""
        data = serialize_message(wrench_message(stamp, 'tool0', wrench))
        layout = locate(data, WRENCH_DOUBLES)
        _, raw = layout.decode(data)
        self.counts.newest = stamp, raw, data
        if self.hub.listening:
            self.part.on_wrench(stamp, raw, data, layout)
        sent = self.hub.topics['wrench_external']
        return np.array(six_of(deserialize_message(sent.pop(), WrenchStamped))) if sent else None

    def weighs(self, payload, force=ASIDE):
        """Tell whether the weight of a payload is what is subtracted."""
        self.feel(START, force)
        external = self.ask(START, payload.weight(force))
        return external is not None and np.abs(external).max() < 1e-12

    def status(self):
        (found,) = self.part.statuses()
        return found

    def see(self, second, force, wrench):
        """Feel a specific force and a wrench, some seconds after the start; give the status."""
        self.feel(START + second * SECOND, force)
        self.ask(START + second * SECOND, wrench)
        return self.status()


@pytest.fixture
def held(ros_domain, fake_hub, tmp_path):  # noqa: ARG001 -- which silences the first import
    """Make the part with two payloads that were learnt, or with what stands in the file."""

    def make(*entries, **chosen):
        path = tmp_path / 'models/payloads.json'
        for name, frame in entries or [('day', FRAME)]:
            add_payloads(path, name, [TOOL, PART], frame)
        return Held(fake_hub, tmp_path, **chosen)

    return make


@pytest.fixture
def holding(rig, tmp_path):
    add_payloads(tmp_path / 'data/models/payloads.json', 'day', [TOOL, PART], FRAME)
    return lambda **more: rig(parameters={**IMU, 'payload.active': 'day-1', **more})


def test_the_external_wrench_has_the_header_of_the_wrench_over_dds(wired, messages, tmp_path):
    add_payloads(tmp_path / 'data/models/payloads.json', 'day', [TOOL], FRAME)
    node = wired(parameters={**IMU, 'payload.active': 'day-1'})
    external = node.bench.listen(WrenchStamped, node.topic('wrench_external'), QoSProfile(depth=9))
    imu = node.bench.publisher(Imu, node.topic('imu'))
    imu.publish(messages.imu(START, (FRAME.rotation.T @ ASIDE).tolist(), [0.0, 0.1, 0.0]))
    forces = node.node.specific_force.forces
    node.wait_until(lambda: forces.count == 1, 'the specific force')
    node.wait_until(node.node.external.output.get_subscription_count, 'the listener')
    raw = TOOL.weight(ASIDE) + CONSTANT
    assert node.ask_output(START + SECOND // 10, raw) == tuple(raw)
    message = external.get(timeout=20.0)
    assert stamp_of(message) == START + SECOND // 10
    assert message.header.frame_id == 'tool0'
    np.testing.assert_allclose(six_of(message), CONSTANT, atol=1e-12)
    assert node.node.specific_force.speed == pytest.approx(0.1)


def test_only_with_a_payload_and_fresh_specific_force_it_comes(held):
    part = held()
    assert (part.status().level, part.status().message) == (OK, 'no payload is active')
    part.feel(START, UP)
    assert part.ask(START, CONSTANT) is None
    part.hub.set(part.part, **{'payload.active': 'day-1'})
    for late, comes in ((0, True), (SECOND // 5, True), (SECOND // 5 + 1, False)):
        assert (part.ask(START + late, CONSTANT) is not None) == comes
    part.feel(START + SECOND, ASIDE)
    part.hub.values['uncalibrated'] = 'silent'
    assert part.ask(START + SECOND, CONSTANT) is None
    part.hub.values['uncalibrated'] = 'passthrough'
    external = part.ask(START + SECOND, TOOL.weight(ASIDE) + CONSTANT)
    np.testing.assert_allclose(external, CONSTANT, atol=1e-12)
    assert part.status().values['active'] == 'day-1, 1.5000 kg at (0.0100, -0.0200, 0.0600) m'


@pytest.mark.parametrize('named', ['day-1', ''])
def test_another_payload_than_before_a_restart_is_said_until_one_is_set(
    held, fake_hub, tmp_path, named
):
    part = held(**{'payload.active': 'day-1'})
    part.hub.set(part.part, **{'payload.active': 'day-2'})
    before = part.counts.payload
    part = Held(fake_hub, tmp_path, before=before, **{'payload.active': named})
    status = part.see(0, UP, CONSTANT)
    assert (status.level, part.counts.payload) == (WARN, before)
    assert status.message.startswith(f'before the restart payload.active was {before}, set while')
    part.hub.set(part.part, **{'payload.mass': 1.0})
    assert part.status().level == WARN
    part.hub.set(part.part, **{'payload.active': 'day-2'})
    assert part.status().level == OK


def test_an_imu_is_asked_when_its_newest_sample_is_behind_the_wrench(held):
    part, asked = held(**{'payload.active': 'day-1'}), []
    part.force.poll = lambda: asked.append(True)
    part.ask(START, CONSTANT)
    part.feel(START, UP)
    for late_ns, times in ((-SECOND // 100, 1), (0, 1), (2_000_000, 1), (2_000_001, 2)):
        part.ask(START + late_ns, CONSTANT)
        assert len(asked) == times


def test_one_wrench_of_many_without_specific_force_is_no_warning(held):
    part = held(**{'payload.active': 'day-1'})
    part.feel(START, UP)
    for late_s in (0.3, *[0.0] * 20):
        part.ask(START + round(late_s * SECOND), CONSTANT)
    assert part.status().level == OK


#: State of the part: what it felt (seconds after the start, and what), at which wrench it was
#: asked, and what the status says then, after as many reports.
STATUSES = [
    ([], 0.0, WARN, 'the publisher of /imu sends nothing; is the sensor running?; wrench_ext'),
    ([(0, UP)], 0.0, OK, 'subtracting day-1'),
    ([(0, UP)], 0.3, WARN, 'specific force is older than gravity.timeout, or stays away'),
    ([(-3, UP)], 0.0, WARN, '3 s apart: two clocks; wrench_external rests'),
    ([(0, UP / 9.807)] * specific_force._REPORTS, 0.0, WARN, 'is -90% off gravity'),
    ([(0, UP)] * specific_force._REPORTS, 0.0, WARN, 'is the IMU frozen?'),
    ([(0, (1.05 + 1e-6 * k) * UP) for k in range(specific_force._REPORTS - 1)], 0.0, OK,
     'subtracting day-1'),
    ([(0, UP), *((1, (1 + 1e-6 * k) * UP) for k in range(specific_force._REPORTS))], 0.0, WARN,
     'specific force is stamped 1.0 s ahead of the wrench'),
    ([(1, (1 + 1e-6 * k) * UP) for k in range(specific_force._REPORTS)], 0.9, OK,
     'subtracting day-1'),
    ([(0, (1.05 + 1e-6 * k) * UP) for k in range(specific_force._REPORTS)], 0.0, WARN,
     'specific force is +5% off gravity, and so is the weight'),
]  # fmt: skip


@pytest.mark.parametrize(
    ('tool', 'every_s', 'wrenches', 'said'),
    [(('imu', 1.5), 0.04, 3, ''), (('imu', 1.5), 0.15, 1, ''),
     (('imu', 1.5), 0.15, 3, 'every 0.15 s, so that 1.1 N of the weight'),
     (('imu', 5.0), 0.05, 3, ''), (('tf', 3.0), 0.05, 3, ''),
     (('tf', 5.0), 0.05, 3, 'every 0.05 s, so that 1.2 N of the weight')],
    ids=['often', 'as often', 'seldom', 'may be noise', 'a light tool', '20 Hz, a heavy tool'],
)  # fmt: skip
def test_specific_force_that_comes_seldom_in_motion_is_said(held, tool, every_s, wrenches, said):
    part = held(**{'payload.active': 'day-1'})
    live = part.part.payload
    part.part.specific_force.source, mass_kg = tool
    live.payload = replace(live.payload, mass_kg=mass_kg)
    for at_s in np.arange(0, 1, every_s):
        part.feel(START + round(at_s * 1e9), Rotation.from_euler('x', at_s).apply(UP))
        for k in range(wrenches):
            part.ask(START + round((at_s + k * every_s / wrenches) * 1e9), CONSTANT)
    message = part.status().message
    assert said in message
    assert said or 'comes every' not in message


def angles(second):
    return 2.0 * np.sin(second), 0.9 * np.sin(0.7 * second), 1.2 * np.sin(0.6 * second)


@pytest.mark.parametrize(('late_s', 'pressed_n', 'rubs', 'words'), [
    (0.02, 0.0, 0.0, ''), (-0.02, 0.0, 0.0, ''), (0.0, 30.0, 0.3, ''),
    (0.1, 0.0, 0.0, 's before the weight that is taken off'),
    (-0.1, 0.0, 0.0, 's behind the weight that is taken off'),
], ids=['in time', 'in time, too', 'a tool that polishes', 'IMU late', 'wrench late'])  # fmt: skip
def test_a_force_that_is_late_in_motion_is_said(held, late_s, pressed_n, rubs, words):
    part, rng = held(**{'payload.active': 'day-1'}), np.random.default_rng(0)
    part.part.compensator.set_tare(CONSTANT, START, np.zeros(6))
    for second in np.arange(0.0, 60.0, 1.01):
        for back_s in (0.2, 0.1, 0.0):
            at_s = second - back_s
            felt = Rotation.from_euler('zyx', angles(at_s - late_s)).inv().apply(UP)
            part.feel(START + round(at_s * 1e9), tuple(felt))
        force, soon = (
            Rotation.from_euler('zyx', angles(second + step_s)).inv().apply(UP)
            for step_s in (0.0, 0.1)
        )
        pressed = np.array([0.0, 0.0, -pressed_n]) - rubs * pressed_n * (soon - force)
        load = np.append(pressed + rng.normal(0, 0.1, 3), np.zeros(3))
        part.ask(START + round(second * 1e9), TOOL.weight(force) + CONSTANT + load)
        said = part.status().message
    assert words in said
    assert ('in motion the force is' in said) == bool(words), said


@pytest.mark.parametrize(('felt', 'asked_s', 'level', 'words'), STATUSES)
def test_the_status_judges_specific_force(held, felt, asked_s, level, words):
    part = held(**{'payload.active': 'day-1'})
    for second, force in felt or [(0, None)]:
        if force is not None:
            part.feel(START + second * SECOND, force)
        part.ask(START + round(asked_s * SECOND), CONSTANT)
        found = part.status()
    assert (found.level, words in found.message) == (level, True), found.message


def test_a_payload_changes_with_the_next_wrench_and_refusals_change_nothing(held):
    part = held(**{'payload.active': 'day-1'})
    for name, payload in (('day-2', PART), ('day-1', TOOL)):
        part.hub.set(part.part, **{'payload.active': name})
        assert part.weighs(payload)
    for wrong, words in (
        ({'payload.active': 'day-3'}, r'learnt \(day-1, day-2\); got day-3'),
        ({**BY_HAND, 'payload.center_of_mass': (1.0,)}, 'three numbers in m'),
        ({**BY_HAND, 'payload.mass': 0.0}, 'payload.mass is 0'),
        (BY_HAND, 'the rotation from the IMU to the frame of the wrench is not known'),
    ):
        with pytest.raises(SettingsError, match=words):
            part.hub.set(part.part, **wrong)
        assert part.weighs(TOOL)
    part.hub.set(part.part, **{'payload.active': ''})
    assert part.ask(START, CONSTANT) is None


@pytest.mark.parametrize(
    'other', [{'wrench_frame': 'left'}, {'force_frame': 'x'}, {'source': 'tf'}, {'source': ''}]
)
def test_a_payload_by_hand_turns_as_this_sensor_learnt(held, other):
    part = held(('day', MOUNTED))
    part.hub.set(part.part, **BY_HAND)
    assert part.weighs(PART)
    assert part.status().values['turn'].endswith('learnt with day-2')
    part = held(('other', replace(MOUNTED, **other)), ('day', FRAME))
    part.force.frames = lambda: FrameIds('imu', 'right')
    with pytest.raises(SettingsError, match='no frame_id in common'):
        part.hub.set(part.part, **BY_HAND)
    part.force.frames = lambda: FrameIds('right', 'right')
    part.hub.set(part.part, **BY_HAND)
    assert 'because both frame_ids are right' in part.status().values['turn']
    part.force.frames = lambda: FrameIds('right', 'left')
    part.feel(START, UP)
    assert 'right is now left; is it another sensor?' in part.status().message


def test_a_launch_file_may_name_a_payload_by_hand_before_frame_ids_are_known(held):
    part = held(here=FrameIds('', ''), **BY_HAND)
    assert 'no frame_id in common' not in part.status().message, 'nothing could identify it yet'
    part.feel(START, UP)
    part.ask(START, CONSTANT)
    assert 'no frame_id in common (none and none)' in part.status().message
    for imu, words in (('tool0', 'subtracting manual'), ('imu', 'in common (imu and tool0)')):
        part.force.frames = lambda imu=imu: FrameIds(imu, 'tool0')
        part.ask(START, CONSTANT)
        assert words in part.status().message


def test_the_live_model_selects_its_payloads_of_a_shared_folder(held, tmp_path):
    turns = (('a', FRAME.rotation), ('b', np.eye(3)))
    shared = tmp_path / 'shared/payloads.json'
    for side, rotation in turns:
        add_payloads(shared, side, [TOOL], ForceFrame(rotation, source='imu'))
    for (side, _), roll in zip(turns, ('180.0', '0.0'), strict=True):
        live = SimpleNamespace(path=shared.with_name(f'{side}.yaml'))
        assert f'yaw of {roll}, 0.0' in held(live=live, **BY_HAND).status().values['turn']


def test_the_payloads_of_model_file_stay_when_another_model_is_live(held, tmp_path):
    given = tmp_path / 'given/tool.yaml'
    add_payloads(given.with_name('payloads.json'), 'tool', [TOOL], MOUNTED)
    live = SimpleNamespace(path=tmp_path / 'models/later.yaml')
    for name in ('tool-1', 'manual'):
        chosen = {**BY_HAND, 'payload.active': name, 'model_file': str(given)}
        assert 'yaw of 180.0' in held(live=live, **chosen).status().values['turn']


def test_what_shows_a_wrong_weight_outlives_grips(held):
    """Between two grips there are too few poses to find that the IMU is turned."""
    part = held(**{'payload.active': 'day-1'})
    for k, force in enumerate([UP, ASIDE, SIDEWAYS, -UP, -ASIDE, -SIDEWAYS] * 12):
        name, payload = (('day-1', TOOL), ('day-2', PART))[k // 6 % 2]
        part.hub.set(part.part, **{'payload.active': name})
        turned = np.array([force[1], force[0], -force[2]])
        found = part.see(k, force, payload.weight(turned))
    assert 'is mirrored or turned, by 180 degrees' in found.message


def test_by_tf_no_turn_is_needed_and_payloads_learnt_by_an_imu_are_refused(held):
    frames = [FRAME, replace(FRAME, source='imu'), ForceFrame(source='imu'), ForceFrame()]
    part = held(*(('day', frame) for frame in frames), source='tf')
    for name in ('day-1', 'day-3', 'day-5'):
        with pytest.raises(SettingsError, match=r'learnt by imu, and gravity\.source is tf'):
            part.hub.set(part.part, **{'payload.active': name})
    for name, turn in (('day-7', 'by an unknown source'), ('manual', 'as TF gives it')):
        part.hub.set(part.part, **{**BY_HAND, 'payload.active': name})
        assert turn in part.status().values['turn']


def test_a_payload_of_another_turn_resets_the_other_tare(held, tmp_path):
    part = held(('day', ForceFrame(np.eye(3), source='imu', wrench_frame='tool0')))
    part.hub.set(part.part, **BY_HAND)
    compensator = part.part.compensator
    compensator.restore_tare(CONSTANT, CONSTANT, tared=True)
    add_payloads(tmp_path / 'models/payloads.json', 'node', [TOOL], MOUNTED)
    part.hub.set(part.part, **BY_HAND)
    assert not compensator.external_tare.any()
    assert compensator.tare.any()
    assert 'by 180 degrees, and the tare of wrench_external is zero' in compensator.zero_doubts[0]
    compensator.restore_tare(CONSTANT, CONSTANT, tared=True)
    part.hub.set(part.part, **{'payload.active': 'node-1'})
    assert compensator.external_tare.any(), 'the same turn needs no second tare'
    part.feel(START, UP)
    part.hub.frame = 'left'
    assert 'tool0 is now left; is it another sensor?' in part.status().message


@pytest.mark.parametrize(
    ('felt_turn', 'shift_m', 'contact_n', 'words'),
    [
        (np.eye(3), 0.0, 0.0, ''),
        (np.eye(3), 0.0, -60.0, ''),
        (np.diag([-1.0, 1.0, 1.0]), 0.0, 0.0, 'specific force is mirrored or turned'),
        (Rotation.from_rotvec([0.157, 0, 0]).as_matrix(), 0.0, 0.0, 'turned, by 9 degrees'),
        (np.eye(3) / 1.16, 0.0, 0.0, 'moves 1.16 times as much as the weight of day-1: its unit'),
        (np.eye(3), 0.012, 0.0, 'as if the centre of mass were 12 mm from that of day-1'),
    ],
    ids=['right', 'presses', 'mirrored', 'tilted', 'heavier', 'other TCP'],
)
def test_a_wrench_unlike_the_weight_is_a_warning(held, felt_turn, shift_m, contact_n, words):
    part, rng = held(**{'payload.active': 'day-1'}), np.random.default_rng(0)
    mounted = replace(TOOL, center_m=TOOL.center_m + shift_m * np.eye(3)[0])
    for k in range(100):
        up = Rotation.from_euler('xy', [np.sin(k / 4), np.sin(k / 5)]).as_matrix().T @ UP
        contact = np.array([0, 0, contact_n * (up[2] > 9.0), 0, 0, 0])
        noise = rng.normal(0, 0.05, 6) * [1, 1, 1, 0.1, 0.1, 0.1]
        found = part.see(k, felt_turn @ up, mounted.weight(up) + contact + noise)
    expected = words or 'subtracting day-1'
    assert (found.level, expected in found.message) == (WARN if words else OK, True), found.message


@pytest.mark.parametrize(
    ('mass_kg', 'noise_n', 'torques'),
    [(0.08, 0.01, 1), (0.15, 0.05, 1), (1.5, 0.05, 1), (1.5, 0.05, 0), (1.5, 0.05, np.nan)],
)
def test_a_turned_imu_is_no_longer_said_when_it_is_mended(held, mass_kg, noise_n, torques):
    payload, rng = Payload(mass_kg, np.array([0.0, 0.0, 0.05])), np.random.default_rng(0)
    manual = {**BY_HAND, 'payload.mass': mass_kg, 'payload.center_of_mass': (0.0, 0.0, 0.05)}
    part, levels = held(('day', MOUNTED), **{**manual, 'payload.active': 'manual'}), []
    for k, up in enumerate(Rotation.random(200, random_state=1).apply(UP)):
        wrench = payload.weight(up) + rng.normal(0, noise_n, 6) * [1, 1, 1, 0.02, 0.02, 0.02]
        wrench[3:] *= torques
        levels.append(part.see(k, up * [1, 1, -1 if k < 100 else 1], wrench).level)
    assert (levels[99], levels[199]) == (WARN, OK)


def tare_at_rest(node):
    """Tare upright under the tool; the answer."""
    answers = node.ask('tare')
    for k in range(21):
        stamp = START + k * SECOND // 100
        measured = tuple((FRAME.rotation.T @ UP).tolist())
        node.node.broadcast('on_specific_force', stamp, measured, None)
        node.ask_output(stamp, TOOL.weight(UP) + CONSTANT + 1e-13 * (-1) ** k)
    return node.answered(answers)


def test_a_tare_zeroes_both_and_outlives_a_restart(holding):
    node = holding(**{'tare.duration': 0.2})
    node.node.external.check.found = 'it is turned'
    assert node.diagnosis('payload').message.endswith('it is turned')
    assert 'cannot be tared: it is turned; when' in tare_at_rest(node).message
    node.node.external.check.found = ''
    assert 'turned' not in node.diagnosis('payload').message
    answer = tare_at_rest(node)
    assert answer.message.endswith('; wrench_external is tared, too')
    shown = node.diagnosis('payload').values
    assert (shown['force_y_tare'], shown['torque_z_tare']) == ('-4 N', '0.3 N m')
    node.node.state_keeper.end()
    again = holding()
    np.testing.assert_allclose(again.node.compensator.external_tare, CONSTANT, atol=1e-12)
    np.testing.assert_allclose(again.node.compensator.tare, TOOL.weight(UP) + CONSTANT, atol=1e-12)
    assert again.call('reset_tare').success
    assert not again.node.compensator.external_tare.any()


@pytest.mark.parametrize(('on', 'name'), [(True, ''), (False, ''), (True, 'day-1')])
def test_a_tool_that_was_on_at_a_tare_without_its_name_is_a_warning(held, monkeypatch, on, name):
    monkeypatch.setattr('wrist_ft_comp.payload.weight_check._SHOWN_S', -1.0)
    part, weight = held(**{'payload.active': name}), TOOL.weight(UP)
    part.part.compensator.set_tare(on * weight + CONSTANT, START, weight if name else None)
    for active in ('', 'day-1'):
        part.hub.set(part.part, **{'payload.active': active})
    part.feel(START, UP)
    # A pull of three quarters of the weight proves no tare.
    pulls = ((1.0, not name), (-0.75, not (on or name)), (1.0, not name), (0.0, on and not name))
    for press, hides in pulls:
        part.ask(START, weight + CONSTANT - press * weight)
        assert ('the weight of day-1 does not show' in part.status().message) == hides, press


@pytest.mark.parametrize('share', [-1.0, 0.0])
def test_a_weight_that_does_not_show_because_it_goes_the_wrong_way_is_said_so(
    held, monkeypatch, share
):
    monkeypatch.setattr('wrist_ft_comp.payload.weight_check._SHOWN_S', -1.0)
    part = held()
    part.part.compensator.set_tare(CONSTANT, START)
    part.hub.set(part.part, **{'payload.active': 'day-1'})
    message = part.see(0, UP, CONSTANT + share * TOOL.weight(UP)).message
    assert 'the weight of day-1 does not show' in message
    assert message.count('is against its weight') == (share < 0)


@pytest.mark.parametrize('speed', [0.5, 0.1])
def test_by_tf_a_swing_teaches_nothing_of_the_payload(held, speed):
    """At an arm, the acceleration of a swing makes a payload look heavier."""
    part = held(('day', ForceFrame()), source='tf', **BY_HAND)
    collector = MotionCollector()
    part.part.collect(collector)
    for k, force in enumerate([UP, ASIDE, SIDEWAYS, -UP, -ASIDE, -SIDEWAYS] * 4):
        at = START + 2 * k * SECOND
        part.force.on_specific_force(at, tuple(force), speed)
        part.ask(at, 1.2 * PART.weight(force))
        found = part.status()
    assert ('1.2 times as much as the weight of manual' in found.message) == (speed < 0.2)
    assert np.isnan(np.array(collector.cells)[:, 6:9]).all() == (speed > 0.2)


@pytest.mark.parametrize('tared', [False, True])
def test_a_tare_with_a_weight_that_did_not_fit_is_doubted_when_the_payload_is_mended(held, tared):
    part = held(('day', MOUNTED), **{**BY_HAND, 'payload.mass': 0.7 * PART.mass_kg})
    compensator = part.part.compensator
    if tared:
        compensator.set_tare(PART.weight(UP), START, 0.7 * PART.weight(UP))
    for k, force in enumerate([UP, ASIDE, SIDEWAYS, -UP, -ASIDE, -SIDEWAYS] * 4):
        found = part.see(k, force, PART.weight(force))
    assert 'times as much as the weight of manual' in found.message
    part.hub.set(part.part, **BY_HAND)
    doubts = ['that did not fit; when' in why for why in compensator.zero_doubts]
    assert doubts == [True] * tared


@pytest.mark.parametrize(
    ('tared_with', 'pressed_n', 'doubted'),
    [(PART, 0.0, False), (PART, 20.0, False), (None, 0.0, True), (TOOL, 0.0, True)],
    ids=['the part', 'the part, which is pressed later', 'nothing', 'another tool'],
)
def test_a_tare_with_another_load_than_was_named_is_said(held, tared_with, pressed_n, doubted):
    part = held(('day', MOUNTED), **BY_HAND)
    named, on = PART.weight(UP), np.zeros(6) if tared_with is None else tared_with.weight(UP)
    part.part.compensator.set_tare(on, START, named)
    for k, turn in enumerate(Rotation.random(30, random_state=0)):
        force = turn.apply(UP)
        pressed = np.array([0.0, 0.0, -pressed_n, 0.0, 0.0, 0.0]) * (k >= 5)
        said = part.see(k, force, PART.weight(force) + pressed).message
    off_n = np.linalg.norm((on - named)[:3])
    words = f'wrench_external rests at {off_n:.2g} N in all directions'
    assert (words in said) == doubted, said
    part.part.note_tare()
    assert 'in all directions' not in part.status().message, 'a new tare was not believed'


@pytest.mark.parametrize(
    ('felt_s', 'changed', 'reason'),
    [
        (-1.0, '', 'specific force was fresh for 0 of 21 wrenches. Both tares stay'),
        (0.0, 'day-2', 'payload.active changed meanwhile'),
    ],
)
def test_a_tare_without_force_or_of_two_payloads_is_refused(holding, felt_s, changed, reason):
    node = holding(**{'tare.duration': 0.2})
    at_ns = START + round(felt_s * SECOND)
    node.node.broadcast('on_specific_force', at_ns, (0.0, 0.0, -9.807), None)
    answers = node.ask('tare')
    for k in range(21):
        node.ask_output(START + k * SECOND // 100, CONSTANT + 1e-13 * k)
        if k == 10 and changed:
            assert node.set('payload.active', changed).successful
    answer = node.answered(answers)
    assert (answer.success, reason in answer.message) == (False, True), answer.message
    assert not node.node.compensator.tared


UPSIDE_DOWN = pytest.mark.parametrize(('z', 'words'), [(-1, 'mirrored'), (1, 'subtracting')])


@UPSIDE_DOWN
def test_by_tf_a_weight_upside_down_is_said_of_a_robot_that_never_rests(held, z, words):
    part = held(source='tf', **BY_HAND)
    for k, up in enumerate(Rotation.random(60, random_state=3).apply(UP)):
        stamp = START + k * SECOND
        part.force.on_specific_force(stamp, tuple((z * up).tolist()), 1.0)
        part.ask(stamp, PART.weight(up))
        found = part.status()
    assert words in found.message


@pytest.mark.parametrize('tared_with', [TOOL, None], ids=['the tool', 'nothing'])
@UPSIDE_DOWN
def test_a_weight_upside_down_is_said_where_the_tool_always_points_down(
    held, z, words, tared_with
):
    part = held(('day', MOUNTED))
    down = -UP
    part.part.compensator.set_tare(
        CONSTANT + (tared_with.weight(down) if tared_with else 0.0), START,
        None if tared_with is None else tared_with.weight(z * down),
    )  # fmt: skip
    part.part.note_tare()
    for k in range(60):
        named, mounted = (('day-1', TOOL), ('day-2', PART))[k // 4 % 2]
        part.hub.set(part.part, **{'payload.active': named})
        felt = down + np.array([0.01 * (k % 2), 0.0, 0.0])
        found = part.see(k, z * felt, mounted.weight(felt) + CONSTANT)
    assert words.replace('mirrored', 'is against its weight') in found.message


@pytest.mark.parametrize(('before', 'is_said'), [
    ({'payload.mass': 1.5}, False), ({'payload.mass': 1.0}, True),
    ({'payload.active': 'day-1'}, False), ({'payload.active': ''}, False),
], ids=['the same', 'corrected', 'another tool', 'none'])  # fmt: skip
def test_a_weight_that_is_put_right_over_a_restart_doubts_the_tare(holding, rig, before, is_said):
    by_hand = {**IMU, **BY_HAND, 'payload.mass': 1.5, 'tare.duration': 0.2}
    node = holding(**{**by_hand, **before})
    assert tare_at_rest(node).success
    node.node.state_keeper.end()
    said = rig(parameters=by_hand).diagnosis('output').message
    assert ('the tare of wrench_external was taken with manual' in said) == is_said
