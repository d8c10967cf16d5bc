"""What was seen, what was not, and what a person should record next."""

import shlex
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.report.advice import advise, Case, cover, run_command

HOUR = 360  # cells of 10 s


def ramp(start, end, cells=HOUR):
    return np.linspace(start, end, cells)


@pytest.fixture(scope='module')
def seen(make_recording):
    def make(*temperatures):
        return cover([make_recording(t, {'force_z': np.zeros(len(t))}) for t in temperatures])

    return make


def advice(coverage, levels=None, reference='unloaded', hours=(2.0,), warnings=(), **more):
    recordings = [SimpleNamespace(duration_s=3600 * h) for h in hours]
    levels = dict.fromkeys(AXES, 'good') if levels is None else levels
    return '\n'.join(advise(Case(recordings, coverage, reference, levels, warnings, **more)))


def test_time_without_a_wrench_is_not_counted(make_recording):
    raw = np.zeros(3 * HOUR)
    raw[:HOUR] = raw[-HOUR // 2 :] = np.nan
    coverage = cover([make_recording(ramp(10, 40, 3 * HOUR), {'force_z': raw})])
    assert coverage.range_c[0] == pytest.approx([20, 35], abs=0.1)
    assert coverage.risen_k == pytest.approx(15, abs=1)
    assert 'recordings go from 20 to 35 °C. If the robot gets colder' in advice(coverage)


NOISE = np.random.default_rng(1).normal(0, 0.2, HOUR)
PAIR = np.stack((ramp(20, 30), ramp(20, 40)), axis=1)
BOTH_WAYS = np.concatenate((ramp(20, 35), ramp(35, 25)))
#: Of an evaluation, where two thermometers stayed in their range.
JUDGED = {'learnt_c': [(0.0, 50.0)] * 2}
WARM = ['day.csv begins on a warm robot. Unless it had rested, ...']
BEYOND = {'levels': {'force_z': 'weak'}, 'beyond': ['force_z']}
#: Temperatures, what else is known, and a part of what is asked for, or of what is not.
ASKED = [
    (ramp(20, 35) + NOISE, {}, 'Let it cool down', ''),
    (ramp(35, 20), {}, 'Let it warm up', ''),
    (BOTH_WAYS, {}, '', 'Let it'),
    (ramp(20, 30), {'levels': {'force_x': 'weak'}}, 'One thermometer does not', ''),
    (PAIR, JUDGED | {'levels': {'force_x': 'weak', 'force_y': 'uncalibrated'}}, 'order of', ''),
    (PAIR, JUDGED | {'levels': {'force_x': 'weak', 'force_y': 'good'}}, '', 'the order of'),
    (PAIR, JUDGED | {'levels': {'force_x': 'weak'}, 'warnings': WARM}, 'from cold', 'order of'),
    (PAIR, JUDGED | {'levels': {'force_x': 'harmful'}}, 'Do not run this model: it makes fo', ''),
    (ramp(20, 35), {'levels': {'force_x': 'weak'}, 'learnt_c': [(0.0, 50.0)]}, '', 'order of'),
    (ramp(20, 30), {'levels': {'force_x': 'good'}}, '', 'not explain'),
    (PAIR, {'levels': {'force_x': 'weak', 'force_y': 'good'}}, '', 'not explain'),
    (PAIR, {'levels': {'force_x': 'weak'}}, 'The 2 thermometers do not explain force_x', ''),
    (PAIR, {'levels': dict.fromkeys(AXES, 'weak')}, 'not explain any axis well', ''),
    (PAIR, {}, 'from 20 to 40 °C at thermometer 2', ''),
    (ramp(20, 35), {}, 'ended hot: the sensor warmed by 13.8 K and', 'ended cold'),
    (ramp(20, 35), {}, 'A lag can only be measured if it also cools down.', ''),
    (ramp(20, 35), {'hours': (0.5,)}, 'lasts 0.5 h; record 1.0 h or more.', ''),
    (ramp(20, 35), {}, 'second day', 'lasts'),
    (ramp(20, 35), {'hours': (2.0, 2.0)}, '', 'second day'),
    (ramp(20, 35), {'learnt_c': [(20.0, 30.0)], 'run': 'run x'}, '1 left the range', 'holds'),
    (ramp(20, 35), {'learnt_c': [(25.0, 40.0)], 'run': 'run x'}, '1 left the range', 'holds'),
    (ramp(20, 35), JUDGED | {'run': 'run x'}, 'recordings. Run it:\nrun x', ''),
    (ramp(20, 35), JUDGED | {'levels': {'force_x': 'good', 'force_z': 'weak'}}, '_z well:', ''),
    (ramp(20, 35), BEYOND | {'learnt_c': [(20.0, 30.0)]}, 'others.\nIn these', 'explain'),
    (ramp(20, 35), BEYOND | JUDGED, '9 of 10 days: force_z. See', 'left the'),
    (ramp(20, 35), {'run': 'evaluate m.yaml DAY'}, 'not seen:\nevaluate m.yaml DAY', ''),
]  # fmt: skip


@pytest.mark.parametrize(('temperature_c', 'known', 'asked', 'not_asked'), ASKED)
def test_what_is_missing_is_asked_for(seen, temperature_c, known, asked, not_asked):
    text = advice(seen(temperature_c), **known)
    assert asked in text
    assert not not_asked or not_asked not in text


def test_warming_and_cooling_are_those_of_one_recording(seen):
    assert seen(ramp(20, 35), ramp(20, 30)).risen_k == pytest.approx(13.8, abs=0.1)


def test_the_command_that_runs_a_model_names_no_topic_that_is_usual(monkeypatch):
    for found, start in (('', 'compensator'), ('/bin', 'ros2 run wrist_ft_comp compensator')):
        monkeypatch.setattr('wrist_ft_comp.report.advice.which', {'ros2': found}.get)
        words = f'{start} --ros-args -p model_file:=m.yaml'
        assert run_command(Topics(), 'm.yaml') == words
        assert run_command(Topics(imu='/imu'), 'm.yaml') == f'{words} -p gravity.source:=imu'


@pytest.mark.parametrize('name', ['m.yaml', 'warm up #2.yaml', 'a: b', '@x', '{a}', 'grün.yaml'])
def test_a_model_s_name_arrives_as_it_is(name):
    (given,) = (word for word in shlex.split(run_command(Topics(), name)) if ':=' in word)
    assert yaml.safe_load(given.removeprefix('model_file:=')) == name


def test_the_worst_comes_first(seen):
    case = Case(
        [SimpleNamespace(duration_s=600.0)], seen(ramp(20, 35)), 'unloaded',
        dict.fromkeys(AXES, 'weak'), ['day swings around its levels of 120 s'])  # fmt: skip
    first, second, third, *_ = advise(case)
    assert first.startswith('The load moved, although it was declared unloaded.')
    assert second.startswith('One thermometer does not explain any axis well')
    assert third.startswith('The longest recording lasts 0.2 h; record 1.0 h or more')
