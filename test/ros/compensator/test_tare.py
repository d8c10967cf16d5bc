import numpy as np
import pytest

pytest.importorskip('rclpy', reason='the node tests need ROS 2 (rclpy)')

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
OFFSET = np.array([1.0, -2.0, 3.0, 0.1, -0.2, 0.3])
executors = pytest.mark.parametrize('executor', ['default', 'events'])
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


@executors
def test_a_tare_answers_with_the_offset_and_reads_zero_after(wired, executor):
    node = wired(executor=executor)
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


def test_noise_is_averaged(rig):
    node = rig()
    noise = np.random.default_rng(1).normal(0, 0.05, (51, 6))
    assert tare(node, wrenches=OFFSET + noise).success
    found = node.ask_output(START + 3 * SECOND, OFFSET)
    np.testing.assert_allclose(found, -noise.mean(axis=0), atol=1e-12)


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
    answer = node.call('tare')
    assert not answer.success
    assert answer.message.startswith('Taring needs at least 10 wrenches; got 0.')
    assert 'Check that the sensor publishes on wrench_raw' in answer.message
    assert tare(node).success


def test_a_second_tare_is_refused_while_one_runs(rig):
    node = rig()
    first = begin(node)
    answer = node.call('tare')
    assert not answer.success
    assert answer.message == 'A tare is running; wait for its answer, then call again.'
    assert first.empty()
    node.stream(STAMPS, np.tile(OFFSET, (51, 1)))
    assert first.get(timeout=20.0).success


def test_the_duration_is_counted_in_stamps(rig):
    node = rig()
    assert node.set('tare.duration', 60).successful
    answers = begin(node)
    node.stream(STAMPS, np.tile(OFFSET, (51, 1)))
    assert answers.empty()
    node.stream([START + 60 * SECOND], [OFFSET])
    assert answers.get(timeout=20.0).success


def test_who_waits_for_a_tare_is_told_of_the_end(rig):
    node = rig()
    answers = begin(node)
    node.node.tare.end()
    answer = answers.get(timeout=20.0)
    assert not answer.success
    assert answer.message == 'The node is shutting down; the tare is unchanged.'


def test_drift_is_removed_after_a_tare_without_a_jump(rig, make_model):
    """Heat rises by 0.05 K/s; the drift, 2 N/K, lags by 20 s; the load stays."""
    model = make_model('m.yaml', {'force_z': (2.0, 0.0, 20.0)})
    node = rig(parameters={'model_file': str(model.path)})
    raws, found, heat, lagged = [], [], 20.0, 20.0
    for second in range(80):
        heat += 0.05
        lagged += (1 - np.exp(-1 / 20)) * (heat - lagged)
        raw = np.array([0, 0, 7.0 + 2.0 * (lagged - 20.0), 0, 0, 0])
        stamp = START + second * SECOND
        node.warm(stamp, heat)
        if second == 20:
            assert tare(node, stamp + STAMPS - START, np.tile(raw, (51, 1))).success
        found += node.stream([stamp + SECOND // 2, stamp + 9 * SECOND // 10], [raw] * 2).tolist()
        raws.append(raw[2])
    after = np.array(found)[42:, 2]
    assert raws[-1] - raws[20] > 5.0, 'what a tare alone would leave'
    assert np.abs(after).max() < 0.2, 'drift of two thermal cells'
    assert np.abs(np.diff(after)).max() < 0.12, 'no jump: drift of one thermal cell'
