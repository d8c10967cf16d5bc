"""A bag of a driver: what could be used of it, how good it is, and the commands that use it."""

import json
import re
import shlex

import numpy as np
import pytest
import yaml

T0 = 1_723_248_197_000_000_000
BOTA = """
Status status
float32[3] force
float32[3] torque
uint32 timestamp
float32 temperature
float32[3] acceleration
================================================================================
MSG: bota_like_msgs/Status
bool throttled
bool overrange
"""
TOOL = """
int8 analog_input_range2
float64 analog_input2
uint8 tool_output_voltage
float32 tool_current
float32 tool_temperature
uint8 tool_mode
"""
JOINTS = """
string[] joint_names
float64[] temperatures
float64[] currents
"""
DYNAMIC = """
std_msgs/Header header
string[] joint_names
InterfaceValue[] interface_values
================================================================================
MSG: control_like_msgs/InterfaceValue
string[] interface_names
float64[] values
"""
IMU, TF = 'sensor_msgs/msg/Imu', 'tf2_msgs/msg/TFMessage'


class Drivers:
    """Bags of a warm-up of 20 min at 1 Hz, as two drivers' users record them."""

    def __init__(self, messages):
        self.messages = messages
        self.bota = messages.learn('bota_like_msgs/msg/Frame', BOTA)
        self.tool = messages.learn('ur_like_msgs/msg/ToolData', TOOL)
        self.joints = messages.learn('ur_like_msgs/msg/JointTemperatures', JOINTS)
        self.dynamic = messages.learn('control_like_msgs/msg/DynamicState', DYNAMIC)

    def times(self, seed):
        """Number, stamp, temperature inside and a wrench that drifts with it."""
        rng = np.random.default_rng(seed)
        for k in range(0, 12_000, 10):
            inside = 22 + 14 * (1 - np.exp(-k / 2500)) + 2 * np.sin(k / 900 + seed)
            force = 1.0 + 1.5 * (inside - 22) + rng.normal(0, 0.05)
            yield k, T0 + k * 10**8, inside, [0.1, -0.2, force, 0.01, 0.02, 0.03]

    def bota_like(self, seed=0):
        three, down = np.zeros(3, np.float32), (0, 0, 9.81)
        status = self.messages.make('bota_like_msgs/msg/Status', False, False)
        for k, at, inside, wrench in self.times(seed):
            fields = self.bota, status, three, three, k, inside, three
            yield '/bota/bota_frame', self.bota, at + 9000, self.messages.pack(*fields)
            whole = self.messages.wrench(at, wrench, 'bota_wrench')
            yield '/bota/wrench', self.messages.wrench_type, at + 9000, whole
            if k % 20 == 0:
                yield '/bota/imu', IMU, at + 9000, self.messages.imu(at, down, down)
                warm = self.messages.temperature(at, 24.0 + 3 * k / 12_000, 'cabinet')
                yield '/cabinet/temperature', self.messages.temperature_type, at + 9000, warm

    def ur_like(self, seed=0):
        pack, make = self.messages.pack, self.messages.make
        order = np.roll(range(6), seed)  # joint_states may change it any day
        names = [f'joint_{n}' for n in order]
        for k, at, inside, wrench in self.times(seed):
            yield '/tool_data', self.tool, at + 9000, pack(self.tool, 1, 0.1, 24, 0.3, inside, 253)
            whole = self.messages.wrench(at, wrench, 'tool0')
            yield '/ftsensor/wrench', self.messages.wrench_type, at + 9000, whole
            if k % 50 == 0 and not 4000 < k < 5000:
                warm = np.array([inside + 1 + n for n in order])
                joints = pack(self.joints, names, warm, np.zeros(6))
                yield '/joint_heat', self.joints, at + 9500, joints
                interfaces = ['position', 'temperature']
                values = [
                    make('control_like_msgs/msg/InterfaceValue', interfaces, np.array([0.5, heat]))
                    for heat in warm
                ]
                state = pack(self.dynamic, at, names, values)
                yield '/dynamic_joint_states', self.dynamic, at + 9500, state
                yield '/tf', TF, at + 9500, pack(TF, [])


@pytest.fixture(scope='session')
def drivers(messages):
    return Drivers(messages)


BOTA_WORDS = [
    '--wrench-topic', '/bota/wrench', '--temperature-topic', '/bota/bota_frame:temperature',
    '--temperature-topic', '/cabinet/temperature',
]  # fmt: skip
UR_WORDS = [
    '--wrench-topic', '/ftsensor/wrench', '--temperature-topic', '/tool_data:tool_temperature',
    '--temperature-topic', '/dynamic_joint_states:interface_values[joint_5].values[temperature]',
]  # fmt: skip


def commands(out):
    return [shlex.split(line) for line in out.splitlines()[-3:]]


