"""
A real strain-gauge load cell over 40 hours, learnt from the first 20 and judged on the rest.

Data: the TANEN project by hmd83 (CC BY 4.0).
"""

import csv
from datetime import datetime
import json
from pathlib import Path

import numpy as np
import pytest

DATA = Path('..', 'shared', 'data', 'load_cell', 'constant_load_run1.csv')
TRAINING_S = 20 * 3600


@pytest.fixture(scope='module')
def halves(tmp_path_factory):
    """Both parts as CSV recordings, a force in N each, and as columns."""
    source = Path(__file__).parents[2] / DATA
    if not source.exists():
        pytest.skip(f'{source} is not there; the project carries no copy of it')
    with source.open(encoding='utf-8', newline='') as file:
        rows = list(csv.DictReader(file, delimiter=';'))
    times = [datetime.fromisoformat(row['time'].replace('Z', '+00:00')) for row in rows]
    seconds = np.array([(time - times[0]).total_seconds() for time in times])
    temperature = np.array([float(row['T_C']) for row in rows])
    force = np.array([float(row['W_raw_kg']) for row in rows]) * 9.80665
    folder, parts = tmp_path_factory.mktemp('load_cell'), {}
    for name, part in (('train', seconds < TRAINING_S), ('rest', seconds >= TRAINING_S)):
        columns = seconds[part], temperature[part], force[part]
        lines = [f'{s:.0f},{t},{f:.6f}' for s, t, f in zip(*columns, strict=True)]
        path = folder / f'{name}.csv'
        path.write_text('\n'.join(['stamp_s,temperature_c,force_z', *lines, '']))
        parts[name] = path, *columns
    return parts


def without_creep(seconds, values):
    """Remove the slow creep, which follows time and not temperature."""
    return values - np.polyval(np.polyfit(seconds, values, 1), seconds)


@pytest.mark.parametrize('method', ['auto', 'arx_pls_oe'])
def test_drift_of_a_real_load_cell_falls_below_a_straight_line(method, halves, done, tmp_path):
    model, out = tmp_path / 'm.yaml', tmp_path / 'out.csv'
    (train, _, warm, learnt), (rest, seconds, later, raw) = halves['train'], halves['rest']
    done('calibrate', train, '-o', model, '--reference', 'constant', '--method', method)
    done('compensate', model, rest, '-o', out)
    with out.open(newline='') as file:
        compensated = np.array([float(row['force_z']) for row in csv.DictReader(file)])
    straight = raw - np.polyval(np.polyfit(warm, learnt, 1), later)
    assert len(compensated) == len(raw)
    assert compensated.std() < 0.2 * raw.std()
    assert compensated.std() < 0.95 * straight.std()
    drift, line = without_creep(seconds, compensated), without_creep(seconds, straight)
    assert drift.std() < 0.85 * line.std()
    argv = ['evaluate', model, rest, '--reference', 'constant', '--tare', '7200', '--json']
    force = json.loads(done(*argv))['axes']['force_z']
    assert force['rms_after'] < 0.3 * force['rms_before']
