from dataclasses import fields, is_dataclass
import hashlib
import json
import os
from pathlib import Path
import signal
import subprocess
import sys

import numpy as np
import pytest

import wrist_ft_comp
from wrist_ft_comp.calibration.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.cli.calibration_job import run_job
from wrist_ft_comp.errors import CalibrationRefusedError, RecordingError
from wrist_ft_comp.files.job_request import CalibrationJob, decode_job, encode_job, UNTIL_CLOSED
from wrist_ft_comp.files.model_file import load_model
from wrist_ft_comp.files.recordings import hash_recording
from wrist_ft_comp.model.arx import Orders
from wrist_ft_comp.model.signals import Topics

OTHER = CalibrationJob(
    recordings=(Path('/a/b.csv'), Path('ü \udcff"c.csv')),
    output=Path('out/model.yaml'),
    settings=CalibrationSettings(
        reference='recorded',
        min_temperature_span_k=1.25,
        max_gap_s=33.0,
        identification=IdentificationSettings(
            method='filtered_pls',
            features='hats',
            degree=3,
            hat_temperatures_c=(20.0, 35.5),
            latents=4,
            orders=Orders(3, 1, 4, 0, (0.0, 7.0)),
        ),
    ),
    period_s=2.5,
    topics=Topics('/w', ('/t1', '/t2'), '/r'),
    skip_unusable=True,
    keep_copied_columns=True,
    report=Path('out/report.html'),
)


def leaves(value, name='job'):
    """Every plain value of nested records, by its path."""
    if not is_dataclass(value):
        return {name: value}
    found = {}
    for field in fields(value):
        found |= leaves(getattr(value, field.name), f'{name}.{field.name}')
    return found


def warm_up_csv(path, *, span_k=15.0, thermometers=1, reference=False, rows=400):
    rng = np.random.default_rng(3)
    t = np.arange(rows) * 10.0
    celsius = 20 + span_k * (1 - np.exp(-t / 1200))
    columns = {'stamp_s': t + 0.5, 'force_z': 0.5 * celsius + rng.normal(0, 0.02, rows)}
    columns |= {'temperature_c': celsius}
    columns |= {f'temperature_{j}_c': celsius + j for j in range(2, thermometers + 1)}
    if reference:
        load = 20 * np.sin(t / 70)
        columns |= {'reference_force_z': load, 'force_z': columns['force_z'] + load}
    path.parent.mkdir(parents=True, exist_ok=True)
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, table, delimiter=',', header=','.join(columns), comments='')
    return path


def job(tmp_path, *recordings, **more):
    return CalibrationJob(tuple(recordings), tmp_path / 'out/model.yaml', period_s=10.0, **more)


def test_every_setting_of_the_example_differs_from_its_default():
    default = leaves(CalibrationJob((), Path()))
    assert [name for name, value in leaves(OTHER).items() if default[name] == value] == []


def test_a_job_survives_its_journey():
    assert leaves(decode_job(encode_job(OTHER))) == leaves(OTHER)
    assert decode_job(encode_job(OTHER)) == OTHER


def test_a_job_is_one_line_of_ascii():
    text = encode_job(OTHER)
    assert text.isascii()
    assert '\n' not in text


def test_the_model_is_saved_with_where_it_came_from(tmp_path):
    path = warm_up_csv(tmp_path / 'run.csv')
    seen = []
    found = run_job(job(tmp_path, path), seen.append)
    calibration, stored = found.calibration, found.stored
    assert found.left_out == ()
    loaded = load_model(tmp_path / 'out/model.yaml')
    assert loaded.sha256 == stored.sha256
    assert set(loaded.model.axes) == {'force_z'}
    (source,) = loaded.document['provenance']['recordings']
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    assert source == {'path': str(path), 'sha256': digest}
    assert loaded.document['provenance']['settings']['reference'] == 'unloaded'
    assert seen == sorted(seen)
    assert 0.0 <= seen[0] <= seen[-1] == 1.0
    assert calibration.fits['force_z'].rms_after < calibration.fits['force_z'].rms_before / 10


def test_a_report_that_fails_leaves_the_model_and_says_so(tmp_path):
    """As a process, where the answer is all that its asker sees."""
    path = warm_up_csv(tmp_path / 'run.csv')
    asked = job(tmp_path, path, report=tmp_path / 'no' / 'report.html')
    command = [sys.executable, '-m', 'wrist_ft_comp.cli.calibration_job']
    done = subprocess.run(
        command, input=encode_job(asked), capture_output=True, text=True, check=True, timeout=120
    )
    answer = json.loads(done.stdout)
    assert answer['success']
    last = answer['message'].splitlines()[-1]
    assert last.startswith('warning: The report')
    assert 'cannot be written' in last
    assert load_model(tmp_path / 'out/model.yaml').sha256 == answer['sha256']


def test_a_refusal_saves_nothing(tmp_path):
    path = warm_up_csv(tmp_path / 'run.csv', span_k=1.0)
    with pytest.raises(CalibrationRefusedError, match=r'spans 1\.0 K; at least 3\.0 K'):
        run_job(job(tmp_path, path))
    assert not (tmp_path / 'out').exists()


