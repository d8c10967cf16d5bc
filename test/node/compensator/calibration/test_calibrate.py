from contextlib import suppress
import queue
from time import monotonic

import numpy as np
import pytest

from wrist_ft_comp.signals import AXES
from wrist_ft_comp.stored.model_file import load_model

WARM = range(300)
AFTER = range(300, 520)
#: A fit that takes no time.
QUICK = {'thermal_period': 10.0, 'calibration.method': 'pls'}
#: A calibration may take this long on a busy machine.
FIT_TIMEOUT_S = 60.0
#: From one wrench to the next, which leaves the processor to the fit.
PAUSE_S = 0.02


def calibrate_while_streaming(node, robot):
    """Call calibrate; send a constant wrench until it answers, and some more."""
    answers = node.ask('calibrate')
    stamp, raw = robot.stamps(WARM[-1])[1] + 1, robot.raw(WARM[-1])
    before = node.node.counts.published
    answer, outputs, ends = None, [], monotonic() + FIT_TIMEOUT_S
    while answer is None and monotonic() < ends:
        outputs.append(node.stream([stamp], [raw])[0])
        stamp += 1000
        with suppress(queue.Empty):
            answer = answers.get(timeout=PAUSE_S)
    outputs += list(node.stream([stamp, stamp + 1000], [raw] * 2))
    assert node.node.counts.published - before == len(outputs)
    return answer, np.array(outputs), raw


def test_a_warm_up_is_recorded_learnt_and_removed(wired, make_robot):
    robot = make_robot(thermometers=2)
    node = wired(thermometers=2, parameters={'thermal_period': 10.0})
    assert node.call('record', True).success
    robot.run(node, WARM)
    assert '(2990 s)' in node.call('record', False).message

    answer, outputs, raw = calibrate_while_streaming(node, robot)
    assert answer.success, answer.message
    lines = answer.message.splitlines()
    for axis, line in zip(AXES, lines, strict=False):
        assert line.startswith(f'{axis}: ')
        assert ' RMS held out (zero; ' in line
    assert 'learnt from 0.83 h at 20.' in answer.message
    assert len(outputs) > 5
    np.testing.assert_allclose(outputs, np.tile(raw, (len(outputs), 1)), atol=1e-9)

    stored = load_model(next((node.directory / 'models').glob('*.yaml')))
    assert lines[-2] == f'saved as {stored.path}'
    report = stored.path.with_suffix('.html')
    assert lines[-1] == f'report: {report}'
    assert 'Is it good?' in report.read_text(encoding='utf-8')
    assert set(stored.model.axes) == set(AXES)
    assert stored.model.thermometers == 2
    assert node.node.live.stored.sha256 == stored.sha256

    after = robot.run(node, AFTER)
    drift = np.ptp(robot.zero[300:], axis=0)
    remaining = np.ptp(after.reshape(-1, 4, 6).mean(axis=1), axis=0)
    assert (drift > 20 * 0.01 * np.array([1, 1, 1, 0.1, 0.1, 0.1])).all(), 'worth removing'
    assert (remaining < 0.15 * drift).all(), 'drift of one or two thermal cells at most'


def test_a_recorded_reference_teaches_the_sensitivity(rig, make_robot):
    robot, rng = make_robot(), np.random.default_rng(2)
    node = rig(parameters={**QUICK, 'calibration.reference': 'recorded'})
    assert node.call('record', True).success
    scale = np.array([30, 30, 60, 3, 3, 3])
    robot.run(node, WARM, lambda _: scale * rng.uniform(-1, 1, 6))
    assert node.call('record', False).success
    answer = node.call('calibrate')
    assert answer.success, answer.message
    assert 'force_z: ' in answer.message
    assert 'zero and sensitivity' in answer.message

    last = WARM[-1]
    stamp = robot.stamps(last)[1] + 10**9
    assert robot.sensitivity[last] > 0.035
    load = np.array([0, 0, 50.0, 0, 0, 2.0])
    apart = np.array(
        node.ask_output(stamp, robot.zero[last] + (1 + robot.sensitivity[last]) * load)
    )
    apart -= node.ask_output(stamp + 1, robot.zero[last])
    assert apart[2] == pytest.approx(50.0, abs=0.6), 'raw: 51.9 N'
    assert apart[5] == pytest.approx(2.0, abs=0.03)


def test_a_second_calibration_starts_where_the_first_ended(rig, make_robot):
    """Raw wrenches are recorded, so a live model does not spoil the next calibration."""
    robot = make_robot()
    node = rig(parameters=QUICK)
    robot.write(node.directory / 'recordings/first.csv')
    assert node.call('calibrate').success
    assert node.call('record', True).success
    robot.run(node, range(150))
    assert node.call('record', False).success
    (path,) = (node.directory / 'recordings').glob('recording_*.csv')
    recorded = np.genfromtxt(path, delimiter=',', names=True)
    np.testing.assert_allclose(recorded['force_z'], robot.zero[:149, 2], atol=0.05)
    assert node.set('calibration.recordings', [str(path)]).successful
    answer = node.call('calibrate')
    assert answer.success, answer.message
    sources = node.node.live.stored.document['provenance']['recordings']
    assert [each['path'] for each in sources] == [str(path)]
    assert node.node.store.history()[0] is None
    assert len(node.node.store.history()) == 3
