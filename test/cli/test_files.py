"""The files that a command is given: what it refuses, what it may write, what an option is for."""

import json
import os
import re
import shutil

import pytest

from wrist_ft_comp.cli import options
from wrist_ft_comp.learning.days import DayEntry, Diary, save_diary

PNG = b'\x89PNG\r\n\x1a\n' + b'\0\0\0\rIHDR' + bytes(40)


@pytest.mark.parametrize('command', ['calibrate', 'evaluate', 'evaluate by', 'compensate', 'show'])
@pytest.mark.parametrize('name', ['missing.csv', 'missing', 'x' * 300, '/dev/zero'])
def test_a_missing_file_and_a_device_are_named(command, name, run, model, drift_csv, tmp_path):  # noqa: PLR0913, PLR0917
    path = tmp_path / name
    argv = {
        'calibrate': [path, '-o', tmp_path / 'm.yaml'],
        'evaluate': [model, path],
        'evaluate by': [path, drift_csv],
        'compensate': [model, path, '-o', tmp_path / 'out'],
        'show': [path],
    }[command]
    sentence = run(command.split()[0], *argv).sentence
    assert name[:200] in sentence
    made = 'ros2 bag record -s mcap -o warm_up /wrench_raw /temperature'
    is_recording = command != 'evaluate by'
    assert (made in sentence) == (is_recording and name.startswith('missing'))
    assert ('is no file and no folder' in sentence) == (is_recording and name == '/dev/zero')
    assert not list(tmp_path.iterdir())


def test_a_name_that_is_no_text_costs_no_model(done, drift_csv, tmp_path):
    path = shutil.copy(drift_csv, tmp_path / os.fsdecode(b'l\xff.csv'))
    done('calibrate', path, '-o', tmp_path / 'm.yaml', '--method', 'pls')
    assert 'l?.csv' in (tmp_path / 'm.yaml').read_text()


def test_a_folder_is_no_file(run, day):
    assert '.+other.csv does not exist' in run('show', '.+other.csv').sentence
    words = ['calibrate', day, '-o', '.', '--reference', 'payload']
    assert '. cannot be written: it is a folder' in run(*words).sentence


@pytest.mark.parametrize('command', ['evaluate', 'compensate'])
def test_model_and_recording_exchanged_are_refused(command, run, model, drift_csv, bags, tmp_path):  # noqa: PLR0913, PLR0917
    more = ['-o', tmp_path / 'out'] if command == 'compensate' else []
    assert f'{drift_csv} is not a model file' in run(command, drift_csv, model, *more).sentence
    (tmp_path / 'empty').touch()
    files = bags['mcap'], bags['mcap'] / 'mcap.mcap', bags['sqlite3'] / 'sqlite3.db3'
    for recording in (drift_csv, tmp_path / 'empty', *files):
        sentence = run(command, recording, drift_csv, *more).sentence
        assert 'with wrist_ft_comp calibrate.' in sentence
        assert str(recording) in sentence


@pytest.fixture
def day(drift_csv, tmp_path):
    """A recording of the user's own, which may be harmed."""
    return shutil.copy(drift_csv, tmp_path / 'day_1.csv')


@pytest.fixture
def own_model(model, tmp_path):
    return shutil.copy(model, tmp_path / 'model.yaml')


@pytest.fixture
def folder(tmp_path):
    (tmp_path / 'node/days').mkdir(parents=True)
    save_diary(tmp_path / 'node', Diary((DayEntry('day_00001.csv'),)))
    return tmp_path / 'node'


def contents(folder):
    return {path: path.is_file() and path.read_bytes() for path in folder.rglob('*')}


#: Whatever is none of ours, though some quote a file of ours, at their beginning or further on.
FOREIGN = {
    'page.html': '<html>of somebody else</html>',
    'photo.png': PNG.decode('latin-1'),
    'bag.mcap': '\x89MCAP0\r\n',
    'notes.md': '# Models\n\nEach begins with\n\nformat: wrist_ft_comp drift model\nversion: 2\n',
    'first.md': 'format: wrist_ft_comp drift model\nversion: 2\n\nis how each model begins.\n',
    'other.yaml': 'of: me\nsays: |\n  format: wrist_ft_comp drift model\n  version: 2\n',
    'quote.html': '<!doctype html>\n&lt;meta name="generator" content="wrist_ft_comp report">',
    'head.html': '<html><head><meta name="author" content="me">\n'
    '<meta name="generator" content="wrist_ft_comp report"></head></html>',
    'text.png': (PNG + b'tEXtComment\0Software\0wrist_ft_comp picture').decode('latin-1'),
}


