import pytest

from wrist_ft_comp.node.parameters import PARAMETERS

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


def test_every_parameter_is_described(rig):
    shown = rig().node.describe_parameters([row.name for row in PARAMETERS])
    for row, descriptor in zip(PARAMETERS, shown, strict=True):
        assert len(descriptor.description.split()) > 3
        assert descriptor.read_only == row.read_only
        when = 'Read at start-up only.' if row.read_only else 'May change at run time.'
        assert descriptor.description.endswith(when)
        if row.element_type is float:
            assert f'Unit: {row.unit}.' in descriptor.description
            assert row.unit
            assert row.is_array or descriptor.floating_point_range


def test_recordings_elsewhere_are_refused(rig):
    refusal = rig().refused_value('calibration.recordings', ['/etc/passwd'])
    assert 'must lie inside data_directory' in refusal


def test_a_calibration_takes_the_parameters_of_its_time(rig):
    topics = ['temperature', 'state:joints[2].heat:K', '/far/temperature', 'state:data.3']
    node = rig(topics=topics, parameters={'thermal_period': 5})
    folder = node.directory / 'recordings'
    folder.mkdir(parents=True)
    for name in ('a.csv', 'b.csv'):
        (folder / name).write_text('')
    job = node.node.jobs.calibration()
    assert job.recordings == (folder / 'a.csv', folder / 'b.csv')
    assert job.skip_unusable
    assert job.period_s == 5.0
    assert job.topics.wrench == node.topic('wrench_raw')
    assert job.topics.temperatures == (
        node.topic('temperature'),
        f'{node.topic("state")}:joints[2].heat:K',
        '/far/temperature',
        f'{node.topic("state")}:data.3',
    )
    assert job.topics.reference == node.topic('wrench_reference')
    for name, value in {
        'calibration.recordings': ['recordings/b.csv', ''],
        'calibration.reference': 'recorded',
        'calibration.method': 'pls',
        'calibration.min_temperature_span': 1,
    }.items():
        assert node.set(name, value).successful, name
    job = node.node.jobs.calibration()
    assert job.recordings == (folder / 'b.csv',)
    assert not job.skip_unusable
    assert job.settings.reference == 'recorded'
    assert job.settings.identification.method == 'pls'
    assert job.settings.min_temperature_span_k == 1.0


def test_drift_is_limited_as_max_drift_says(rig, make_model):
    model = make_model('m.yaml', {'force_z': (2.0, 0.0, 0.0), 'torque_z': (2.0, 0.0, 0.0)})
    node = rig(model=model, parameters={'max_drift': 5})
    node.warm_up(30.0, 4)
    answer = node.ask_output(START + 9 * SECOND, [0.0] * 6)
    assert (answer[2], answer[5]) == pytest.approx((-5.0, -0.5))
    status = node.diagnosis('output', lambda status: status.level == b'\2')
    assert status.message == 'drift of force_z, torque_z is at its limit'
