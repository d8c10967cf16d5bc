import json
import re

import numpy as np
import yaml

from wrist_ft_comp.payload.weight import ForceFrame, Payload
from wrist_ft_comp.stored.payload_file import add_payloads, PAYLOADS


def test_a_model_says_what_it_is_and_what_it_is_for(done, model):
    out = done('show', model)
    for words in ('force_z', 'torque_x', 'N m', 'pls', 'calibrated from 20', str(model)):
        assert words in out
    assert 'how a wrist force/torque sensor drifts' in out
    assert max(len(line) for line in out.splitlines() if str(model) not in line) <= 80


def test_a_model_as_json_is_the_file(done, model):
    shown = json.loads(done('show', model, '--json'))
    assert len(shown.pop('sha256')) == 64
    assert shown == yaml.safe_load(model.read_text())


def test_a_model_whose_provenance_was_edited_is_shown(done, model, tmp_path):
    document = yaml.safe_load(model.read_text())
    copy = tmp_path / 'edited.yaml'
    for provenance in (
        {},
        {'recordings': 3},
        {'temperature_topics': 'a'},
        {'created': yaml.safe_load('2024-05-01')},
    ):
        copy.write_text(yaml.safe_dump({**document, 'provenance': provenance}))
        assert 'a drift model' in done('show', copy)
        json.loads(done('show', copy, '--json'))


def test_a_csv_says_its_channels(done, drift_csv):
    out = done('show', drift_csv)
    assert out.startswith('drift.csv: CSV recording, 399.0 s')
    assert 'raw wrench' in out
    assert re.search(r'temperature_c +°C, 20\.\d to 3\d\.\d', out)
    shown = json.loads(done('show', drift_csv, '--json'))
    torque = {'name': 'torque_x', 'role': 'raw wrench', 'kind': 'N m', 'samples': 400}
    torque['reads'] = None
    assert torque in shown['channels']
    assert shown['last_ns'] - shown['first_ns'] == 399 * 10**9


def test_a_recording_says_what_to_do_with_it(done, drift_csv, make, tmp_path):
    assert f'wrist_ft_comp calibrate {drift_csv} -o model.yaml' in done('show', drift_csv)
    loaded = make.csv(tmp_path / 'loaded.csv', make.loaded())
    assert done('show', loaded).rstrip().endswith('--reference recorded')
    assert re.search(r' 400 +1 +raw wrench', done('show', drift_csv))  # samples, per second


def test_a_recording_says_what_it_lacks(done, make, tmp_path):
    path = make.csv(tmp_path / 'run.csv', {'stamp_s': [0.0, 1.0], 'force_x': [1.0, 2.0]})
    out = done('show', path)
    assert 'It holds no temperature, so nothing can be learnt from it.' in out
    assert 'calibrate' not in out


def test_a_bag_says_which_topic_may_be_meant(done, bags):
    out = done('show', bags['mcap'], '--wrench-topic', '/other')
    words = f'wrist_ft_comp calibrate {bags["mcap"]} -o model.yaml --report model.html\n'
    assert words in out, 'the one there is has the name that is taken anyway'


def test_a_bag_without_wrenches_names_no_topic_that_would_not_help(done, messages, tmp_path):
    part = ('/motor/heat', messages.temperature_type, 1, messages.temperature(1, 20.0))
    out = done('show', messages.write(tmp_path / 'bag', [part])).rstrip()
    assert out.endswith(
        'It holds no raw wrench in a form that can be read, so nothing can be learnt from it.'
    )


def test_a_report_is_known(done, drift_csv, model, tmp_path):
    page = tmp_path / 'r.html'
    done('evaluate', model, drift_csv, '--report', page)
    assert 'open it in a browser' in done('show', page)
    assert json.loads(done('show', page, '--json'))['kind'] == 'report'


def accelerated(make, tmp_path, force):
    """A CSV recording with a specific force, one row per second."""
    columns = dict(zip('xyz', np.transpose(force).tolist(), strict=True))
    return make.csv(
        tmp_path / 'work.csv',
        {
            'stamp_s': list(range(len(force))),
            'force_z': [0.0] * len(force),
            'temperature_c': [20.0] * len(force),
            **{f'linear_acceleration_{axis}': column for axis, column in columns.items()},
            'rotation_speed': [0.1] * len(force),
        },
    )


def test_a_recording_says_which_directions_gravity_had(done, make, tmp_path):
    path = accelerated(make, tmp_path, np.repeat(9.8 * np.eye(3), 5, axis=0))
    out = done('show', path)
    assert re.search(r'linear_acceleration_x +m/s² .* specific force', out)
    assert re.search(r'rotation_speed +rad/s .* specific force', out)
    assert out.endswith('-o model.yaml --reference payload\n')
    assert 'norm 9.8 m/s²; along three directions gravity moved by 5.66, 5.66, 0.00' in out
    assert 'two of them were seen' in out
    assert 'A payload needs' not in out
    shown = json.loads(done('show', path, '--json'))['specific_force']
    np.testing.assert_allclose(shown['spread'], [9.807 / 3**0.5, 9.807 / 3**0.5, 0], atol=1e-6)


def test_a_recording_of_one_pose_says_that_no_payload_can_be_told(done, make, tmp_path):
    out = done('show', accelerated(make, tmp_path, np.repeat([[0.0, 0.0, 9.8]], 9, axis=0)))
    assert 'none of them were seen' in out
    assert 'let the robot tilt the tool about two axes' in out


def test_payloads_are_listed_by_name_and_an_error_that_is_unknown_is_null(run, tmp_path):
    file = tmp_path / PAYLOADS
    known = Payload(1.4, np.array([0.0, 0.01, 0.1]), 0.01, np.full(3, 0.001), 0.5)
    add_payloads(file, 'tool', [known, Payload(2.0, np.zeros(3))], ForceFrame())
    shown = run('show', file).out
    assert (
        'tool-1: 1.400 ± 0.01 kg, centre of mass at 0.0, 10.0, 100.0 mm (± 1), on for 50%' in shown
    )
    assert 'of the time' not in shown.partition('tool-2')[2]
    one, two = json.loads(run('show', file, '--json').out)['payloads']
    assert (one['name'], one['mass_kg'], two['mass_error_kg']) == ('tool-1', 1.4, None)
