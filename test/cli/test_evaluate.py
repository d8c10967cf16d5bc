import json

import numpy as np
import pytest
import yaml

from wrist_ft_comp.stream import gap


def arx_by_hand(arx, t):
    """Run one filter or latent, term by term; before the first cell all was as in it."""
    resting = t[0] * sum(arx['b']) / (1 + sum(arx['a']))
    u = np.zeros(len(t))
    for k in range(len(t)):
        for j, a in enumerate(arx['a'], start=1):
            u[k] -= a * (u[k - j] if k >= j else resting)
        for i, b in enumerate(arx['b'], start=arx['first_lag']):
            u[k] += b * (t[k - i] if k >= i else t[0])
    return u


def drift_by_hand(document, temperature_c):
    """Run a model in powers of one temperature: clamp, filter, take powers, score, load."""
    features, dynamics = document['features'], document['dynamics']
    low, high = features['lower_c'][0], features['upper_c'][0]
    margin = 0.2 * (high - low)
    held = np.clip(np.array(temperature_c), low - margin, high + margin)
    filtered = [arx_by_hand(each, held) for each in document['filters']] or [held]
    powers = range(1, features['degree'] + 1)
    pairs = list(zip(filtered, features['reference_c'], strict=True))
    x = np.stack([(t - at) ** power for power in powers for t, at in pairs], axis=1)
    scores = ((x - dynamics['input_mean']) * dynamics['input_weight']) @ dynamics['rotations']
    latents = [arx_by_hand(each, t) for each, t in zip(dynamics['latents'], scores.T, strict=True)]
    loaded = np.stack(latents, axis=1) @ np.array(dynamics['output_loadings']).T
    return (loaded / dynamics['output_weight'] + dynamics['output_mean'])[:, 0]


def by_hand(columns, model, axis, tare_s):
    """Compute the four numbers."""
    document = yaml.safe_load(model.read_text())['axes'][axis]['model']
    raw = np.array(columns[axis])
    t = columns['temperature_c']
    # A start looks at the first ten seconds, and until then at what has come.
    starts = [[np.mean(t[:n]), *t[:n]] for n in range(1, 10)]
    drift = [drift_by_hand(document, each)[-1] for each in starts]
    after = raw - [*drift, *drift_by_hand(document, [np.mean(t[:10]), *t])[10:]]
    tared = {name: e - e[:tare_s].mean() for name, e in (('before', raw), ('after', after))}
    rms = {f'rms_{name}': np.sqrt(np.mean(e**2)) for name, e in tared.items()}
    return {**rms, **{f'max_{name}': np.abs(e).max() for name, e in tared.items()}}


@pytest.fixture(scope='module')
def lagging(make):
    """Build columns whose force z follows a temperature that relaxes after the thermometer's."""

    def build(seconds=400, seed=0, tau_s=40.0):
        columns = make.drifting(seconds, seed)
        relaxed = [columns['temperature_c'][0]]
        for celsius in columns['temperature_c'][1:]:
            relaxed.append(relaxed[-1] + (celsius - relaxed[-1]) / tau_s)
        theta = np.array(relaxed) - 20
        noise = np.random.default_rng(seed).normal(0, 0.02, seconds)
        return {**columns, 'force_z': (1.5 * theta + 0.05 * theta**2 + noise).tolist()}

    return build


@pytest.mark.parametrize(
    ('method', 'dynamics', 'tare_s'),
    [('pls', 'nothing', 5), ('arx_pls_oe', 'filters', 60), ('arx_pls', 'latents', 60)],
)
def test_the_numbers_are_those_of_a_hand_computation(  # noqa: PLR0913, PLR0917 -- fixtures
    method, dynamics, tare_s, done, make, lagging, tmp_path
):
    model, columns = tmp_path / 'm.yaml', lagging(seed=3)
    learnt = make.csv(tmp_path / 'learnt.csv', lagging())
    done('calibrate', learnt, '-o', model, '--method', method)
    parts = yaml.safe_load(model.read_text())['axes']['force_z']['model']
    parts['latents'] = parts['dynamics']['latents']
    assert any(each['a'] for each in parts.get(dynamics, [{'a': [1]}]))
    path = make.csv(tmp_path / 'run.csv', columns)
    judged = json.loads(done('evaluate', model, path, '--tare', tare_s, '--json'))
    assert set(judged['axes']) == {'force_z', 'torque_x'}
    assert judged['tare_s'] == tare_s
    for axis, numbers in judged['axes'].items():
        assert numbers == pytest.approx(by_hand(columns, model, axis, tare_s), rel=1e-7)


