"""Options that do nothing for what was given are not ignored in silence."""

import pytest

from wrist_ft_comp.cli.main import main

BAG_ONLY = ['--wrench-topic', '/w', '--temperature-topic', '/t']


@pytest.mark.parametrize(
    ('words', 'idle'),
    [
        (['calibrate', '{csv}', '-o', '{out}', *BAG_ONLY], ['--wrench-topic', '--temperature-']),
        (['calibrate', '{csv}', '-o', '{out}', '--latents', '2'], ['--latents']),
        (['calibrate', '{csv}', '-o', '{out}', '--latents', '2', '--method', 'pls'], []),
        (['calibrate', '{csv}', '-o', '{out}', '--method', 'arx_pls_oe', '--latents', '2'],
         ['--latents']),
        (['calibrate', '{csv}', '-o', '{out}', '--features', 'hats', '--degree', '2',
          '--hat-temperatures', '20,26,32'], ['--degree']),
        (['calibrate', '{csv}', '-o', '{out}', '--keep-copied-columns'], ['--keep-copied']),
        (['calibrate', '{table}', '-o', '{out}', '--features', 'powers'], ['--features']),
        (['calibrate', '{table}', '-o', '{out}', '--features', 'powers', '--method', 'pls'], []),
        (['evaluate', '{model}', '{csv}', '--imu-topic', 'i'], ['--imu-topic']),
        (['evaluate', '{model}', '{csv}', '--tare', '3'], []),
        (['compensate', '{model}', '{csv}', '-o', '{out}', '--tare', '9', '--output-topic', '/o'],
         ['--output-topic']),
        (['compensate', '{tables}', '{table}', '-o', '{out}', '--tare', '9'], ['--tare']),
        (['show', '{csv}', '--gravity-frame', 'base'], ['--gravity-frame']),
        (['show', '{model}', '--wrench-topic', 'w'], ['--wrench-topic']),
    ],
)  # fmt: skip
def test_an_option_that_does_nothing_is_named(words, idle, run, here):
    outcome = run(*(word.format(**here) for word in words))
    warned = [line for line in outcome.err.splitlines() if 'does nothing here' in line]
    assert outcome.code == 0, outcome
    assert len(warned) == len(idle)
    for line, option in zip(sorted(warned), sorted(idle), strict=True):
        assert line.startswith(f'warning: {option}')


@pytest.fixture
def here(make, drift_csv, model, tables, tmp_path):
    table = make.keller / 'table2_sensor_b_raw.csv'
    paths = {'csv': drift_csv, 'model': model, 'tables': tables, 'table': table}
    return {**paths, 'out': tmp_path / 'out'}


@pytest.fixture(scope='module')
def tables(tmp_path_factory, make):
    """A model of a chamber table."""
    path = tmp_path_factory.mktemp('tables') / 'b.yaml'
    main(['calibrate', str(make.keller / 'table2_sensor_b_raw.csv'), '-o', str(path)])
    return path


def test_a_reference_s_topic_that_nobody_asks_is_named(run, bags, model):
    words = ['--reference-topic', '/wrench_raw2']
    for command in (['evaluate', model, bags['mcap']], ['show', bags['mcap']]):
        said = 'warning: --reference-topic does nothing here' in run(*command, *words).err
        assert said is (command[0] == 'evaluate')


def test_gravity_has_one_source(run, bags):
    outcome = run('show', bags['mcap'], '--imu-topic', 'imu', '--gravity-frame', 'base')
    assert (outcome.code, outcome.out) == (2, '')
    assert '--gravity-frame' in outcome.err
