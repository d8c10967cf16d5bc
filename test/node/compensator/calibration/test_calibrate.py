from contextlib import suppress
import queue
from time import monotonic

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.stored.model_file import load_model

SECOND = 1_000_000_000
WARM = range(300)
AFTER = range(300, 520)
#: A calibration may take this long on a busy machine.
FIT_TIMEOUT_S = 60.0
#: From one wrench to the next, which leaves the processor to the fit.
PAUSE_S = 0.02


class Robot:
    """
    A sensor whose drift is known: each axis follows its gains times lagged temperatures.

    Its motor works by turns; two thermometers follow at two speeds.
    """

    GAINS = np.array([0.3, -0.5, 1.0, 0.02, 0.03, -0.05])
    WORK = (1.0, 0.2, 0.8, 0.0, 1.0, 0.5, 0.9, 0.1, 0.0, 0.6, 0.2, 0.9, 0.0)

    def __init__(self, lagged):
        work = np.repeat(self.WORK, 40)
        far, near = lagged(15.0 * work, 600.0), lagged(25.0 * work, 200.0)
        self.temperature_c = 20.0 + np.stack((far, near), axis=1)
        self.zero = np.outer(lagged(far, 300.0) + 0.7 * lagged(near, 100.0), self.GAINS)
        self._rng = np.random.default_rng(5)

    def raw(self, cell):
        """Reading without load, N and N m."""
        noise = self._rng.normal(0, 0.01, 6) * [1, 1, 1, 0.1, 0.1, 0.1]
        return self.zero[cell] + noise

    def stamps(self, cell):
        """Times of two wrenches in a thermal cell of 10 s."""
        return [1_700_000_000 * SECOND + (10 * cell + part) * SECOND for part in (2, 7)]

    def run(self, rig, cells):
        """Send cells one by one; return outputs, shape (2 N, 6)."""
        outputs = []
        for cell in cells:
            stamps = self.stamps(cell)
            rig.warm(stamps[0], *self.temperature_c[cell])
            outputs.append(rig.stream(stamps, [self.raw(cell) for _ in stamps]))
        return np.concatenate(outputs)


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


def test_a_warm_up_is_recorded_learnt_and_removed(wired, lagged):
    robot = Robot(lagged)
    node = wired(thermometers=2, period_s=10.0)
    assert node.call('record', True).success
    robot.run(node, WARM)
    assert '(2990 s)' in node.call('record', False).message

    answer, outputs, raw = calibrate_while_streaming(node, robot)
    assert answer.success, answer.message
    lines = answer.message.splitlines()
    for axis, line in zip(AXES, lines, strict=False):
        assert line.startswith(f'{axis}: ')
        assert ' RMS' in line
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
