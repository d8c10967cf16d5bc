"""The parameters of the node: described, dumped, loaded, and handed to jobs."""

from pathlib import Path

from moments import SECOND, START
import pytest
from rclpy.parameter import parameter_value_to_python
import yaml

from wrist_ft_comp.node.compensator_node import CompensatorNode, PARAMETERS, PARTS

CONFIG = Path(__file__).parents[3] / 'config/compensator.yaml'


def test_every_parameter_is_described(rig):
    shown = rig().node.describe_parameters([row.name for row in PARAMETERS])
    assert len(shown) < 22
    for row, descriptor in zip(PARAMETERS, shown, strict=True):
        assert len(descriptor.description.split()) > 3
        assert descriptor.read_only == row.read_only
        assert ('May change at run time' in descriptor.description) != row.read_only
        if row.element_type is float:
            assert row.unit
            assert f'Unit: {row.unit}.' in descriptor.description
    constraints = {descriptor.name: descriptor.additional_constraints for descriptor in shown}
    assert 'off, propose, auto' in constraints['learning.mode']
    assert 'from 0 to' in constraints['max_drift']


def test_the_list_of_parts_is_what_runs(rig):
    assert tuple(map(type, rig().node.parts)) == PARTS
    assert len({part.title for part in PARTS} - {''}) == len(PARTS)


def test_all_parameters_are_dumped_and_loaded_again(bench, tmp_path):
    chosen = {
        'temperature_topics': ['a', 'b:data[1]'], 'payload.center_of_mass': [0.0, 0.1, 0.2],
        'learning.mode': 'propose', 'data_directory': str(tmp_path / 'data'),
        'qos_overrides./wrench.publisher.depth': 7, 'calibration.recordings': ['/a/b.csv'],
    }  # fmt: skip
    node = bench.make(CompensatorNode, parameters=chosen)
    names = node.list_parameters([], 0).names
    values = node.get_parameters(names)
    node.destroy_node()
    file = tmp_path / 'dumped.yaml'
    tree = {}  # nested by the dots in names, as ``ros2 param dump`` does
    for name, one in zip(names, values, strict=True):
        *groups, last = name.split('.')
        branch = tree
        for group in groups:
            branch = branch.setdefault(group, {})
        branch[last] = parameter_value_to_python(one.get_parameter_value())
    file.write_text(yaml.safe_dump({'/wrist_ft_comp': {'ros__parameters': tree}}))
    again = bench.make(CompensatorNode, cli_args=['--ros-args', '--params-file', str(file)])
    loaded = [one.value for one in again.get_parameters(names)]
    assert loaded == [one.value for one in values]
    assert again.chosen()['temperature_topics'] == ('a', 'b:data[1]')
    for parameter in again.get_parameters(names):  # as ``ros2 param load`` into a running node
        (answer,) = again.set_parameters([parameter])
        assert answer.successful or 'read-only' in answer.reason, answer.reason


def test_the_file_of_parameters_that_is_installed_is_taken(bench, tmp_path):
    words = ['--params-file', str(CONFIG), '-p', f'data_directory:={tmp_path}']
    chosen = bench.make(CompensatorNode, cli_args=['--ros-args', *words]).chosen()
    wanted = yaml.safe_load(CONFIG.read_text('utf-8'))['/**']['ros__parameters']
    assert {name: chosen[name] for name in wanted} == {
        name: tuple(value) if isinstance(value, list) else value for name, value in wanted.items()
    }


def test_a_calibration_takes_the_parameters_of_its_time(rig):
    topics = ['temperature', 'state:joints[2].heat:K', '/far/temperature', 'state:data.3']
    node = rig(topics=topics)
    folder = node.directory / 'recordings'
    folder.mkdir(parents=True)
    recordings = tuple(folder / name for name in ('a.csv', 'b.csv'))
    for path in recordings:
        path.write_text('')
    job = node.node.jobs.job()
    assert (job.recordings, job.skip_unusable, job.period_s) == (recordings, True, 1.0)
    own, state = (node.topic(name) for name in ('temperature', 'state'))
    entries = own, f'{state}:joints[2].heat:K', '/far/temperature', f'{state}:data.3'
    assert job.topics.temperatures == entries
    names = (node.topic(name) for name in ('wrench_raw', 'wrench_reference'))
    assert (job.topics.wrench, job.topics.reference) == tuple(names)
    assert node.set('calibration.recordings', ['recordings/b.csv', '']).successful
    assert node.set('calibration.reference', 'recorded').successful
    elsewhere = node.refused_value('calibration.recordings', ['/etc/passwd'])
    assert 'must lie inside data_directory' in elsewhere
    job = node.node.jobs.job()
    assert (job.recordings, job.skip_unusable, job.period_s) == (recordings[1:], False, 0.0)
    assert job.settings.reference == 'recorded'


def test_drift_is_limited_as_max_drift_says(rig, make_model):
    model = make_model('m.yaml', {'force_z': (2.0, 0.0, 0.0), 'torque_z': (2.0, 0.0, 0.0)})
    node = rig(model=model, parameters={'max_drift': 5})
    node.warm_up(30.0, 4)
    answer = node.ask_output(START + 9 * SECOND, [0.0] * 6)
    assert (answer[2], answer[5]) == pytest.approx((-5.0, -0.5))
    status = node.diagnosis('output', lambda status: status.level == b'\2')
    assert status.message.startswith('drift of force_z, torque_z is at its limit; no tare')
