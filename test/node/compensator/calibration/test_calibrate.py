from contextlib import suppress
import queue
from time import monotonic

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.stored.model_file import load_model

WARM = range(300)
AFTER = range(300, 520)
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
    node = wired(thermometers=2, period_s=10.0)
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
