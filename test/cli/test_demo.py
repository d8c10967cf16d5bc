"""The demonstration without its processes, and with processes that fail."""

import json
import os
import sys

import numpy as np
import pytest

from wrist_ft_comp.cli import demo, options
from wrist_ft_comp.cli import demo_result as result
from wrist_ft_comp.cli.demo import Plan
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.stored.demo_log import DemoLog

SECOND = 10**9


def make_log(calibrated_s=100, seconds=300):
    """One wrench a second; raw drifts by a ramp, compensated by a tenth of it."""
    rng = np.random.default_rng(0)
    t = np.arange(seconds)
    reference = rng.normal(size=(seconds, 6))
    ramp = np.outer(t, np.arange(1, 7))
    return DemoLog(
        stamps_ns=t * SECOND,
        raw=reference + ramp + 5,
        compensated=reference + 0.1 * ramp - 2,
        reference=reference,
        external=np.full((seconds, 6), np.nan),
        external_reference=np.full((seconds, 6), np.nan),
        temperature_stamps_ns=np.repeat(t, 2) * SECOND,
        thermometer=np.tile([0, 1], seconds),
        temperature_c=np.repeat(20.0 + t, 2),
        calibrated_ns=calibrated_s * SECOND,
    )


def test_errors_are_tared_on_the_first_minute_after_the_calibration():
    raw, compensated = result.errors(make_log())
    since = np.arange(1, 200)  # stamps 101 … 299 s; the first minute is 1 … 60
    expected = np.outer(since - since[:60].mean(), np.arange(1, 7))
    np.testing.assert_allclose(raw, expected, atol=1e-9)
    np.testing.assert_allclose(compensated, 0.1 * expected, atol=1e-9)


def test_a_log_without_wrenches_after_the_calibration_is_a_sentence():
    with pytest.raises(RecordingError, match='Not every wrench was received'):
        result.errors(make_log(calibrated_s=1000))


@pytest.mark.parametrize(('kept', 'code'), [(0.05, 0), (0.2, 1)])
def test_the_exit_code_is_0_where_drift_fell_enough(kept, code, run, tmp_path, monkeypatch):
    log = make_log()
    raw = log.raw - log.reference
    better = DemoLog(**{**vars(log), 'compensated': log.reference + kept * raw})
    monkeypatch.setattr(options, 'find_spec', lambda _: object())
    monkeypatch.setattr(demo, 'play', lambda *_: None)
    monkeypatch.setattr(demo, 'load_demo_log', lambda _: better)
    outcome = run('demo', '--output', tmp_path / 'out')
    assert (outcome.code, outcome.err) == (code, '')
    assert f'fell {1 / kept:.1f} times' in outcome.out
    picture = tmp_path / 'out' / 'demo.png'
    assert picture.read_bytes().startswith(b'\x89PNG')
    again = run('demo', '--output', tmp_path / 'out', '--json')
    force_z = json.loads(again.out)['axes']['force_z']
    assert again.code == code
    assert force_z['rms_after'] == pytest.approx(kept * force_z['rms_before'])


def test_without_rclpy_there_is_a_sentence(run, tmp_path, monkeypatch):
    monkeypatch.setattr(options, 'find_spec', lambda _: None)
    assert 'rclpy' in run('demo', '--output', tmp_path / 'out').sentence
    assert not (tmp_path / 'out').exists()


@pytest.fixture
def children(monkeypatch):
    """Run these pieces of Python in the place of the three programs; gives their processes."""
    started = []
    genuine = demo.subprocess.Popen

    def install(**scripts):
        def start(argv, **more):
            script = scripts[argv[2].rpartition('.')[2]]
            process = genuine([sys.executable, '-c', script, *argv[3:]], **more)
            started.append(process)
            return process

        monkeypatch.setattr(demo.subprocess, 'Popen', start)
        monkeypatch.setattr(options, 'find_spec', lambda _: object())
        return started

    return install


WAIT = 'import signal; signal.pause()'
TELL = 'import json; print(json.dumps({}), flush=True); import signal; signal.pause()'
FAIL = 'raise SystemExit(7)'


