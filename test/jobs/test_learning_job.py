"""A learning job: it judges the newest day, learns from all, and leaves files that load."""

import json
from pathlib import Path
import shutil

import numpy as np
import pytest

from wrist_ft_comp.channels import AXES, FORCE_CHANNELS
from wrist_ft_comp.cli.main import main
from wrist_ft_comp.drift.drift_model import run_from_rest
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.jobs import job_main
from wrist_ft_comp.jobs.job_process import CalibrationJob
from wrist_ft_comp.learning.days import day_files, diary_path, LARGEST_BYTES, load_diary
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.node_folder import HistoryEntry, NodeFolder
from wrist_ft_comp.stored.payload_file import load_payloads

QUICK = CalibrationSettings('payload', identification=IdentificationSettings('pls', degree=1))
CELLS, PERIOD_S = 300, 4.0
pytestmark = pytest.mark.usefixtures('without_pictures')
COLUMNS = 'stamp_s', *AXES, 'temperature_c', *FORCE_CHANNELS


def write_day(directory, number, cells=CELLS, *, parked_s=None):
    """Write a day of a kilogram that turns; one that parks has half a one more now and then."""
    rng = np.random.default_rng(number)
    warm = 20 + rng.uniform(0, 4) + 10 * (1 - np.exp(-np.arange(cells) / rng.uniform(60, 200)))
    pose = np.repeat(rng.normal(size=(cells // 3, 3)), 3, axis=0)
    seconds = PERIOD_S * (np.arange(cells) + 0.5)
    parked = (seconds > 1000) & (seconds < 1000 + (parked_s or 0))
    pose[parked] = (0.3, 0.2, -0.9)
    force = 9.807 * pose / np.linalg.norm(pose, axis=1, keepdims=True)
    held = (parked_s is not None) * ((seconds // 60 % 2 == 1) | parked)[:, np.newaxis]
    push = -force * (1 + 0.5 * held)
    raw = np.concatenate((push, np.cross((0.0, 0.0, 0.1) + 0.03 * held, push)), axis=1)
    drift = np.array([1, -1, 0.5, 0.05, 0.03, -0.02]) * (0.4 * warm[:, None] + rng.normal(size=6))
    raw += rng.normal(0, 0.01, raw.shape) * np.array([1, 1, 1, 0.05, 0.05, 0.05])
    raw += drift
    warm += rng.normal(0, 0.01, cells)
    rows = np.column_stack((86_400.0 * number + seconds, raw, warm, force))
    path = directory / 'days' / f'day_{number:05d}.csv'
    path.parent.mkdir(exist_ok=True)
    write_rows(path, rows)
    return path


def write_rows(path, rows):
    np.savetxt(path, rows, '%.9g', ',', header=','.join(COLUMNS), comments='')


@pytest.fixture(scope='module')
def sensor(tmp_path_factory):
    directory = tmp_path_factory.mktemp('sensor')
    for number in (1, 2, 3):
        write_day(directory, number)
    return directory


def job_of(directory, count, *history, report=False, **more):
    models = directory / 'models'
    return CalibrationJob(
        tuple(day_files(directory)[:count]), models / f'model_{count}.yaml', QUICK, PERIOD_S,
        report=models / f'model_{count}.html' if report else None,
        history=history, **more)  # fmt: skip


@pytest.fixture(scope='module')
def answers(sensor):
    return [job_main.answer(job_of(sensor, count, report=True)) for count in (1, 2)]


def test_days_give_a_model_a_report_and_a_diary(sensor, answers):
    first, second = answers
    assert (first['success'], first['learnt'], first['paused']) == (True, False, '')
    assert first['incident'] == ''
    assert (second['success'], second['learnt'], second['paused']) == (True, True, '')
    assert 'It is better' in second['message']
    assert 'To make it better: ' in second['message']
    stored = load_model(second['path'])
    assert stored.sha256 == second['sha256']
    provenance = stored.document['provenance']
    sources = [Path(source['path']).name for source in provenance['recordings']]
    assert sources == ['day_00001.csv', 'day_00002.csv']
    assert provenance['settings']['reference'] == 'payload'
    ((payload, _),) = load_payloads(stored.path.with_name('payloads.json')).values()
    assert payload.mass_kg == pytest.approx(1.0, rel=0.03)
    report = stored.path.with_suffix('.html').read_text()
    assert all(name in report for name in sources)
    diary = load_diary(sensor)
    assert [day.name for day in diary.days] == sources
    assert [day.better for day in diary.days] == ['', stored.path.name]
    by_new, none = (np.array(diary.days[1].left[key]) for key in ('challenger', 'none'))
    assert (by_new < 0.3 * none).all(), 'what a fit to the other days left'


def test_a_lost_diary_is_made_anew_beside_a_live_model(sensor, answers, tmp_path):
    lost = shutil.copytree(sensor, tmp_path / 'lost')
    champion = lost / 'models' / Path(answers[1]['path']).name
    broken = diary_path(lost).read_text()[:-300]
    diary_path(lost).write_text(broken)
    chosen = HistoryEntry(champion, why='a person chose m.yaml', day='day_00001.csv')
    again = job_main.answer(job_of(lost, 3, HistoryEntry(None), chosen))
    assert again['success']
    assert 'diary.json is not a diary: expected JSON' in again['incident']
    assert (lost / 'days/diary.json.kept').read_text() == broken
    diary = load_diary(lost)
    assert len(diary.days) == 3
    live = load_model(champion).sha256[:12]
    assert [day.live for day in diary.days] == ['', live, live]
    assert all(np.isfinite(day.left[live]).all() for day in diary.days[1:])
    assert 'the live model left 0.0' in again['message']


def test_an_impossible_job_is_a_sentence_and_changes_nothing(sensor, answers, tmp_path):
    assert answers[0]['success']
    before = diary_path(sensor).read_bytes()
    broken = job_main.answer(job_of(sensor, 3, HistoryEntry(tmp_path / 'gone.yaml')))
    assert not broken['success']
    assert 'gone.yaml cannot be read' in broken['message']
    assert diary_path(sensor).read_bytes() == before


@pytest.fixture
def own_days(tmp_path):
    for number in (1, 2):
        write_day(tmp_path, number)
    return tmp_path


def test_foreign_files_among_days_are_one_sentence_per_file(own_days):
    folder = own_days / 'days'
    write_day(own_days, 1).rename(folder / 'day_1.csv')
    write_day(own_days, 1)
    (folder / 'day_00003.csv').symlink_to('nowhere')
    (folder / 'day_00004.csv').symlink_to('/dev/zero')
    (folder / 'day_00005.csv').mkdir()
    with (folder / 'day_00006.csv').open('wb') as file:
        file.truncate(50 * LARGEST_BYTES)
    write_day(own_days, 7)
    job = job_of(own_days, 9)
    assert [path.name[:9] for path in job.recordings] == [f'day_0000{n}' for n in range(1, 8)]
    answer = job_main.answer(job)
    assert (answer['success'], answer['learnt']) == (True, True), answer['message']
    entries = load_diary(own_days).days
    assert [day.kind for day in entries] == ['', '', *4 * ['unreadable'], '']
    assert all('Move it away' in day.incident for day in entries[2:6])
    assert (folder / 'day_1.csv').exists()


def test_a_better_model_outlives_broken_payloads_and_a_diary_that_is_none(own_days):
    (own_days / 'models').mkdir()
    (own_days / 'models/payloads.json').write_text('{')
    (own_days / 'days/diary.json').mkdir()
    answer = job_main.answer(job_of(own_days, 2))
    assert (answer['success'], answer['learnt']) == (True, True)
    assert 'payloads.json' in answer['incident']
    assert 'diary.json' in answer['incident']
    assert load_model(answer['path']).sha256 == answer['sha256']


@pytest.mark.parametrize(('pause_s', 'rests'), [(0, False), (3 * 3600, True)])
def test_a_day_that_goes_on_is_judged_as_the_model_ran(tmp_path, make_model, save, pause_s, rests):
    """A sensor that lags by 20 min is hot when its day is cut: the file does not begin at rest."""
    model = make_model({'force_z': (1.0, 0.0, 1200.0)}, period_s=PERIOD_S)
    live = save(tmp_path / 'models/live.yaml', model)
    warm = 20 + 20 * (1 - np.exp(-np.arange(2 * CELLS) / 60))
    drift = run_from_rest(model, warm[:, np.newaxis])[1].zero[:, 2]
    for number, part in ((1, slice(CELLS)), (2, slice(CELLS, None))):
        path = write_day(tmp_path, number)
        rows = np.loadtxt(path, delimiter=',', skiprows=1)
        rows[:, 3] += drift[part] - 0.5 * 0.4 * rows[:, 7]
        rows[:, 7], rows[:, 0] = warm[part], PERIOD_S * (np.arange(2 * CELLS)[part] + 0.5)
        rows[:, 0] += pause_s * (number - 1)
        write_rows(path, rows)
    assert job_main.answer(job_of(tmp_path, 2, HistoryEntry(live.path)))['success']
    left = load_diary(tmp_path).days[1].left[live.sha256[:12]][2]
    assert (left > 0.2) == rests, left


@pytest.mark.parametrize(
    ('parked_s', 'kind', 'said'), [(900, '', ''), (9900, 'contacts', 'is parked with a part')]
)
def test_a_robot_parked_with_a_part_has_no_jump_of_its_zero(tmp_path, parked_s, kind, said):
    write_day(tmp_path, 1, 2700, parked_s=parked_s)
    answer = job_main.answer(job_of(tmp_path, 1))
    assert said in answer['incident']
    assert answer['paused'] == ''
    assert load_diary(tmp_path).days[0].kind == kind


def test_an_axis_that_was_dead_on_the_first_day_is_learnt(own_days):
    path = own_days / 'days/day_00001.csv'
    rows = np.loadtxt(path, delimiter=',', skiprows=1)
    rows[:, COLUMNS.index('torque_z')] = 0.125
    write_rows(path, rows)
    answer = job_main.answer(job_of(own_days, 2))
    assert (answer['success'], answer['learnt']) == (True, True), answer['message']
    assert 'torque_z' in load_model(answer['path']).model.axes


def test_a_day_is_judged_with_the_model_that_ran_until_a_person_ended_it(tmp_path, capsys):
    for number in range(1, 7):
        write_day(tmp_path, number)
    answer = job_main.answer(job_of(tmp_path, 2))
    offered = Path(answer['path'])
    other = offered.with_name('other.yaml')
    other.write_bytes(offered.read_bytes() + b'# another one')
    first, second = (load_model(path).sha256[:12] for path in (offered, other))
    adopted, back, gone = 'day_00003.csv', 'day_00005.csv', offered.with_name('gone.yaml')
    history = [HistoryEntry(None), HistoryEntry(offered, why='adopted', day=adopted)]
    assert job_main.answer(job_of(tmp_path, 4, *history))['success']
    history.append(HistoryEntry(other, why='other chosen', how='back', day=back))
    assert job_main.answer(job_of(tmp_path, 6, *history))['success']
    NodeFolder(tmp_path).activate(history)
    assert main(['show', str(tmp_path), '--json']) == 0
    (said,) = json.loads(capsys.readouterr().out).values()
    assert [day['live'] for day in said['days']] == ['', '', '', first, first, second]
    diary_path(tmp_path).unlink()
    lost = [HistoryEntry(gone), HistoryEntry(other, day=back)]
    assert job_main.answer(job_of(tmp_path, 6, *lost))['success']
    day = load_diary(tmp_path).days[4]
    assert (day.live, 'cannot be judged' in day.verdict) == ('gone.yaml', True)
