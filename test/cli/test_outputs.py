"""What a command writes takes the place of nothing but its predecessor."""

import json
import os
import shutil

import pytest

from wrist_ft_comp.cli import demo
from wrist_ft_comp.learning.day_files import DayFiles

PNG = b'\x89PNG\r\n\x1a\n' + b'\0\0\0\rIHDR' + bytes(40)


@pytest.fixture
def day(drift_csv, tmp_path):
    """A recording of the user's own, which may be harmed."""
    return shutil.copy(drift_csv, tmp_path / 'day_1.csv')


@pytest.fixture
def own_model(model, tmp_path):
    return shutil.copy(model, tmp_path / 'model.yaml')


@pytest.fixture
def folder(tmp_path):
    """The data_directory of a node with a day."""
    files = DayFiles(tmp_path / 'node', ('force_x', 'temperature_c'), 1e9, '')
    for hour in range(13):
        files.append((1_770_000_000 + hour * 3600) * 10**9, (1.0, 20.0))
    files.close()
    return tmp_path / 'node'


def contents(folder):
    return {path: path.is_file() and path.read_bytes() for path in folder.rglob('*')}


def foreign(tmp_path, day, own_model):
    """Whatever is neither report nor picture of this package's."""
    (tmp_path / 'notes.txt').write_text('do not lose')
    (tmp_path / 'page.html').write_text('<html>of somebody else</html>')
    (tmp_path / 'photo.png').write_bytes(PNG)
    (tmp_path / 'bag.mcap').write_bytes(b'\x89MCAP0\r\n')
    (tmp_path / 'dangling.html').symlink_to(tmp_path / 'nothing')
    os.link(day, tmp_path / 'hard.html')
    (tmp_path / 'link.html').symlink_to(own_model)
    names = 'notes.txt', 'page.html', 'photo.png', 'bag.mcap', 'dangling.html', 'hard.html'
    return [day, own_model, *(tmp_path / name for name in (*names, 'link.html')), '/dev/null']


def test_neither_report_nor_picture_takes_another_s_place(run, day, own_model, folder, tmp_path):
    for target in foreign(tmp_path, day, own_model):
        before = contents(tmp_path)
        for words in (
            ['calibrate', day, '-o', tmp_path / 'new.yaml', '--report', target],
            ['evaluate', own_model, day, '--report', target],
            ['show', folder, '--picture', target],
        ):
            assert 'cannot be written: it is' in run(*words).sentence.replace('exists and ', '')
            assert contents(tmp_path) == before, target


def test_the_demo_looks_before_it_starts_a_process(run, tmp_path, monkeypatch):
    monkeypatch.setattr(demo, 'find_spec', lambda _: object())
    monkeypatch.setattr(demo, 'play', pytest.fail)
    (tmp_path / 'demo.png').write_bytes(PNG)
    assert 'demo.png cannot be written: it exists' in run('demo', '--output', tmp_path).sentence
    assert (tmp_path / 'demo.png').read_bytes() == PNG


@pytest.mark.parametrize('spelling', ['{0}', '{0.parent}/../{0.parent.name}/{0.name}', 'link'])
@pytest.mark.parametrize('option', ['-o', '--report'])
def test_an_input_is_no_output_however_it_is_spelt(option, spelling, run, day, tmp_path):
    day = tmp_path / day.name
    day.write_text('')  # an empty file may be replaced, but not one that is to be read
    target = spelling.format(day)
    if spelling == 'link':
        target = tmp_path / 'other'
        os.link(day, target)
    more = [] if option == '-o' else ['-o', tmp_path / 'm.yaml']
    assert 'is the same file as' in run('calibrate', day, option, target, *more).sentence


@pytest.mark.parametrize(
    ('option', 'name'),
    [('-o', 'm.csv'), ('-o', 'm.html'), ('--report', 'r.mcap'), ('--report', 'r.yaml')],
)
def test_a_name_that_promises_something_else_is_refused(option, name, run, drift_csv, tmp_path):
    more = [] if option == '-o' else ['-o', tmp_path / 'm.yaml']
    target = tmp_path / name
    assert f'not in {target.suffix}' in run('calibrate', drift_csv, option, target, *more).sentence
    assert not list(tmp_path.iterdir())


@pytest.fixture
def recordings(drift_csv, bags, monkeypatch):
    """A recording of each kind, which is not to be read."""
    monkeypatch.setattr('wrist_ft_comp.cli.compensate.read_recording', pytest.fail)
    return {'csv': drift_csv, **bags}


@pytest.mark.parametrize('case', ['csv .mcap', 'mcap .csv', 'mcap .db3', 'sqlite3 .mcap'])
def test_a_copy_is_of_the_kind_that_its_name_promises(case, run, recordings, model, tmp_path):
    kind, ending = case.split()
    target = tmp_path / f'out{ending}'
    outcome = run('compensate', model, recordings[kind], '-o', target)
    assert f'not in {ending}' in outcome.sentence
    assert not list(tmp_path.iterdir())


def test_what_stands_in_the_way_of_a_copy_is_seen_first(run, recordings, model, tmp_path):
    (tmp_path / 'empty.csv').touch()
    csv, bag = recordings['csv'], recordings['mcap']
    for words, reason in (
        ([csv, '-o', tmp_path], 'it is a folder'),
        ([csv, '-o', csv], 'it is the same file as'),
        ([csv, '-o', model], 'it is the same file as'),
        ([csv, '-o', tmp_path / 'empty.csv'], 'it exists'),
        ([bag, '-o', tmp_path / 'o', '--output-topic', '/wrench_raw'], 'holds /wrench_raw'),
    ):
        assert reason in run('compensate', model, *words).sentence


def test_a_predecessor_and_an_empty_file_are_replaced(done, model, drift_csv, folder, tmp_path):
    report, picture, again = tmp_path / 'r.html', tmp_path / 'p.png', tmp_path / 'm.csv'
    report.touch()
    picture.touch()
    shutil.copy(model, again)  # a model by its content, whatever it is called
    for _ in range(2):
        done('evaluate', model, drift_csv, '--report', report)
        done('show', folder, '--picture', picture)
        done('calibrate', drift_csv, '-o', again, '--method', 'pls')
    assert report.read_text().startswith('<!doctype html>')
    assert picture.read_bytes().startswith(PNG[:8])


def test_a_foreign_payloads_json_is_seen_before_the_work(run, drift_csv, tmp_path):
    (tmp_path / 'payloads.json').write_text(json.dumps({'of': 'another program'}))
    words = ['-o', tmp_path / 'm.yaml', '--reference', 'payload']
    assert 'payloads.json' in run('calibrate', drift_csv, *words).sentence
    assert len(list(tmp_path.iterdir())) == 1