@pytest.mark.parametrize(
    ('scripts', 'expected', 'count'),
    [
        ({'compensator': WAIT, 'demo_client': FAIL}, 'without a result', 2),
        ({'compensator': FAIL, 'demo_client': WAIT}, 'compensator of the demonstration', 2),
        (
            {'compensator': WAIT, 'simulated_sensor': FAIL,
             'demo_client': TELL.format({'event': 'recording'})},
            'simulated sensor of the demonstration ended early, with exit code 7', 3,
        ),
        (
            {'compensator': WAIT,
             'demo_client': TELL.format({'event': 'failed', 'text': 'It was refused.'})},
            'failed: It was refused.', 2,
        ),
        (
            {'compensator': WAIT, 'demo_client': 'print("no JSON"); print(3); print("{}")'},
            'without a result', 2,
        ),
    ],
    ids=['operator', 'compensator', 'sensor', 'refusal', 'chatter'],
)  # fmt: skip
def test_a_failing_process_ends_all_with_a_sentence(  # noqa: PLR0913, PLR0917 -- fixtures
    scripts, expected, count, run, children, tmp_path
):
    started = children(**scripts)
    assert expected in run('demo', '--output', tmp_path).sentence
    assert len(started) == count
    assert all(process.returncode is not None for process in started)
    assert not (tmp_path / 'demo.png').exists()


def test_no_file_is_named_that_the_demonstration_deletes(run, children, tmp_path):
    answer = """
import json, pathlib, sys
folder = pathlib.Path(sys.argv[1]).parent
text = f'force_z: 9 -> 1 N\\nsaved as {folder}/m.yaml\\nreport: {folder}/m.html'
print(json.dumps({'event': 'message', 'text': text}), flush=True)
print(json.dumps({'event': 'message', 'text': f'recording into {folder}/r.csv'}), flush=True)
"""
    children(compensator=WAIT, demo_client=answer)
    outcome = run('demo', '--output', tmp_path)
    assert 'without a result' in outcome.err
    assert outcome.out == 'force_z: 9 -> 1 N\n'


def test_the_demonstration_keeps_out_of_the_user_s_domain(monkeypatch):
    """A robot on this computer must never hear the simulated wrench."""
    domain = int(demo._environment()['ROS_DOMAIN_ID'])
    assert domain in range(60, 101)
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    environment = demo._environment()
    assert environment['ROS_DOMAIN_ID'] != str(domain)
    assert environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
    assert environment['PATH'] == os.environ['PATH']


@pytest.mark.parametrize('at_work', [False, True])
def test_only_a_robot_at_work_is_learnt_from_by_its_payload(at_work, tmp_path):
    plan = Plan(1, 450.0, at_work)
    words = [*plan.compensator(tmp_path), *plan.operator(tmp_path / 'log.npz'), *plan.sensor()]
    assert any('payload' in word for word in words) is at_work
    levels = next(word for word in words if word.startswith('duty_cycle.level'))
    assert json.loads(levels.partition(':=')[2])


def at_work_log(payload_error_n):
    """A tool of 1.4 kg hangs down for 200 s and holds a part for the rest; a push of 10 N on x."""
    log = make_log()
    pushed = np.zeros((len(log.stamps_ns), 6))
    pushed[150:160, 0] = 10.0
    weight = np.where(np.arange(len(pushed)) < 200, 1.4, 2.2) * 9.807
    reference = pushed.copy()
    reference[:, 2] -= weight
    drift = log.raw - log.reference
    external = pushed + 3.0
    external[200:, 2] -= 0.8 * 9.807  # the part pushes on the tool: not judged
    external[180:200, 1] += payload_error_n
    return DemoLog(
        **{
            **vars(log),
            'raw': reference + drift,
            'reference': reference,
            'compensated': reference + 0.1 * drift,
            'external': external,
            'external_reference': pushed,
        }
    )


@pytest.mark.parametrize(('mass_kg', 'reached'), [(1.41, True), (1.3, False)])
def test_at_work_the_mass_and_the_external_wrench_are_judged_too(mass_kg, reached):
    outcome = result.judge(at_work_log(payload_error_n=2.0), {'m-1': mass_kg, 'm-2': 2.2})
    assert outcome.reached is reached
    assert f'found to be {mass_kg:.3f} kg' in outcome.sentence
    # 20 of the 99 s that hold the tool alone are 2 N off; the first minute is the tare.
    np.testing.assert_allclose(outcome.external['force_y'], 2.0 * np.sqrt(20 / 99), rtol=1e-6)
    np.testing.assert_allclose(outcome.external['force_x'], 0.0, atol=1e-9)
    assert 'wrench_external' in outcome.table()
    assert outcome.as_json()['axes']['force_y']['external_rms'] == outcome.external['force_y']


def test_at_work_without_a_payload_the_promise_is_not_kept():
    assert not result.judge(at_work_log(0.0), {}).reached
