from dataclasses import asdict
from datetime import timedelta
import json
import re

import numpy as np
import pandas
import pytest
from scipy.signal import lfilter
import yaml

from wrist_ft_comp import evaluate, load_model, read_recording
from wrist_ft_comp.cli.main import main


def test_the_numbers_are_those_of_the_core(done, make, model, tmp_path):
    path, tare_s = make.csv(tmp_path / 'run.csv', make.drifting(seed=3)), 5
    judged = json.loads(done('evaluate', model, path, '--tare', tare_s, '--json'))
    expected = evaluate(load_model(model).model, [read_recording(path)], tare_s=tare_s)
    assert judged['tare_s'] == tare_s
    assert judged['axes'] == {axis: asdict(figures) for axis, figures in expected.items()}
    assert judged['recordings'][0]['axes'] == judged['axes']


def test_a_tare_is_no_longer_than_its_recording(run, done, make, model, tmp_path):
    path, out = make.csv(tmp_path / 'short.csv', make.drifting(50)), tmp_path / 'out.csv'
    sentence = 'short.csv lasts 50 s, which is shorter than the tare of 60 s. Give a shorter'
    assert sentence in run('evaluate', model, path).sentence
    assert sentence in run('compensate', model, path, '-o', out, '--tare', 60).sentence
    assert not out.exists()
    done('evaluate', model, path, '--tare', 50)


def test_a_model_of_gain_drift_is_learnt_and_judged_with_its_reference(done, make, tmp_path):
    days = [make.csv(tmp_path / f'{seed}.csv', make.loaded(seed=seed)) for seed in (1, 2)]
    model, plain = tmp_path / 'model.yaml', make.csv(tmp_path / 'plain.csv', make.drifting())
    given = '--reference', 'recorded', '--reference-topic', '/cell'
    *_, advice = json.loads(done('calibrate', days[0], '-o', model, *given, '--json'))['advice']
    assert advice.endswith('ANOTHER_DAY --reference-topic /cell')
    assert 'gain' in done('show', model)
    for path, reference in ((plain, 'unloaded'), (days[1], 'recorded')):
        argv = 'evaluate', model, path, '--json'
        judged = json.loads(done(*argv))
        assert judged['recordings'][0]['reference'] == reference
        assert judged == json.loads(done(*argv, '--reference', reference))
    force = judged['axes']['force_z']
    assert force['rms_after'] < 0.1  # it drifts by 0.04 N/s, and a correction comes 1.5 s later
    assert force['rms_before'] > 2


@pytest.mark.parametrize('seconds', [70, 400])
def test_recordings_at_one_temperature_are_not_judged(seconds, done, make, model, tmp_path):
    columns = make.drifting(seconds)  # it warms up after 70 s, when the wrench has died
    noise = np.random.default_rng(0).normal(0, 0.02, (2, seconds))
    noise[:, 70:] = np.nan
    columns['temperature_c'][:70] = [24.0] * 70
    columns['force_z'], columns['torque_x'] = (3 + noise).tolist()
    path, page = make.csv(tmp_path / 'still.csv', columns), tmp_path / 'r.html'
    done('evaluate', model, path, '--report', page)
    assert page.read_text().count('>not judged</td>') == 2
    judged = json.loads(done('evaluate', model, path, '--json'))['verdicts']
    assert {verdict['level'] for verdict in judged.values()} == {'unjudged'}
    moved = make.csv(tmp_path / 'day.csv', make.drifting(seed=3))
    judged = json.loads(done('evaluate', model, path, moved, '--json'))['verdicts']
    assert {verdict['level'] for verdict in judged.values()} == {'good'}


def lagged_pair(seed, *, frozen=False):
    """A motor and a flange that follows it, 3 h; the thermometer of the flange freezes."""
    rng = np.random.default_rng(seed)
    heat = 22 + 25 * np.repeat(rng.random(12), 90)
    motor = lfilter([1 / 30], [1, 1 / 30 - 1], heat, zi=[heat[0]])[0]
    flange = lfilter([1 / 90], [1, 1 / 90 - 1], motor, zi=[motor[0]])[0]
    seen = flange + rng.normal(0, 0.02, len(heat))
    if frozen:
        seen[400:] = seen[400]
    return {
        'stamp_s': range(0, 10 * len(heat), 10),
        'temperature_c': (motor + rng.normal(0, 0.02, len(heat))).tolist(),
        'temperature_2_c': seen.tolist(),
        'force_z': (0.8 * (flange - 22) + rng.normal(0, 0.05, len(heat))).tolist(),
    }


