"""A model knows the sensor it was learnt from, and its recordings by what is in them."""

import json
import shutil

import pytest
import yaml

from wrist_ft_comp.cli.main import main

START = 1_700_000_000 * 10**9
TOPICS = ('/ft/temperature', '/arm/state:motors[1].celsius')
STATE = 'arm_msgs/msg/State'


@pytest.fixture(scope='module')
def bag(tmp_path_factory, messages, make):
    """Write a day with two thermometers as a bag: a topic, and a field of a driver's message."""
    messages.learn('arm_msgs/msg/Motor', 'float64 celsius')
    messages.learn(STATE, 'std_msgs/Header header\nMotor[] motors')

    def parts(columns, frame, wrench):
        names = 'stamp_s', 'force_z', 'torque_x', 'temperature_c', 'temperature_2_c'
        for second, force, torque, inside, outside in zip(*map(columns.get, names), strict=True):
            at_ns = START + round(second * 10**9)
            six = [0.0, 0.0, force, torque, 0.0, 0.0]
            yield wrench, messages.wrench_type, at_ns, messages.wrench(at_ns, six, frame)
            warm = messages.temperature(at_ns, inside)
            yield TOPICS[0], messages.temperature_type, at_ns, warm
            motors = [messages.make('arm_msgs/msg/Motor', celsius) for celsius in (0.0, outside)]
            yield '/arm/state', STATE, at_ns, messages.pack(STATE, at_ns, motors)
            aside = messages.temperature(at_ns, outside)
            yield '/arm/temperature', messages.temperature_type, at_ns, aside

    def write(name, seed=0, frame='ft_sensor', storage='mcap', wrench='/ft/wrench'):
        folder = tmp_path_factory.mktemp('bags') / name
        columns = make.drifting(seed=seed, both=True)
        return messages.write(folder, parts(columns, frame, wrench), storage)

    return write


def named(*temperatures, wrench='/ft/wrench'):
    words = (('--temperature-topic', topic) for topic in temperatures or TOPICS)
    return '--wrench-topic', wrench, *(word for pair in words for word in pair)


@pytest.fixture(scope='module')
def day(bag):
    return bag('day')


@pytest.fixture(scope='module')
def learnt(day, tmp_path_factory):
    path = tmp_path_factory.mktemp('model') / 'model.yaml'
    assert main(['calibrate', str(day), '-o', str(path), '--method', 'pls', *named()]) == 0
    return path


def warnings(outcome):
    """Take the warnings of a command that succeeded, which are in its JSON, too."""
    assert outcome.code == 0, outcome
    said = json.loads(outcome.out)['warnings']
    assert all(f'warning: {sentence}' in outcome.err for sentence in said) or not outcome.err
    return said


def test_a_model_names_its_sensor(learnt, done):
    provenance = yaml.safe_load(learnt.read_text())['provenance']
    assert provenance['frame_id'] == 'ft_sensor'
    assert provenance['wrench_topic'] == '/ft/wrench'
    assert provenance['temperature_topics'] == list(TOPICS)
    shown = done('show', learnt)
    assert 'frame_id: ft_sensor\n' in shown
    assert f'°C, {TOPICS[1]}\n' in shown


@pytest.fixture(params=['evaluate', 'compensate'])
def apply_model(request, learnt, run, tmp_path):
    output = ['-o', tmp_path / 'out'] if request.param == 'compensate' else []
    return lambda recording, *words: run(request.param, learnt, recording, *output, *words)


def test_swapped_thermometers_are_refused(apply_model, bag, tmp_path):
    sentence = apply_model(bag('swapped', 1), *named(*TOPICS[::-1])).sentence
    assert f'expected {TOPICS[0]}, {TOPICS[1]}.' in sentence
    assert not (tmp_path / 'out').exists()


def test_the_model_s_topics_are_the_defaults_and_options_override(apply_model, bag):
    other = bag('renamed', 1, wrench='/left/wrench')
    assert 'holds no topic /ft/wrench' in apply_model(other).sentence
    assert apply_model(other, '--wrench-topic', '/left/wrench').code == 0


def test_another_day_is_run_as_show_says_and_the_day_of_the_model_is_not(learnt, day, bag, done):
    another = bag('another', 1)
    said = done('evaluate', learnt, another)
    lines = done('show', another, *named()).splitlines()
    (shown,) = (line for line in lines if '--ros-args' in line)
    assert shown.replace('model_file:=another.yaml', f'model_file:={learnt}') in said
    assert '--ros-args' not in done('evaluate', learnt, day)


def test_another_frame_is_a_warning(apply_model, bag):
    outcome = apply_model(bag('other', 1, frame='right_ft'), *named(), '--json')
    (warning,) = (sentence for sentence in warnings(outcome) if 'another sensor' in sentence)
    assert 'frame_id ft_sensor in model.yaml, right_ft in other' in warning


def test_recordings_of_two_sensors_in_one_fit_are_a_warning(day, bag, done, tmp_path):
    other = bag('other', 1, frame='right_ft')
    argv = 'calibrate', day, other, '-o', tmp_path / 'm.yaml', '--method', 'pls', *named()
    (warning,) = (e for e in json.loads(done(*argv, '--json'))['warnings'] if 'several' in e)
    assert 'right_ft in recording 2, other' in warning


def test_a_copy_is_found_by_any_name_and_another_day_is_none(learnt, day, bag, run, tmp_path):
    shutil.copytree(day, tmp_path / 'wednesday')
    (tmp_path / 'wednesday/notes.txt').write_text('a wednesday')
    for path, marked in (
        (tmp_path / 'wednesday', True), (day / 'day.mcap', True), (bag('day', 2), False),
    ):  # fmt: skip
        said = ' '.join(warnings(run('evaluate', learnt, path, '--json', *named())))
        assert ('learnt from' in said) == marked


def test_a_copy_is_counted_once(day, drift_csv, run, tmp_path):
    output = '-o', tmp_path / 'm.yaml'
    copy = shutil.copy(drift_csv, tmp_path / 'copy.csv')
    assert 'is a copy of' in run('calibrate', drift_csv, drift_csv, *output).sentence
    assert 'copy.csv is a copy of' in run('calibrate', drift_csv, copy, *output).sentence
    bare = day / 'day.mcap'
    assert 'is a copy of' in run('calibrate', day, bare, *output, *named()).sentence
    assert not (tmp_path / 'm.yaml').exists()
