import numpy as np

from wrist_ft_comp.recordings.read import read_recording

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
OFFSET = np.array([1.0, -2.0, 3.0, 0.1, -0.2, 0.3])
#: Stamps of just over the second that a tare averages by default.
STAMPS = START + np.arange(51) * SECOND // 50


def begin(node):
    """Ask for a tare; wait until the node has begun."""
    answers = node.ask('tare')
    node.wait_until(lambda: node.node.tare._running is not None, 'the tare')
    return answers


def tare(node, stamps=STAMPS, wrenches=None):
    answers = begin(node)
    node.stream(stamps, np.tile(OFFSET, (len(stamps), 1)) if wrenches is None else wrenches)
    return answers.get(timeout=20.0)


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
    node, three = rig(), OFFSET.copy()
    three[3:] = np.nan
    path = node.call('record', True).message.split()[-1]
    for second in range(3):
        node.warm(START + second * SECOND, 20.0)
    assert tare(node, wrenches=np.tile(three, (51, 1))).success
    corrected = node.ask_output(START + 2 * SECOND, three + 5.0)
    np.testing.assert_allclose(corrected, [5.0, 5.0, 5.0, np.nan, np.nan, np.nan])
    assert 'torque_x' in node.diagnosis('input', 'torque').message
    node.warm(START + 3 * SECOND, 20.0)
    assert node.call('record', False).success
    assert read_recording(path).axes_present == ('force_x', 'force_y', 'force_z')


def test_a_moving_load_is_refused_and_the_tare_stays(rig):
    node = rig()
    assert tare(node).success
    moving = OFFSET + np.linspace(0, 8, 51)[:, np.newaxis] * [0, 0, 1, 0, 0, 0]
    answer = tare(node, STAMPS + 5 * SECOND, moving)
    assert not answer.success
    assert 'force_z moved by 3.28 N while taring; at most 1 N are allowed' in answer.message
    assert answer.message.endswith('Hold the robot still and call again.')
    np.testing.assert_allclose(node.ask_output(START + 9 * SECOND, OFFSET), 0.0, atol=1e-12)
    assert node.set('tare.max_deviation', 5).successful
    assert tare(node, STAMPS + 15 * SECOND, moving).success


def test_a_tare_without_wrenches_is_answered(rig):
    node = rig(parameters={'tare.duration': 0.01})
    sentence = node.refusal('tare')
    assert sentence.startswith('Taring needs at least 10 wrenches; got 0.')
    assert 'Check that the sensor publishes on wrench_raw' in sentence
    assert tare(node).success


def test_a_caller_that_waits_for_a_tare_is_answered_at_the_end(rig):
    node = rig()
    answers = begin(node)
    node.node.tare.end()
    answer = answers.get(timeout=20.0)
    assert not answer.success
    assert answer.message == 'The node is shutting down; the tare is unchanged.'