@pytest.fixture(scope='module')
def pair_model(make, tmp_path_factory):
    folder = tmp_path_factory.mktemp('pair')
    days = [make.csv(folder / f'{seed}.csv', lagged_pair(seed)) for seed in (1, 2, 3)]
    argv = 'calibrate', *days, '-o', folder / 'model.yaml', '--thermal-period', 10
    assert main([*map(str, argv), '--method', 'filtered_pls']) == 0
    return folder / 'model.yaml'


def test_a_thermometer_that_froze_in_a_file_is_named_once(run, make, pair_model, tmp_path):
    healthy, failed = (
        make.csv(tmp_path / f'frozen_{frozen}.csv', lagged_pair(11, frozen=frozen))
        for frozen in (False, True)
    )
    columns = '--columns', 'force_z=force_z'
    printed = run('evaluate', pair_model, healthy, *columns)
    assert 'stands still' not in printed.err
    command = f'compensate {pair_model} {healthy} {" ".join(columns)} -o compensated.csv'
    assert command in printed.out, 'a table names no topics that a node could hear'
    for argv in (['evaluate'], ['compensate', '-o', tmp_path / 'copy.csv']):
        said = run(argv[0], pair_model, failed, *argv[1:]).err
        assert said.count('thermometer 2 stands still') == 1


@pytest.mark.parametrize('is_named', [False, True])
def test_a_model_does_not_hold_where_an_axis_drifts_that_it_does_not_know(
    done, make, pair_model, tmp_path, is_named
):
    document, model = yaml.safe_load(pair_model.read_text()), tmp_path / 'model.yaml'
    if is_named:  # temperature explained nothing of it
        document['axes']['force_x'] = json.loads(json.dumps(document['axes']['force_z']))
        document['axes']['force_x'] |= {'model': None, 'day_limit': None}
    model.write_text(yaml.safe_dump(document, sort_keys=False))
    columns, noise = lagged_pair(11), np.random.default_rng(0).normal(0, 0.02, 1080)
    for drifts in (0, 1):
        columns['force_x'] = noise + drifts * np.array(columns['force_z'])
        path = make.csv(tmp_path / 'day.csv', columns)
        advice = json.loads(done('evaluate', model, path, '--json'))['advice'][0]
        assert ('learnt without force_x, whose drift stays' in advice) == drifts
        assert advice.startswith('The model holds') == (not drifts)


def test_exchanged_columns_are_noticed(done, make, pair_model, tmp_path):
    columns, names = lagged_pair(11), ['temperature_c', 'temperature_2_c']
    for order in (1, -1):
        swapped = columns | dict(zip(names, [columns[n] for n in names[::order]], strict=True))
        path = make.csv(tmp_path / f'{order}.csv', swapped)
        judged = json.loads(done('evaluate', pair_model, path, '--json'))
        warned = 'thermometers 1 and 2 read what is expected' in ' '.join(judged['warnings'])
        asked = judged['advice'][0].startswith('Are the thermometers in the order of the model?')
        assert warned == asked == (order == -1)


def test_a_file_without_all_thermometers_of_the_model_is_refused(run, make, pair_model, tmp_path):
    columns, out = lagged_pair(7), ['-o', tmp_path / 'out.csv']
    nothing = {'temperature_2_c': [None] * len(columns['force_z'])}
    dead = make.csv(tmp_path / 'dead.csv', columns | nothing)
    del columns['temperature_2_c']
    single = make.csv(tmp_path / 'single.csv', columns)
    for path, words in (
        (single, 'Name the topics, or keep the columns, that it was calibrated with.'),
        (dead, 'temperature_2_c of dead.csv holds no sample; it is left out.'),
    ):
        for command, more in (('evaluate', []), ('compensate', out)):
            sentence = run(command, pair_model, path, *more).sentence
            assert f'{path.name} has 1 thermometers, the model expects 2. {words}' in sentence


