"""A calibration job: its journey as a line of JSON, what it reads and saves, its process."""

import hashlib
import json
import math
from pathlib import Path
import signal
import subprocess
import sys

import numpy as np
import pytest

from wrist_ft_comp.errors import CalibrationRefusedError, RecordingError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings, Orders
from wrist_ft_comp.jobs import job_main
from wrist_ft_comp.jobs.calibration_job import run_job
from wrist_ft_comp.jobs.job_process import CalibrationJob, Minute
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.recordings.read import hash_recording, read_recording
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.node_folder import HistoryEntry
from wrist_ft_comp.stored.safe_file import from_plain, parse_json, to_plain

OTHER = CalibrationJob(
    recordings=(Path('/a/b.csv'), Path('ü \udcff"c.csv')),
    output=Path('out/model.yaml'),
    settings=CalibrationSettings(
        reference='recorded', min_temperature_span_k=1.25,
        identification=IdentificationSettings(
            method='filtered_pls', features='hats', degree=3,
            orders=(Orders(2, 2, 1), Orders(1, 1, 0, direct=True)),
        ),
    ),
    period_s=2.5,
    topics=Topics(
        '/w', ('/t1', '/t2'), '/r', '/imu', '', 'imu', 'tool0', 'force_z=f', 'iso', '1', '9',
        ('2..3',),
    ),
    skip_unusable=True,
    report=Path('out/report.html'),
    history=(
        HistoryEntry(None), HistoryEntry(Path('m.yaml'), 'a' * 64, '2026-01-05', 'It is better.',
                                         'learnt', 'day_3.csv', True)),
    max_mb=12.5,
    minute=Minute(((1.0, -2.5), (3.0, 4.0)), 0.5, ('a-1',), ((0.1, 0.0, 0.0), (1.0, 1.1, 1.0))),
)  # fmt: skip


def job(tmp_path, *recordings, **more):
    return CalibrationJob(tuple(recordings), tmp_path / 'out/model.yaml', period_s=1.0, **more)


def test_a_job_survives_its_journey_as_a_line_of_ascii():
    def decode_job(text):
        return from_plain(CalibrationJob, parse_json(text))

    text = json.dumps(to_plain(OTHER), default=str)
    assert text.isascii()
    assert '\n' not in text
    assert decode_job(text) == OTHER
    job = CalibrationJob((), Path('out'), minute=Minute(((1.0, math.nan),), 0.5))
    text = json.dumps(to_plain(job), default=str)
    assert str(decode_job(text).minute.cells) == '((1.0, nan),)'
    with pytest.raises(ValueError, match='must be a finite number'):
        decode_job(text.replace('1.0', '1e999', 1))


@pytest.fixture
def good(make, tmp_path):
    return make.csv(tmp_path / 'good.csv', make.drifting())


@pytest.fixture
def two(make, tmp_path):
    return make.csv(tmp_path / 'two.csv', make.drifting(both=True))


def test_unusable_recordings_are_left_out_when_that_is_wanted(good, two, tmp_path):
    empty, missing = tmp_path / 'empty.csv', tmp_path / 'gone.csv'
    copy = tmp_path / 'copy.csv'
    empty.write_text('stamp_ns,force_x,temperature_c\n')
    copy.write_bytes(good.read_bytes())
    asked, seen = job(tmp_path, empty, missing, good, two, copy, skip_unusable=True), []
    calibration, content = run_job(asked, seen.append)
    assert seen == sorted(seen)
    assert 0.0 <= seen[0] <= seen[-1] == 1.0
    left_out = [said for said in calibration.warnings if 'was left out' in said]
    names = [sentence.split()[0] for sentence in left_out]
    assert names == ['empty.csv', 'gone.csv', 'two.csv', 'copy.csv']
    assert '2 thermometers; 1 are expected' in left_out[2]
    (source,) = content.stored.document['provenance']['recordings']
    assert source == {'path': str(good), 'sha256': hashlib.sha256(good.read_bytes()).hexdigest()}
    with pytest.raises(RecordingError, match=r'gone\.csv does not exist'):
        run_job(job(tmp_path, empty, missing, skip_unusable=True))
    with pytest.raises(RecordingError, match=r'gone\.csv does not exist'):
        run_job(job(tmp_path, good, missing))
    with pytest.raises(CalibrationRefusedError, match='has 1 thermometers and two'):
        run_job(job(tmp_path, good, two))


@pytest.mark.parametrize('seconds', [15, 4000])
def test_a_false_start_beside_a_day_is_left_out(seconds, make, tmp_path):
    day = make.csv(tmp_path / 'day.csv', make.drifting(4000, both=True))
    columns = make.drifting(seconds, both=True)  # the driver dies after 15 s, or the recorder
    for axis in ('force_z', 'torque_x'):
        columns[axis][15:] = [np.nan] * (seconds - 15)
    start = make.csv(tmp_path / 'start.csv', columns)
    settings = CalibrationSettings(identification=IdentificationSettings('pls'))
    calibration, content = run_job(job(tmp_path, day, start, settings=settings))
    assert 'start.csv was left out: its wrenches last 15 s' in calibration.warnings[0]
    (source,) = content.stored.document['provenance']['recordings']
    assert source['path'] == str(day)
    assert calibration.model.prediction is not None
    both = [read_recording(path) for path in (day, start)]
    diluted = calibrate(both, settings).fits['force_z']
    assert diluted.rms_before < 0.8 * calibration.fits['force_z'].rms_before


def test_recordings_without_the_reference_are_left_out(good, make, tmp_path):
    loaded = make.csv(tmp_path / 'loaded.csv', make.loaded())
    settings = CalibrationSettings(reference='recorded')
    calibration, _ = run_job(job(tmp_path, good, loaded, settings=settings, skip_unusable=True))
    (sentence,) = (one for one in calibration.warnings if 'was left out' in one)
    assert 'good.csv holds no reference' in sentence
    settings = CalibrationSettings(reference='payload')
    with pytest.raises(RecordingError, match=r'good\.csv holds no specific force'):
        run_job(job(tmp_path, good, settings=settings, skip_unusable=True))


def test_the_hash_of_a_bag_is_that_of_its_storage_in_order(tmp_path):
    folder = tmp_path / 'bag'
    (folder / 'inner.mcap').mkdir(parents=True)
    (folder / 'bag_1.mcap.zstd').write_bytes(b'two')
    (folder / 'bag_0.mcap.zstd').write_bytes(b'one ')
    (folder / 'metadata.yaml').write_bytes(b'version: 9')
    assert hash_recording(folder) == hashlib.sha256(b'one two').hexdigest()


@pytest.mark.usefixtures('without_pictures')
def test_an_answer_is_json_and_has_the_model_even_where_the_report_fails(good, two, tmp_path):
    asked = job(tmp_path, good, two, skip_unusable=True, report=good / 'report.html')
    outcome = json.loads(json.dumps(job_main.answer(asked)))
    assert outcome['success']
    assert 'force_z: ' in outcome['message']
    assert '\nwarning: two.csv was left out: ' in outcome['message']
    last = outcome['message'].splitlines()[-1]
    assert last.startswith('warning: ')
    assert 'report.html' in last
    loaded = load_model(Path(outcome['path']))
    assert (loaded.sha256, loaded.document) == (outcome['sha256'], outcome['document'])


def test_the_process_ends_with_the_one_that_started_it(good, tmp_path):
    command = [sys.executable, '-m', 'wrist_ft_comp.jobs.job_main', '1']
    line = json.dumps(to_plain(job(tmp_path, good)), default=str)
    ended = subprocess.run(command, input=line, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (-signal.SIGTERM, '')