@pytest.mark.parametrize(('kind', 'storage', 'compression', 'words'), [
    ('bota_like', 'mcap', 'storage', BOTA_WORDS), ('ur_like', 'sqlite3', 'file', UR_WORDS),
], ids=['bota', 'ur'])  # fmt: skip
def test_the_commands_that_show_prints_learn_judge_and_run(  # noqa: PLR0913, PLR0917
    run, done, drivers, messages, tmp_path, monkeypatch, kind, storage, compression, words
):
    day = messages.write(tmp_path / 'a day', getattr(drivers, kind)(), storage, compression)
    calibrate, evaluate, node = commands(done('show', day))
    named = ['-o', 'a day.yaml', '--report', 'a day.html']
    assert calibrate == ['wrist_ft_comp', 'calibrate', str(day), *named, *words]
    judged = ['a day.yaml', 'ANOTHER_DAY', '--report', 'evaluation.html']
    assert evaluate == ['wrist_ft_comp', 'evaluate', *judged, *words]
    node = node[node.index('--ros-args') :]
    assert node[1:5] == ['-p', 'model_file:="a day.yaml"', '-r', f'wrench_raw:={words[1]}']
    name, _, value = node[6].partition(':=')
    assert (name, yaml.safe_load(value)) == ('temperature_topics', [words[3], words[5]])
    monkeypatch.chdir(tmp_path)
    other = getattr(drivers, kind)(seed=1)
    messages.write(tmp_path / 'ANOTHER_DAY', other, storage, compression)
    done(*calibrate[1:], '--method', 'pls')
    assert 'good' in run(*evaluate[1:]).out
    kept = yaml.safe_load((tmp_path / 'a day.yaml').read_text())['provenance']
    assert kept['temperature_topics'] == [words[3], words[5]]
    assert re.search(rf'thermometer 2: .* °C, {re.escape(words[5])}', done('show', 'a day.yaml'))


def test_show_rates_every_topic(done, drivers, messages, tmp_path):
    out = done('show', messages.write(tmp_path / 'day', drivers.ur_like(), 'mcap', 'file'))
    assert 'rosbag2, mcap, file compression' in out
    rows = (row.split() for row in out.splitlines() if re.search(r' /\S+$', row))
    cells = {row[-1]: row for row in rows}
    assert cells['/ftsensor/wrench'][:2] == ['raw', 'wrench']
    assert cells['/joint_heat:temperatures[joint_0]'][:3] == ['temperature', '23.0', 'to']
    joint_3 = '/dynamic_joint_states:interface_values[joint_3].values'
    assert cells[f'{joint_3}[temperature]'][0] == 'temperature'
    assert f'{joint_3}[position]' not in cells
    assert cells['/tf'][0] == 'TF'
    assert '/joint_heat:currents[joint_0]' not in cells


def test_show_as_json_has_it_all(done, drivers, messages, tmp_path):
    bag = messages.write(tmp_path / 'day', drivers.bota_like())
    shown = json.loads(done('show', bag, '--json'))
    (frame,) = (c for c in shown['candidates'] if 'frame:temp' in c['entry'])
    assert not frame['stamped']
    assert frame['samples'] == 1200
    assert shown['topics']['wrench'] == '/bota/wrench'
    assert shown['topics']['temperatures'][0] == frame['entry']
    assert {'temperature'} == {c['role'] for c in shown['channels'] if 'frame' in c['name']}


def test_named_topics_are_taken_before_likely_ones(done, drivers, messages, tmp_path):
    bag = messages.write(tmp_path / 'day', drivers.ur_like())
    given = ['--temperature-topic', '/joint_heat:temperatures[2]']
    calibrate, _, _ = commands(done('show', bag, *given))
    assert calibrate[-2:] == given
    assert '/tool_data:tool_temperature' not in calibrate
    out = done('show', bag, '--temperature-topic', '/typo:heat')
    assert out.endswith('no temperature of that name, so nothing can be learnt from it.\n')


def test_temperatures_in_another_unit_or_that_stand_still_are_told(done, messages, tmp_path):
    wrench = '/ft', messages.wrench_type, T0, messages.wrench(1, range(6))
    for low, high, said in ((240, 346, 'a column takes :K, :F or'), (20, 20, 'No temperature mo')):
        heat = [messages.temperature(k + 1, value) for k, value in enumerate((low, high))]
        warm = [('/heat', messages.temperature_type, T0, data) for data in heat]
        assert said in done('show', messages.write(tmp_path / f'{high}', [wrench, *warm]))