@pytest.mark.parametrize(('room_c', 'part_s', 'noise_k', 'cell_s', 'is_warm'), [
    (20, (0, 9000), 0, 1, False), (30, (0, 9000), 0, 1, False), (20, (1500, 9000), 0, 1, True),
    (20, (3600, 9000), 0, 1, True), (20, (1200, 3600), 0, 20, True),
    (20, (0, 9000), 0.3, 1, False),
], ids=['cold', 'soaked in a warm room', 'warms', 'hot', 'long cells', 'noisy'])  # fmt: skip
def test_a_recording_that_begins_on_a_warm_robot_is_doubted(  # noqa: PLR0913, PLR0917
    room_c, part_s, noise_k, cell_s, is_warm, run, make, make_model, save, lagged, tmp_path
):
    model = make_model({'force_z': (0.4, 0.0, 900.0)}, range_c=(20.0, 60.0), period_s=cell_s)
    path = save(tmp_path / 'model.yaml', model).path
    t = np.arange(9000.0)
    celsius = room_c + lagged(25.0 * ((t > 600) & (t < 4200)), 300, period_s=1.0)
    force = 0.4 * lagged(celsius, 900, period_s=1.0)
    celsius += np.random.default_rng(6).normal(0, noise_k, len(t))
    columns = {'stamp_s': t, 'temperature_c': celsius, 'force_z': force}
    columns = {name: column[slice(*part_s)] for name, column in columns.items()}
    day = make.csv(tmp_path / 'day.csv', columns)
    for argv in (['evaluate', path, day], ['compensate', path, day, '-o', tmp_path / 'out.csv']):
        said = re.findall(r'begins on a warm robot.* (\S+) N off.* 45 min', run(*argv).err)
        assert len(said) == is_warm
    if is_warm and cell_s == 1:  # of longer cells, the number is rough
        left = pandas.read_csv(tmp_path / 'out.csv')['force_z']
        assert np.ptp(left) < 1.1 * float(said[0])


@pytest.fixture(scope='module')
def slow_model(make, tmp_path_factory):
    folder = tmp_path_factory.mktemp('slow')
    path = make.csv(folder / 'day.csv', make.drifting(3600, every=4))
    assert main(['calibrate', str(path), '-o', str(folder / 'model.yaml'), '--method', 'pls']) == 0
    return folder / 'model.yaml'


@pytest.mark.parametrize(('channels', 'begin_s', 'end_s', 'who'), [
    (['temperature_c'], 1500, 2400, 'Thermometer 1 of day.csv is silent'),
    (['temperature_c'], 2400, 3600, 'Thermometer 1 of day.csv is silent'),
    (['temperature_c', 'force_z', 'torque_x'], 1500, 2400, 'Nothing of day.csv came'),
])  # fmt: skip
def test_long_silence_is_named_once_by_every_command_that_reads(  # noqa: PLR0913, PLR0917
    channels, begin_s, end_s, who, run, make, slow_model, tmp_path
):
    columns = make.drifting(3600, 3)
    for channel in channels:
        columns[channel][begin_s:end_s] = [None] * (end_s - begin_s)
    path = make.csv(tmp_path / 'day.csv', columns)
    for argv in (
        ['show', path],
        ['calibrate', path, '-o', tmp_path / 'm.yaml', '--method', 'pls'],
        ['evaluate', slow_model, path],
        ['compensate', slow_model, path, '-o', tmp_path / 'out.csv'],
    ):
        outcome = run(*argv)
        assert outcome.code == 0
        (said,) = (line for line in (outcome.out + outcome.err).splitlines() if who in line)
        assert f'for {end_s - begin_s} s, from {timedelta(seconds=begin_s)} on' in said


def test_axes_beyond_their_stated_limit_are_named(run, done, make, slow_model, tmp_path):
    """The driver tared in the middle of the day: little is left, and the axis is not good."""
    columns = make.drifting(3600, 3, every=4)
    days = [make.csv(tmp_path / 'day.csv', columns)]
    assert 'largest error is above' not in run('evaluate', slow_model, days[0]).out
    columns['force_z'] = [value + 4.0 * (k > 450) for k, value in enumerate(columns['force_z'])]
    days.append(make.csv(tmp_path / 'tared.csv', columns))
    outcome = run('evaluate', slow_model, *days)
    assert re.search('force_z +N +weak', outcome.out)
    judged = json.loads(done('evaluate', slow_model, *days, '--json'))
    said = judged['advice'][0]
    assert 'is above the limit of' in judged['verdicts']['force_z']['why']
    assert 'holds' not in ' '.join(judged['advice'])
    assert '9 of 10 days: force_z. See in the report' in said
    assert outcome.out.count('largest error is above') == 1
    assert 'torque' not in said