def test_the_reference_is_subtracted(done, make, model, tmp_path):
    """With a model of zero drift only, a recorded load changes nothing in the errors."""
    columns = make.drifting(seed=3)
    plain = make.csv(tmp_path / 'plain.csv', columns)
    load = np.repeat([0.0, 7.0, -4.0, 11.0], 100)
    columns['force_z'] = (np.array(columns['force_z']) + load).tolist()
    columns['reference_force_z'] = load.tolist()
    path = make.csv(tmp_path / 'loaded.csv', columns)
    expected = json.loads(done('evaluate', model, plain, '--json'))['axes']['force_z']
    judged = json.loads(done('evaluate', model, path, '--reference', 'recorded', '--json'))
    assert judged['axes'] == {'force_z': pytest.approx(expected, rel=1e-9)}
    assert judged['recordings'][0]['reference'] == 'recorded'


def test_the_table_fits_the_screen_and_names_units(done, drift_csv, model):
    lines = done('evaluate', model, drift_csv).splitlines()
    assert [line.split()[0] for line in lines[:3]] == ['axis', 'force_z', 'torque_x']
    assert lines[4].startswith('force_z: good. ')
    assert 'N m' in lines[2]
    assert max(map(len, lines)) <= 80


def test_json_stays_whole_when_there_are_warnings(run, make, model, tmp_path):
    columns = make.drifting(seed=3)
    columns['force_z'][9] = 'nan'
    path = make.csv(tmp_path / 'run.csv', columns)
    outcome = run('evaluate', model, path, '--json')
    assert json.loads(outcome.out)['recordings'][0]['warnings']
    assert all(line.startswith('warning: ') for line in outcome.err.splitlines())
    assert outcome.code == 0


def test_a_report_tells_what_was_printed(done, make, model, tmp_path):
    path, page = make.csv(tmp_path / 'run.csv', make.drifting(seed=3)), tmp_path / 'r.html'
    out = done('evaluate', model, path, '--tare', '5', '--report', page)
    text = page.read_text()
    for number in out.splitlines()[1].split()[2:6]:
        assert f'<td>{number}</td>' in text
    assert 'first 5\N{NO-BREAK SPACE}s' in text


@pytest.mark.parametrize('seconds', [1, 30])
def test_where_no_temperature_moved_there_is_nothing_to_judge(
    seconds, done, make, model, tmp_path
):
    columns = make.drifting(seconds)
    noise = np.random.default_rng(0).normal(0, 0.02, (2, seconds))
    columns['temperature_c'] = [24.0] * seconds
    columns['force_z'], columns['torque_x'] = (3 + noise).tolist()
    path, page = make.csv(tmp_path / 'still.csv', columns), tmp_path / 'r.html'
    assert 'force_z: nothing to judge. ' in done('evaluate', model, path, '--report', page)
    assert '2 nothing to judge' in page.read_text()
    judged = json.loads(done('evaluate', model, path, '--json'))['verdicts']
    assert {each['level'] for each in judged.values()} == {'unjudged'}
    moved = make.csv(tmp_path / 'day.csv', make.drifting(seed=3))
    judged = json.loads(done('evaluate', model, path, moved, '--json'))['verdicts']
    assert {each['level'] for each in judged.values()} == {'good'}


def test_every_recording_is_simulated_once(done, make, model, tmp_path, monkeypatch):
    paths = [make.csv(tmp_path / f'{seed}.csv', make.drifting(seed=seed)) for seed in (1, 2)]
    runs, run_once = [], gap.run_from_rest

    def counted(*arguments):
        runs.append(arguments)
        return run_once(*arguments)

    monkeypatch.setattr(gap, 'run_from_rest', counted)
    done('evaluate', model, *paths, '--report', tmp_path / 'r.html')
    assert len(runs) == len(paths)


@pytest.mark.parametrize('victim', ['model', 'recording'])
def test_a_report_overwrites_neither_model_nor_recording(victim, run, make, model, tmp_path):
    copies = {'model': tmp_path / 'm.yaml', 'recording': tmp_path / 'run.csv'}
    copies['model'].write_bytes(model.read_bytes())
    make.csv(copies['recording'], make.drifting())
    before = copies[victim].read_bytes()
    argv = ['evaluate', *copies.values(), '--report', copies[victim]]
    assert 'overwrite' in run(*argv).sentence
    assert copies[victim].read_bytes() == before


def test_large_figures_are_written_out(run, make, model, tmp_path):
    columns = make.drifting(seed=3)
    columns['force_z'] = [20_000 * value for value in columns['force_z']]
    columns['temperature_c'] = [value + 60 for value in columns['temperature_c']]
    outcome = run('evaluate', model, make.csv(tmp_path / 'run.csv', columns))
    assert 'For 100 % of the time the correction is a guess' in outcome.err
    assert 'e+0' not in outcome.out + outcome.err
