"""What show says of a model, a recording, payloads, and the days of a node; and its tables."""

from itertools import combinations
import json
from math import nan
import re

from matplotlib.backends.backend_agg import FigureCanvasAgg
import numpy as np
import pytest
import yaml

from wrist_ft_comp.learning import days
from wrist_ft_comp.payload.weight import ForceFrame, Payload
from wrist_ft_comp.report.pictures import days_figure
from wrist_ft_comp.stored.node_folder import HistoryEntry, NodeFolder
from wrist_ft_comp.stored.payload_file import add_payloads, PAYLOADS


def test_a_model_says_what_it_is_and_what_it_is_for(done, model):
    out = done('show', model)
    for words in ('force_z', 'torque_x', 'N m', 'pls', 'calibrated from 20', str(model)):
        assert words in out
    assert 'how a wrist force/torque sensor drifts' in out
    assert max(len(line) for line in out.splitlines() if str(model) not in line) <= 80
    shown = json.loads(done('show', model, '--json'))
    assert len(shown.pop('sha256')) == 64
    assert shown == yaml.safe_load(model.read_text())


def test_a_model_whose_provenance_was_edited_is_shown(done, model, tmp_path):
    document, copy = yaml.safe_load(model.read_text()), tmp_path / 'edited.yaml'
    date = yaml.safe_load('2024-05-01')
    for provenance in ({}, {'recordings': 3}, {'temperature_topics': 'a'}, {'created': date}):
        copy.write_text(yaml.safe_dump({**document, 'provenance': provenance}))
        assert 'a drift model' in done('show', copy)
        json.loads(done('show', copy, '--json'))


def test_a_csv_says_its_channels_and_what_to_do_with_it(done, drift_csv, make, tmp_path):
    out = done('show', drift_csv)
    assert out.startswith('drift.csv: table, 399.0 s')
    assert re.search(r'temperature_c +°C, 20\.\d to 3\d\.\d', out)
    assert re.search(r' 400 +1 +raw wrench', out)  # samples, per second
    assert f'wrist_ft_comp calibrate {drift_csv} -o drift.yaml' in out
    shown = json.loads(done('show', drift_csv, '--json'))
    torque = {'name': 'torque_x', 'role': 'raw wrench', 'kind': 'N m', 'samples': 400}
    assert {**torque, 'reads': None} in shown['channels']
    assert shown['last_ns'] - shown['first_ns'] == 399 * 10**9
    loaded = make.csv(tmp_path / 'loaded.csv', make.loaded())
    assert done('show', loaded).rstrip().endswith('--reference recorded')


def test_a_bag_without_wrenches_names_no_topic_that_would_not_help(done, messages, tmp_path):
    part = ('/motor/heat', messages.temperature_type, 1, messages.temperature(1, 20.0))
    out = done('show', messages.write(tmp_path / 'bag', [part]))
    assert 'holds no raw wrench in a form that can be read, so nothing' in out


def test_a_recording_of_one_pose_says_that_it_shows_no_payload(done, make, tmp_path):
    columns = {
        'stamp_s': range(9), 'force_z': [0.0] * 9, 'temperature_c': [20.0] * 9,
        **{f'linear_acceleration_{axis}': [9.8 * (axis == 'z')] * 9 for axis in 'xyz'},
        'rotation_speed': [0.1] * 9,
    }  # fmt: skip
    out = done('show', make.csv(tmp_path / 'work.csv', columns))
    assert re.search(r'linear_acceleration_x +m/s² .* specific force', out)
    assert re.search(r'rotation_speed +rad/s .* specific force', out)
    assert '0 of 3 directions; a payload needs 2: tilt the tool about' in ' '.join(out.split())


def test_payloads_are_listed_by_name_and_an_error_that_is_unknown_is_null(run, tmp_path):
    file = tmp_path / PAYLOADS
    tool = Payload(1.4, np.array([0.0, 0.01, 0.1]), 0.01, np.full(3, 0.001), 0.5)
    add_payloads(file, 'tool', [tool, Payload(2.0, np.zeros(3))], ForceFrame())
    shown = run('show', file).out
    said = 'tool-1: 1.400 ± 0.01 kg, centre of mass at 0.0, 10.0, 100.0 mm (± 1), on for 50%'
    assert said in shown
    assert 'of the time' not in shown.partition('tool-2')[2]
    one, two = json.loads(run('show', file, '--json').out)['payloads']
    assert (one['name'], one['mass_kg'], two['mass_error_kg']) == ('tool-1', 1.4, None)


DAY = 86_400 * 10**9
START = 1_770_000_000 * 10**9


