"""What the wrench shows: a weight that is not as it is taken off, and a tare without it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrist_ft_comp.payload.weight_check import HiddenWeight, TareCheck, WeightCheck


@pytest.mark.parametrize(('gain', 'contact_n', 'words'), [
    (1.0, -10.0, ''), (2.0, 0.0, 'moves 2 times as much as the weight of tool'),
    (0.0, 0.0, 'hardly moves with the weight of tool; is it mounted?'),
], ids=['the same contact in each cycle', 'another payload', 'an empty gripper'])  # fmt: skip
def test_between_two_poses_contact_is_no_turn_and_another_payload_is_found(gain, contact_n, words):
    check, rng = WeightCheck('tool'), np.random.default_rng(0)
    for second in np.arange(0.3, 200, 0.97):
        share = 0.5 + 0.5 * np.clip(3 * np.sin(second / 2), -1, 1)
        turn = Rotation.from_euler('x', 70 * share, degrees=True)
        weight_n = turn.apply([0, 0, -9.8], inverse=True)
        contact = np.array([0, 0, contact_n * (share > 0.97)])
        force_n = gain * weight_n + contact + rng.normal(0, 0.02, 3)
        check.add(np.append(force_n, np.zeros(3)), np.append(weight_n, np.zeros(3)))
        assert words or not check.found, check.found
    assert words in check.found


@pytest.mark.parametrize(('weight_n', 'turn_deg', 'share', 'words'), [
    (15.0, 0, 1.03, ''), (15.0, 0, 1.1, '1.1 times'), (15.0, 0, 0.9, '0.9 times'),
    (15.0, 5, 1.0, ''), (98.0, 0, 1.02, ''), (98.0, 0, 1.06, '1.06 times'),
    (98.0, 5, 1.0, 'turned, by 5 degrees'),
])  # fmt: skip
def test_another_mass_or_turn_is_said_where_it_matters(weight_n, turn_deg, share, words):
    check, rng = WeightCheck('tool'), np.random.default_rng(0)
    turn = share * Rotation.from_euler('x', turn_deg, degrees=True).as_matrix()
    for _ in range(200):
        force_n = Rotation.random(random_state=rng).apply([0, 0, -weight_n])
        weight = np.append(force_n, np.cross([0.0, 0.0, 0.15], force_n))
        noise = rng.normal(0, 0.05, 6) * [1, 1, 1, 0.05, 0.05, 0.05]
        check.add((weight.reshape(2, 3) @ turn.T).ravel() + noise, weight)
    assert words in check.found
    assert bool(words) == bool(check.found)


@pytest.mark.parametrize(('signs', 'axis', 'is_said'), [
    ([-1, 1, 1], [0, 1, 0], True), ([-1, -1, -1], [1, 0.3, 0], True),
    ([-1, 1, 1], [1, 1, 0], True), ([1, 1, 1], [1, 1, 0], False)])  # fmt: skip
def test_a_mirrored_imu_is_said_within_a_minute_of_small_motion(signs, axis, is_said):
    check, rng = WeightCheck('tool'), np.random.default_rng(0)
    turn = np.radians(23) * np.array(axis) / np.linalg.norm(axis)  # four poses 2 N apart
    for second in np.arange(0.0, 60.0, 1.01):
        force_n = Rotation.from_rotvec(np.sin(second / 5) * turn).apply([0, 0, -9.8])
        measured_n = np.append(force_n + rng.normal(0, 0.1, 3), np.zeros(3))
        check.add(measured_n, np.append(force_n * signs, np.zeros(3)))
    assert ('specific force is mirrored, turned otherwise' in check.found) == is_said


@pytest.mark.parametrize('turned', [False, True])
def test_an_imu_that_is_turned_before_a_contact_is_said_within_a_minute(turned):
    check, rng = WeightCheck('tool'), np.random.default_rng(0)
    for second in np.arange(-60.0, 60.0, 1.01):
        angles = 0.9 * np.sin((second + 100) / 11.7), 1.2 * np.sin((second + 100) / 7.3)
        force_n = Rotation.from_euler('yx', angles).inv().apply([0, 0, 11.8])
        presses_n = 60.0 * max(0.0, np.sin((second - 2) / 15) - 0.7) * np.array([0.1, -0.2, -1.0])
        weight_n = force_n[[1, 0, 2]] * [-1, 1, 1] if turned and second > 0 else force_n
        measured_n = np.append(force_n + presses_n + rng.normal(0, 0.05, 3), np.zeros(3))
        check.add(measured_n, np.append(weight_n, np.zeros(3)))
        assert second > 0 or not check.found
    assert ('specific force is mirrored' in check.found) == turned


@pytest.mark.parametrize('poses', [2, 3, 4, 6])
def test_a_process_that_presses_in_one_of_few_poses_does_not_look_turned(poses):
    for seed in range(10):
        rng, check = np.random.default_rng(seed), WeightCheck('tool')
        weights = rng.normal(size=(poses, 3))
        weights *= 15.0 / np.linalg.norm(weights, axis=1)[:, None]
        for look in range(120):
            weight = np.append(weights[look // 3 % poses], np.zeros(3))
            pressed = np.array([0.0, 0.0, -20.0, 0.0, 0.0, 0.0]) * (look // 3 % poses == 0)
            check.add(weight + pressed + rng.normal(0, 0.05, 6), weight)
            assert check.found == ''


@pytest.mark.parametrize(
    ('leans_deg', 'found'), [(0.0, False), (15.0, True), (90.0, True), (None, True)]
)
def test_a_weight_that_turns_otherwise_than_specific_force_says(leans_deg, found):
    """The frame whose z is up leans; or TF repeats one pose."""
    rng, check, said = np.random.default_rng(0), WeightCheck('tool'), ''
    for second in np.arange(0.0, 200.0, 1.01):
        angles = 2.0 * np.sin(second / 17), 0.9 * np.sin(second / 12), 1.2 * np.sin(second / 7)
        turn = Rotation.from_euler('zyx', angles).inv()
        up = [0, 0, 1] if leans_deg is None else turn.apply([0, 0, 1])
        lean = Rotation.from_euler('x', leans_deg or 0.0, degrees=True)
        force_n = 11.8 * turn.apply(lean.apply([0, 0, 1])) + rng.normal(0, 0.05, 3)
        check.add(np.append(force_n, np.zeros(3)), np.append(11.8 * np.array(up), np.zeros(3)))
        said = said or check.found
    assert ('mirrored, turned otherwise, or stands still: is z of' in said) == found


def test_the_friction_of_a_sander_in_circles_is_no_weight():
    rng, check = np.random.default_rng(3), WeightCheck('tool')
    for second in np.arange(0.0, 600.0, 1.01):
        weight = np.array([0.0, 0.0, -19.6, 0.0, 0.0, 0.0])
        sands = np.array([16.0 * np.cos(second), 16.0 * np.sin(second), 40.0, 0.0, 0.0, 0.0])
        check.add(weight + sands * (second % 60 < 50) + rng.normal(0, 0.05, 6), weight)
        assert check.found == ''


@pytest.mark.parametrize(('leans_deg', 'tare_n'), [(0, 0.0), (15, 0.0), (45, 0.0), (0, 5.0)])
def test_a_tool_that_turns_about_one_axis_says_that_specific_force_stands_still(leans_deg, tare_n):
    rng, check = np.random.default_rng(0), WeightCheck('tool')
    weight_n = Rotation.from_euler('y', leans_deg, degrees=True).apply([0, 0, 19.6])
    for second in np.arange(0.0, 60.0, 1.01):
        turn = Rotation.from_euler('x', 90 * np.sin(second / 7), degrees=True)
        force_n = turn.apply(weight_n) + tare_n + rng.normal(0, 0.05, 3)
        check.add(np.append(force_n, np.zeros(3)), np.append(weight_n, np.zeros(3)))
    assert 'or stands still' in check.found


@pytest.mark.parametrize('every_s', [5, 60])
def test_names_that_change_do_not_put_off_that_a_weight_is_hidden(every_s):
    check, weight_n = HiddenWeight(), np.array([0.0, 0.0, -11.8])
    for second in range(100):
        if second % every_s == 0:
            check.expect(float(second), -1.0)
        assert check.look(float(second), -1.0, -weight_n, weight_n) == (second > 10)


def test_each_tare_of_a_weight_that_has_no_name_yet_is_said():
    check, weight_n = HiddenWeight(), np.array([0.0, 0.0, -11.8])
    for tared_s in (0.0, 100.0, 200.0):
        check.expect(tared_s + 5, tared_s)
        looks = [check.look(tared_s + s, tared_s, -weight_n, weight_n) for s in range(5, 60)]
        assert any(looks)


@pytest.mark.parametrize(('rest_n', 'other_n', 'every_s', 'is_said'), [
    (3.0, 8.0, 30, False), (11.8, -9.0, 8, True), (11.8, -9.0, 12, True),
], ids=['touches, and a mass a quarter off', 'parts of 9 N', 'parts at times'])  # fmt: skip
def test_neither_touches_nor_parts_hide_whether_a_weight_shows(rest_n, other_n, every_s, is_said):
    check, weight_n = HiddenWeight(), np.array([0.0, 0.0, -11.8])
    check.expect(0.0, -1.0)
    said = False
    for second in range(300):
        left_n = rest_n + other_n * (second % every_s > every_s - 5)
        said |= check.look(float(second), -1.0, np.array([0.0, 0.0, left_n]), weight_n)
    assert said == is_said


def test_a_sensor_of_forces_alone_has_no_centre_of_mass():
    rng, check = np.random.default_rng(0), WeightCheck('tool')
    for second in np.arange(0.0, 200.0, 1.01):
        angles = 0.9 * np.sin(second / 12), 1.2 * np.sin(second / 7)
        force_n = Rotation.from_euler('yx', angles).inv().apply([0, 0, 11.8])
        weight = np.append(force_n, np.cross([0.01, -0.02, 0.08], force_n))
        check.add(np.append(force_n + rng.normal(0, 0.05, 3), np.zeros(3)), weight)
    assert check.found == ''


@pytest.mark.parametrize('heavier', [0.0, 0.03])
@pytest.mark.parametrize('weight_n', [15.0, 98.0])
@pytest.mark.parametrize('tared_on', [False, True])
def test_a_heavy_tool_that_is_named_by_3_percent_too_heavy_hides_no_wrong_tare(
    weight_n, heavier, tared_on
):
    check, rng, said = TareCheck(), np.random.default_rng(0), []
    weights = weight_n * Rotation.random(40, random_state=0).apply([0, 0, 1])
    named = (1.0 + heavier) * weights
    tare = (weights[0] if tared_on else 0.0) - named[0]
    for weight, name in zip(weights, named, strict=True):
        force = weight - tare + rng.normal(0, 0.1, 3)
        said.append(check.off_n(0.0, force - name, name))
    assert any(said) == (not tared_on)
    assert said[-1] == pytest.approx(0.0 if tared_on else weight_n, rel=0.05)


@pytest.mark.parametrize('moved_n', [0.0, 5.0])
def test_a_zero_that_moved_is_said_after_ten_minutes_in_which_a_tool_may_press(moved_n):
    check, rng, said = TareCheck(), np.random.default_rng(0), []
    for k, weight in enumerate(15.0 * Rotation.random(300, random_state=0).apply([0, 0, 1])):
        off_n = (k > 50) * np.array([0.0, 0.0, moved_n]) + rng.normal(0, 0.1, 3)
        said.append(check.off_n(5.0 * k, off_n, weight))
    assert not any(said[:165])
    assert said[-1] == pytest.approx(moved_n, abs=0.3)