def test_one_of_two_arms_is_proposed_with_its_own_thermometers(done, messages, tmp_path):
    def arms():
        for k in range(600):
            at = T0 + k * 10**8
            for arm in ('left', 'right'):
                whole, heat = messages.wrench(at, range(6)), messages.temperature(at, 25 + k / 100)
                yield f'/{arm}/ft/wrench', messages.wrench_type, at, whole
                for name in (f'/{arm}/motor_temperature', f'/{arm}_ft/heat', '/room/heat'):
                    yield name, messages.temperature_type, at, heat

    bag = messages.write(tmp_path / 'day', arms())
    for arm, given in (('left', []), ('right', ['--wrench-topic', '/right/ft/wrench'])):
        out = done('show', bag, *given)
        calibrate, *_ = commands(out)
        inside, motor = f'/{arm}_ft/heat', f'/{arm}/motor_temperature'
        assert calibrate[-6:] == [
            '--wrench-topic', f'/{arm}/ft/wrench', '--temperature-topic', inside,
            '--temperature-topic', motor,
        ]  # fmt: skip
        assert f'by its name it is most probably {inside}:' in out


def test_an_unstamped_thermometer_is_proposed_as_it_is_read(done, messages, tmp_path, monkeypatch):
    def day():
        for k in range(600):
            at = T0 + k * 10**9
            yield '/ft/heat', messages.temperature_type, at, messages.temperature(0, 25 + k / 50)
            yield '/ft/wrench', messages.wrench_type, at, messages.wrench(at, [k / 100] * 6)

    monkeypatch.chdir(tmp_path)
    bag = messages.write(tmp_path / 'day', day(), 'mcap')
    command = json.loads(done('show', bag, '--json'))['commands'][0]
    done(*shlex.split(command)[1:], '--method', 'pls')


def test_a_damaged_topic_does_not_hide_the_others(done, drivers, messages, tmp_path):
    broken = '/broken', drivers.bota, T0, b'\0\1\0\0'
    damaged = '/damaged', messages.wrench_type, T0, messages.wrench(1, range(6))[:-3]
    whole = '/ft', messages.wrench_type, T0, messages.wrench(1, range(6))
    out = done('show', messages.write(tmp_path / 'bag', [broken, damaged, whole]))
    assert 'warning: /damaged cannot be used: ' in out
    assert 'It holds no temperature, so nothing can be learnt from it.' in out


def work(messages, by):
    """A robot that tilts its tool about two axes for two minutes, with an IMU, or its TF."""
    static = [('world', 'base', [0, 0, 0, 1]), ('tool', 'ft', [0, 0, 0, 1])]
    yield '/tf_static', TF, T0, messages.transforms(T0, static) if by == 'tf' else None
    for k in range(1200):
        at, tilt = T0 + k * 10**8, (0.3 * np.sin(k / 100), 0.2 * np.cos(k / 130))
        x, y = np.sin(tilt)
        yield '/ft/wrench', messages.wrench_type, at, messages.wrench(at, [x, y, 1, 1, 1, 1], 'ft')
        yield '/ft/heat', messages.temperature_type, at, messages.temperature(at, 25 + k / 100)
        if by == 'imu':
            yield '/cart/imu', IMU, at, messages.imu(at, [0, 0, 9.81], [0, 0, 0])
            force = 9.6 * np.array([x, y, np.sqrt(1 - x * x - y * y)])
            yield '/ft/imu', IMU, at, messages.imu(at, force, [0, 0, 0])
        else:
            turned = np.array([*tilt, 0, 2])
            link = 'base', 'tool', turned / np.linalg.norm(turned)
            yield '/tf', TF, at, messages.transforms(at, [link])


@pytest.mark.parametrize(('by', 'words', 'parameters', 'said'), [
    ('imu', ['--imu-topic', '/ft/imu'], ['gravity.source:=imu', '-r', 'imu:=/ft/imu'],
     'specific force: gravity moved along'),
    ('tf', ['--gravity-frame', 'world'], ['gravity.source:=tf', '-p', 'gravity.frame:=world'],
     'specific force by TF, if z of world is up: gravity moved along'),
])  # fmt: skip
def test_a_robot_at_work_is_learnt_from_by_its_gravity(  # noqa: PLR0913, PLR0917
    done, messages, tmp_path, by, words, parameters, said
):
    bag = messages.write(tmp_path / 'day', work(messages, by), 'mcap')
    out = done('show', bag)
    assert said in ' '.join(out.split())
    assert 'along 2 of 3 directions' in ' '.join(out.split())
    calibrate, evaluate, node = commands(out)
    for command in (calibrate, evaluate):
        assert command[command.index('--reference') + 1] == 'payload'
        assert command[-2:] == words
    assert node[-len(parameters) :] == parameters
    shown = json.loads(done('show', bag, *words, '--json'))
    assert shown['gravity_directions'] >= 2
    used = {channel['name']: channel['role'] for channel in shown['channels']}
    topic = '/ft/imu' if by == 'imu' else '/tf'
    assert [name for name in used if used[name] == 'specific force'] == [topic]


def test_a_gravity_frame_that_tf_lacks_is_said_by_show(done, messages, tmp_path):
    bag = messages.write(tmp_path / 'day', work(messages, 'tf'))
    out = done('show', bag, '--gravity-frame', 'map')
    said = 'with these topics. day: TF does not say how ft is turned against map: map is missing.'
    assert said in out
    assert '--reference payload' not in out
