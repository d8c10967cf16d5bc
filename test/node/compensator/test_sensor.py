import math
from pathlib import Path
import shutil

from moments import SECOND, START
import pytest
import yaml

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.recordings.read import read_recording
from wrist_ft_comp.ros.diagnostics import OK, WARN

TOPICS = ['/a/temperature', '/b/state:motors[0]*0.1:K']


@pytest.fixture
def learnt(make_model):
    """Write a model with what it knows of its sensor."""

    def make(name='known.yaml', **facts):
        stored = make_model(name, thermometers=2)
        document = yaml.safe_load(stored.path.read_text())
        document['provenance'].update(facts)
        stored.path.write_text(yaml.safe_dump(document))
        return f'models/{name}'

    return make


def test_swapped_thermometers_are_refused_at_the_start_and_while_running(rig, learnt, capfd):
    path = learnt(temperature_topics=TOPICS)
    node = rig(thermometers=2, topics=TOPICS, parameters={'model_file': path})
    with pytest.raises(SettingsError, match=r'expected /a/temperature, /b/state'):
        rig(thermometers=2, topics=TOPICS[::-1], parameters={'model_file': path})
    other = learnt('other.yaml', temperature_topics=TOPICS[::-1])
    assert 'temperature_topics' in node.refused_value('model_file', other)
    assert node.node.live.stored.path.name == 'known.yaml'
    status = rig(thermometers=2, topics=TOPICS[::-1]).diagnosis('model')
    assert 'The last model cannot be used: ' in status.message
    assert 'expected /a/temperature, /b/state:motors[0]' in capfd.readouterr().err


def test_another_frame_and_serial_number_are_a_warning(rig, learnt, capfd):
    path = learnt(frame_id='left_ft', hardware_id='FT-1', temperature_topics=TOPICS)
    parameters = {'model_file': path, 'hardware_id': 'FT-2'}
    node = rig(thermometers=2, topics=TOPICS, parameters=parameters)
    status = node.diagnosis('model', 'hardware_id FT-1 in known.yaml, FT-2 here')
    assert status.level == WARN
    assert 'frame_id' not in status.message
    node.put(START, [0.0] * 6, 'right_ft')
    assert node.diagnosis('model', 'frame_id left_ft in known.yaml, right_ft here').level == WARN
    node.diagnosis('model')
    assert capfd.readouterr().err.count('right_ft here') == 1


@pytest.mark.usefixtures('haste')
def test_a_model_takes_its_sensor_from_the_recording(rig, tmp_path):
    parameters = {'hardware_id': 'FT-7'}
    node = rig(thermometers=2, topics=TOPICS, period_s=0.1, parameters=parameters)
    node.put(START, [0.0] * 6, 'left_ft, "b"')
    path = Path(node.call('record', True).message.removeprefix('recording into '))
    for k in range(200):
        at = START + k * SECOND // 10
        warm = 5 * math.sin(k / 20)
        node.put(at, [warm + 0.01 * (k % 7)] * 6, 'left_ft, "b"')
        for thermometer, celsius in enumerate((20.0 + warm, 20.0)):
            node.node.inputs.take(thermometer, at, celsius)
    assert node.call('record', False).success
    recording = read_recording(path, period_s=0.1)
    assert recording.warnings == ()
    sensor = recording.sensor
    assert sensor == {
        'hardware_id': ['FT-7'], 'frame_id': ['left_ft, "b"'],
        'wrench_topic': [node.topic('wrench_raw')], 'temperature_topics': TOPICS,
    }  # fmt: skip
    copy = shutil.copy(path, path.with_name('recording_20991231T000000Z.csv'))
    answer = node.call('calibrate')
    assert answer.success, answer.message
    assert f'{copy} is a copy of {path}' in answer.message
    assert node.node.live.stored.sensor == sensor
    assert node.diagnosis('model', lambda status: status.level == OK)
    parameters |= {'calibration.recordings': [str(path)]}
    other = rig(
        thermometers=2, topics=TOPICS[::-1], parameters=parameters, namespace='/other',
        directory=tmp_path / 'other',
    )  # fmt: skip
    assert 'in another order' in other.refusal('calibrate')