class TestUnusable:
    def test_recordings_are_left_out_when_that_is_wanted(self, tmp_path):
        good = warm_up_csv(tmp_path / 'good.csv')
        empty, other = tmp_path / 'empty.csv', warm_up_csv(tmp_path / 'two.csv', thermometers=2)
        empty.write_text('stamp_ns,force_x,temperature_c\n')
        found = run_job(
            job(tmp_path, empty, tmp_path / 'gone.csv', good, other, skip_unusable=True)
        )
        assert [sentence.split()[0] for sentence in found.left_out] == [
            'empty.csv',
            'gone.csv',
            'two.csv',
        ]
        assert '2 thermometers; 1 are expected' in found.left_out[-1]
        assert [each['path'] for each in found.stored.document['provenance']['recordings']] == [
            str(good)
        ]

    def test_recordings_without_the_reference_are_left_out(self, tmp_path):
        plain = warm_up_csv(tmp_path / 'plain.csv')
        loaded = warm_up_csv(tmp_path / 'loaded.csv', reference=True)
        settings = CalibrationSettings(reference='recorded')
        found = run_job(job(tmp_path, plain, loaded, settings=settings, skip_unusable=True))
        assert len(found.left_out) == 1
        assert found.left_out[0].startswith('plain.csv was left out: plain.csv holds no reference')

    def test_the_last_reason_is_given_when_none_is_left(self, tmp_path):
        with pytest.raises(RecordingError, match=r'b\.csv does not exist'):
            run_job(job(tmp_path, tmp_path / 'a.csv', tmp_path / 'b.csv', skip_unusable=True))

    def test_a_named_recording_is_not_left_out(self, tmp_path):
        good = warm_up_csv(tmp_path / 'good.csv')
        with pytest.raises(RecordingError, match=r'gone\.csv does not exist'):
            run_job(job(tmp_path, good, tmp_path / 'gone.csv'))
        other = warm_up_csv(tmp_path / 'two.csv', thermometers=2)
        with pytest.raises(CalibrationRefusedError, match='thermometers'):
            run_job(job(tmp_path, good, other))


def test_the_hash_of_a_folder_is_that_of_its_files_in_order(tmp_path):
    folder = tmp_path / 'bag'
    (folder / 'inner').mkdir(parents=True)
    (folder / 'b').write_bytes(b'two')
    (folder / 'a').write_bytes(b'one ')
    assert hash_recording(folder) == hashlib.sha256(b'one two').hexdigest()


def process(text):
    return subprocess.run(
        [sys.executable, '-m', 'wrist_ft_comp.cli.calibration_job'],
        input=text,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        cwd=Path(wrist_ft_comp.__file__).parents[1],
    )


def test_the_process_gives_the_model_as_json(tmp_path):
    done = process(encode_job(job(tmp_path, warm_up_csv(tmp_path / 'run.csv'))))
    assert done.returncode == 0
    outcome = json.loads(done.stdout)
    assert outcome['success']
    assert 'force_z: ' in outcome['message']
    loaded = load_model(Path(outcome['path']))
    assert (loaded.sha256, loaded.document) == (outcome['sha256'], outcome['document'])


def test_the_process_gives_a_refusal_as_json(tmp_path):
    done = process(encode_job(job(tmp_path, tmp_path / 'gone.csv')))
    assert (done.returncode, done.stderr) == (0, '')
    outcome = json.loads(done.stdout)
    assert not outcome['success']
    assert 'gone.csv does not exist' in outcome['message']


def test_the_process_ends_when_nobody_waits_for_it_any_more(tmp_path):
    """A node that is killed can't say so; its end of the pipe is closed by the system."""
    endless = tmp_path / 'endless.csv'
    os.mkfifo(endless)
    job = CalibrationJob(recordings=(endless,), output=tmp_path / 'model.yaml')
    command = [sys.executable, '-m', 'wrist_ft_comp.cli.calibration_job', UNTIL_CLOSED]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        process.stdin.write(encode_job(job).encode() + b'\n')
        process.stdin.flush()
        # Opening the other end waits until the process reads, in the middle of its work.
        with endless.open('wb'):
            process.stdin.close()
            assert process.wait(60) == -signal.SIGTERM
    assert list(tmp_path.iterdir()) == [endless]


def test_the_process_gives_its_result_while_somebody_waits(tmp_path):
    job = CalibrationJob(recordings=(tmp_path / 'none.csv',), output=tmp_path / 'model.yaml')
    command = [sys.executable, '-m', 'wrist_ft_comp.cli.calibration_job', UNTIL_CLOSED]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        process.stdin.write(encode_job(job).encode() + b'\n')
        process.stdin.flush()
        outcome = json.loads(process.stdout.read())
        errors = process.stderr.read()
        assert process.wait(60) == 0
    assert not outcome['success']
    assert 'none.csv' in outcome['message']
    assert errors == b''
