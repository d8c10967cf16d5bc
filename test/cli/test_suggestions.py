"""A mistyped word is answered with the one that was meant."""

import pytest


@pytest.mark.parametrize(
    ('argv', 'meant'),
    [
        (['calibrat', 'a.csv'], 'Did you mean calibrate?'),
        (['shwo', 'a.csv'], 'Did you mean show?'),
        (['calibrate', 'a.csv', '--ouput', 'm.yaml'], 'Did you mean --output?'),
        (['calibrate', 'a.csv', '-o', 'm', '--methd=pls'], 'Did you mean --method?'),
        (['calibrate', 'a.csv', '-o', 'm', '--method', 'atuo'], 'Did you mean auto?'),
        (['calibrate', 'a.csv', '-o', 'm', '--features', 'hat'], 'Did you mean hats?'),
        (['evaluate', 'm', 'a', '--reference', 'unload'], 'Did you mean unloaded?'),
        (['completion', 'bahs'], 'Did you mean bash?'),
        (['--verison'], 'Did you mean --version?'),
    ],
)
def test_a_mistyped_word_gets_a_suggestion(argv, meant, run):
    outcome = run(*argv)
    assert (outcome.code, outcome.out) == (2, '')
    assert outcome.err.startswith('usage: ')
    assert meant in outcome.err


@pytest.mark.parametrize('argv', [['fly'], ['show', 'a', '--qqq'], ['demo', '--speed', 'x']])
def test_what_is_like_nothing_gets_none(argv, run):
    outcome = run(*argv)
    assert outcome.code == 2
    assert 'Did you mean' not in outcome.err


def test_the_beginning_of_an_option_is_enough(done, drift_csv, tmp_path):
    done('calibrate', drift_csv, '--out', tmp_path / 'm.yaml', '--meth', 'pls')
    assert (tmp_path / 'm.yaml').exists()


def test_words_after_two_dashes_are_names(run):
    assert '--odd.csv does not exist' in run('show', '--', '--odd.csv').sentence


def test_a_mistyped_axis_is_a_warning(done, make, tmp_path):
    columns = make.drifting()
    columns['torqe_x'] = columns.pop('torque_x')
    path = make.csv(tmp_path / 'run.csv', columns)
    out = done('calibrate', path, '-o', tmp_path / 'm.yaml', '--method', 'pls')
    assert 'The column torqe_x of run.csv is not used; if it is torque_x, rename it.' in out