def test_nothing_of_ours_takes_the_place_of_another_file(run, day, own_model, folder, tmp_path):
    for name, text in FOREIGN.items():
        (tmp_path / name).write_bytes(text.encode('latin-1'))
    (tmp_path / 'dangling.html').symlink_to(tmp_path / 'nothing')
    os.link(day, tmp_path / 'hard.html')
    (tmp_path / 'link.html').symlink_to(own_model)
    names = *FOREIGN, 'dangling.html', 'hard.html', 'link.html'
    for target in (day, own_model, *(tmp_path / name for name in names), '/dev/null'):
        before = contents(tmp_path)
        commands = [
            ['calibrate', day, '-o', tmp_path / 'new.yaml', '--report', target],
            ['evaluate', own_model, day, '--report', target],
            ['show', folder, '--picture', target],
        ]
        if getattr(target, 'name', '') in FOREIGN:
            commands.append(['calibrate', day, '--method', 'pls', '-o', target])
        for words in commands:
            assert re.search('cannot be written: it |not in [.]', run(*words).sentence)
            assert contents(tmp_path) == before, target


@pytest.mark.parametrize('place', ['report', 'folder'])
def test_the_demo_looks_before_it_starts_a_process(place, run, tmp_path, monkeypatch):
    monkeypatch.setattr(options, 'find_spec', lambda _: object())
    monkeypatch.setattr('wrist_ft_comp.cli.demo.play', pytest.fail)
    path = tmp_path / ('demo.html' if place == 'report' else 'file')
    path.write_bytes(PNG)
    output, words = (tmp_path, 'it exists') if place == 'report' else (path, 'File exists')
    assert words in run('demo', '--output', output).sentence
    assert path.read_bytes() == PNG
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_does_not_exist_is_not_made(run, day, own_model, folder, tmp_path):
    target = tmp_path / 'mistyped'
    for words in (
        ['calibrate', day, '-o', target / 'm.yaml'],
        ['calibrate', day, '-o', tmp_path / 'm.yaml', '--report', target / 'r.html'],
        ['evaluate', own_model, day, '--report', target / 'r.html'],
        ['compensate', own_model, day, '-o', target / 'c.csv'],
        ['show', folder, '--picture', target / 'p.png'],
    ):
        assert f'{target} is no folder; make it first' in run(*words).sentence
        assert not target.exists()


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


@pytest.fixture
def recordings(drift_csv, bags, monkeypatch):
    """A recording of each kind, which is not to be read."""
    monkeypatch.setattr('wrist_ft_comp.cli.compensate.read_recording', pytest.fail)
    return {'csv': drift_csv, **bags}


@pytest.mark.parametrize(
    'case', ['csv -o m.csv', 'csv -o m.html', 'csv --report r.mcap', 'csv --report r.yaml',
             'csv copy o.mcap', 'mcap copy o.csv', 'mcap copy o.mcap', 'sqlite3 copy o.mcap'],
)  # fmt: skip
def test_a_name_that_promises_something_else_is_refused(case, run, recordings, model, tmp_path):
    kind, option, name = case.split()
    more = ['-o', tmp_path / 'm.yaml'] if option == '--report' else []
    argv = ['calibrate', recordings[kind], *more, option, tmp_path / name]
    if option == 'copy':
        argv = ['compensate', model, recordings[kind], '-o', tmp_path / name]
    assert f'not in .{name.partition(".")[2]}' in run(*argv).sentence
    assert not list(tmp_path.iterdir())


def test_obstacles_of_a_copy_are_found_before_the_work(run, recordings, model, tmp_path):
    (tmp_path / 'empty.csv').touch()
    csv = recordings['csv']
    for words, reason in (
        ([csv, '-o', tmp_path], 'it is a folder'),
        ([csv, '-o', csv], 'it is the same file as'),
        ([csv, '-o', model], 'it is the same file as'),
        ([csv, '-o', tmp_path / 'empty.csv'], 'it exists'),
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
        done('evaluate', again, drift_csv)
    assert report.read_text().startswith('<!doctype html>')
    assert picture.read_bytes().startswith(PNG[:8])


def test_a_foreign_payloads_json_is_found_before_the_work(run, drift_csv, tmp_path):
    (tmp_path / 'payloads.json').write_text(json.dumps({'of': 'another program'}))
    words = ['-o', tmp_path / 'm.yaml', '--reference', 'payload']
    assert 'payloads.json' in run('calibrate', drift_csv, *words).sentence
    assert len(list(tmp_path.iterdir())) == 1


def test_gravity_has_one_source(run, bags):
    outcome = run('show', bags['mcap'], '--imu-topic', 'imu', '--gravity-frame', 'base')
    assert 'not from both' in outcome.sentence
