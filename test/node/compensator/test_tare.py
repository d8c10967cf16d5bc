import time
from types import SimpleNamespace

from moments import SECOND, START
import numpy as np
import pytest

from wrist_ft_comp.drift.drift_model import Drift
from wrist_ft_comp.recordings.read import read_recording

OFFSET = np.array([1.0, -2.0, 3.0, 0.1, -0.2, 0.3])
#: A sensor that lives: a bit of it changes.
WRENCHES = np.tile(OFFSET, (51, 1))
WRENCHES[25, 0] = np.nextafter(OFFSET[0], 9.0)
#: Stamps of just over the second that a tare averages by default.
STAMPS = START + np.arange(51) * SECOND // 50


def begin(node):
    """Ask for a tare; wait until the node has begun."""
    answers = node.ask('tare')
    node.wait_until(lambda: node.node.running_s('~/tare') is not None, 'the tare')
    return answers


def tare(node, stamps=STAMPS, wrenches=WRENCHES):
    answers = begin(node)
    node.stream(stamps, wrenches)
    return node.answered(answers)


def test_a_tare_answers_with_the_offset_and_reads_zero_after(rig):
    node = rig()
    answer = tare(node)
    assert answer.success
    assert answer.message == (
        'tared: force_x 1 N, force_y -2 N, force_z 3 N, '
        'torque_x 0.1 N m, torque_y -0.2 N m, torque_z 0.3 N m'
    )
    np.testing.assert_allclose(node.ask_output(START + 3 * SECOND, OFFSET), 0.0, atol=1e-12)
    np.testing.assert_allclose(node.ask_output(START + 3 * SECOND, OFFSET + 5), 5.0)
    answer = node.call('reset_tare')
    assert (answer.success, answer.message) == (True, 'the tare is zero again')
    assert node.ask_output(START + 4 * SECOND, OFFSET) == tuple(OFFSET)


def test_a_sensor_with_three_forces_is_tared_and_recorded(rig):
    node, three = rig(), WRENCHES.copy()
    three[:, 3:] = np.nan
    path = node.call('record', True).message.split()[-1]
    for second in range(3):
        node.warm(START + second * SECOND, 20.0)
    assert tare(node, wrenches=three).success
    corrected = node.ask_output(START + 2 * SECOND, three[0] + 5.0)
    np.testing.assert_allclose(corrected, [5.0, 5.0, 5.0, np.nan, np.nan, np.nan])
    assert 'torque_x' in node.diagnosis('input', 'torque').message
    node.warm(START + 3 * SECOND, 20.0)
    assert node.call('record', False).success
    assert read_recording(path).axes_present == ('force_x', 'force_y', 'force_z')


def test_a_moving_load_is_refused_and_the_tare_stays(rig):
    node = rig()
    assert tare(node).success
    moving = OFFSET + np.linspace(0, 8, 51)[:, np.newaxis] * [0.01, 0.01, 1, 0, 0, 0]
    answer = tare(node, STAMPS + 5 * SECOND, moving)
    assert not answer.success
    assert 'force_z moved by 3.28 N while taring; at most 1 N are allowed' in answer.message
    assert answer.message.endswith('Hold the robot still and call again.')
    by_turns = WRENCHES + 4 * (np.arange(51) % 2)[:, np.newaxis]
    assert 'moved by 2' in tare(node, STAMPS + 7 * SECOND, by_turns).message
    np.testing.assert_allclose(node.ask_output(START + 9 * SECOND, OFFSET), 0.0, atol=1e-12)
    assert node.set('tare.max_deviation', 5).successful
    assert tare(node, STAMPS + 15 * SECOND, moving).success


def test_a_tare_is_of_the_mean_drift_of_its_time(rig):
    node = rig()
    stream, counts = node.node.compensator, node.node.counts
    stream.compensation_at = lambda _: Drift(np.full(6, counts.wrenches / 50000), np.zeros(6))
    tare(node)
    np.testing.assert_allclose(stream.tare, OFFSET - 0.0005, atol=5e-5)


def test_a_tare_over_a_change_of_the_model_is_refused(rig):
    node = rig()
    answers = begin(node)
    node.node.compensator.tracker.model = object()
    node.stream(STAMPS, WRENCHES)
    assert 'The model was changed, or its drift began' in node.answered(answers).message


@pytest.mark.parametrize(
    ('wrenches', 'sentence'),
    [
        (WRENCHES[:10], '10 wrenches came, of 0.18 s'),
        (0 * WRENCHES + OFFSET, 'same to the last bit (force_x 1, force_y -2,'),
    ],
    ids=['falls silent', 'frozen'],
)
def test_a_tare_needs_its_full_time_of_a_living_sensor(rig, wrenches, sentence):
    node = rig()
    assert tare(node).success
    answer = tare(node, STAMPS[: len(wrenches)] + 5 * SECOND, wrenches)
    assert (answer.success, sentence in answer.message) == (False, True), answer.message
    np.testing.assert_allclose(node.node.compensator.tare, OFFSET)
    assert tare(node, STAMPS + 10 * SECOND).success


def test_a_tare_of_a_stuck_axis_is_refused(rig):
    node = rig()
    node.node.wrench_input.sensor = SimpleNamespace(frozen=False, stuck=['force_z'])
    assert 'force_z repeats one value' in node.refusal('tare')


def test_simulated_time_may_be_slower_than_a_tare_waits(rig):
    node = rig(parameters={'tare.duration': 0.1})
    answers, stamps = begin(node), iter(list(enumerate(STAMPS))[20:])

    def goes_on():
        k, stamp = next(stamps)
        node.ask_output(int(stamp), WRENCHES[k])
        time.sleep(0.04)
        return not answers.empty()

    node.wait_until(goes_on, 'the answer')
    assert answers.get().success