@pytest.fixture
def folder(tmp_path):
    """A node's folder with three days, one of them hit."""
    folder = tmp_path / 'left'
    left = {'none': (3.0,) * 6, 'abc': (0.3,) * 6, 'challenger': (0.2,) * 6}
    entries = (
        days.DayEntry(
            'day_00001.csv', START, 24.0, ((18.0, 25.0),), left=left, live='abc',
            verdict='the challenger is better by chance only'),
        days.DayEntry(
            'day_00002.csv', START + DAY, 23.5, ((24.0, 29.0),),
            left={'none': (4.0, nan, nan, nan, nan, nan)}, live='abc',
            incident='zero of force_z jumped by 4.1 N at 13:02', kind='zero'),
        days.DayEntry('day_00004.csv', START + 3 * DAY, 9.0, ((35.0, 40.0),), verdict='all well'),
    )  # fmt: skip
    days.save_diary(folder, days.Diary(entries, paused='zero of force_z jumped'))
    days.save_memory(folder, days.Memory(offered='m.yaml'))
    adopted = HistoryEntry(
        folder / 'models/model_x.yaml', since='2026-05-02T06:00:00+00:00',
        why='model_x.yaml was adopted', day='day_00001.csv',
    )  # fmt: skip
    NodeFolder(folder).activate([adopted])
    return folder


def test_days_are_summed_up_and_what_happened_is_listed(done, folder):
    text = done('show', folder)
    lines = text.splitlines()
    assert lines[0].startswith(f'{folder}: days of a node that learns, 3')
    for words in (
        '3 days, 2026-02-02 to 2026-02-05: on a usual day a force drifted by 3 N (RMS);',
        '2026-02-03 zero of force_z jumped by 4.1 N at 13:02',
        'day_00004.csv: all well',
        '2026-05-02 model_x.yaml was adopted', 'last change: 2026-05-02',
        'offered: m.yaml', 'paused: zero of force_z jumped',
    ):  # fmt: skip
        assert words in ' '.join(text.split())
    assert max(map(len, lines[1:])) <= 80
    (document,) = json.loads(done('show', folder, '--json')).values()
    first, second = document['days'][:2]
    assert first['left']['abc'] == [0.3] * 6
    assert second['left']['none'][1] is None
    assert document['summary'].endswith('by 3 N (RMS); the model left 0.3 N (10 %).')
    assert document['paused'] == 'zero of force_z jumped'


def test_a_day_without_a_date_goes_by_its_name(done, folder):
    days.save_diary(folder, days.Diary((days.DayEntry('day_00006.csv'),)))
    assert '1 day, day_00006: none is judged yet.' in done('show', folder)


def test_what_happened_is_listed_by_date_a_learnt_model_once(done, tmp_path):
    model, learnt = tmp_path / 'a.yaml', {'how': 'learnt', 'day': 'day_00002.csv'}
    history = [
        HistoryEntry(None),
        HistoryEntry(model, since='2026-02-04T06:00:00', why='a.yaml is live', **learnt),
    ]
    NodeFolder(tmp_path).activate(history)
    entries = (
        days.DayEntry('day_00001.csv', START, better='b.yaml', verdict='It is better.'),
        days.DayEntry('day_00002.csv', START + DAY, better='a.yaml', incident='It was hit.'),
    )
    days.save_diary(tmp_path, days.Diary(entries))
    said = done('show', tmp_path).partition('What happened:\n')[2].splitlines()
    assert said[:3] == [
        '2026-02-02  b.yaml was learnt. It is better.', '2026-02-03  It was hit.',
        '2026-02-04  a.yaml is live',
    ]  # fmt: skip


@pytest.mark.parametrize('count', [1, 5, 365])
def test_no_label_of_a_picture_lies_on_another_or_outside(count):
    dates = [f'day_{number:05d}' for number in range(count)]
    figure = days_figure('They drifted.', dates, np.full((count, 2), nan))
    FigureCanvasAgg(figure).draw()
    whole = figure.bbox
    for panel in figure.axes:
        texts = [label for label in panel.get_xticklabels() if label.get_text()]
        boxes = [text.get_window_extent() for text in texts]
        assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
        assert all(whole.x0 <= box.x0 and box.x1 <= whole.x1 for box in boxes)


@pytest.mark.parametrize('content', [None, '{', '{"format": "other"}'])
def test_without_a_diary_there_is_a_sentence(run, folder, content):
    path = days.diary_path(folder)
    path.unlink() if content is None else path.write_text(content)
    said = f'{folder} holds no days that were' if content is None else f'{path} is not a diary'
    assert said in run('show', folder).sentence
