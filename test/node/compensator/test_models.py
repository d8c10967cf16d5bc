from dataclasses import asdict
import json
import os
import re
import shutil

from moments import ERROR, OK, START, WARN
import numpy as np
import pytest

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.stored.node_folder import HistoryEntry


def live(node):
    """Name of the live model, as the node and its diagnostics have it."""
    stored = node.node.live.stored
    shown = node.diagnosis('model').values
    assert shown.get('file') == (None if stored is None else str(stored.path))
    assert shown.get('sha256') == (None if stored is None else stored.sha256)
    return None if stored is None else stored.path.name


@pytest.fixture
def abc(rig, make_model):
    """Make three models, and give what makes nodes."""
    for number, name in enumerate('abc', start=1):
        make_model(f'{name}.yaml', {'force_x': (float(number), 0, 0)})
    return rig


def choose(node, *names):
    for name in names:
        assert node.set('model_file', f'models/{name}.yaml').successful


def test_a_rollback_goes_back_model_by_model_to_none_and_no_further(abc):
    node = abc()
    choose(node, 'a', 'b', 'b')  # twice is one step back
    assert live(node) == 'b.yaml'
    answer = node.call('rollback')
    assert answer.message == f'compensating with {node.directory / "models/a.yaml"} again'
    assert live(node) == 'a.yaml'
    answer = node.call('rollback')
    assert answer.message.startswith('no model was live before: wrenches pass uncompensated')
    assert live(node) is None
    assert node.refusal('rollback').startswith('There is no earlier model to go back to')


def test_a_model_before_the_first_wrench_moves_a_tare_from_before_a_restart(abc):
    node = abc()
    choose(node, 'a')
    node.warm_up(30.0)
    stream = node.node.compensator
    stream.set_tare(np.ones(6), stream.tracker.end_ns)
    unloaded = stream.tare[0] + stream.compensation.zero[0]
    assert node.node.counts.newest is None
    choose(node, 'c')
    assert stream.tare[0] + stream.compensation.zero[0] == pytest.approx(unloaded)


def test_what_a_model_left_wrong_in_the_tare_is_stated_until_the_next_tare(abc):
    def deviation():
        return node.diagnosis('output').values['force_x_drift_deviation']

    node = abc()
    choose(node, 'a')
    node.warm_up(30.0)
    stream = node.node.compensator
    choose(node, 'b')
    assert deviation() == '0.1 N'  # a zero that nobody tared
    stream.set_tare(np.ones(6), stream.tracker.end_ns)
    choose(node, 'c')
    assert deviation() == '0.1414 N'
    node = abc()
    node.warm_up(30.0)
    stream = node.node.compensator
    # Another payload may make the external tare zero.
    stream.restore_tare(stream.tare, np.zeros(6), tared=True)
    assert deviation() == '0.1414 N'
    stream.set_tare(np.ones(6), stream.tracker.end_ns)
    assert deviation() == '0.1 N'


@pytest.mark.parametrize(
    ('name', 'words'),
    [
        ('gone', 'gone.yaml cannot be read: No such file'),
        ('b', 'models/b.yaml has changed since it was live'),
    ],
)
def test_a_rollback_passes_over_a_model_that_cannot_be_used(abc, name, words):
    none, hashes = asdict(HistoryEntry(None)), {'a': '', name: 'f' * 64, 'c': ''}
    entries = [{**none, 'path': f'models/{n}.yaml', 'sha256': sha} for n, sha in hashes.items()]
    document = {'format': 'wrist_ft_comp live models', 'version': 1, 'history': entries}
    (abc().directory / 'active.json').write_text(json.dumps(document))
    node = abc()
    sentence = node.refusal('rollback')
    assert words in sentence
    assert 'The running model stays; call again for the model before' in sentence
    assert live(node) == 'c.yaml'
    assert node.call('rollback').success
    assert live(node) == 'a.yaml'


def test_every_change_is_kept_with_its_date_and_reason(abc, make_model):
    node = abc()
    choose(node, 'a', 'b', 'b')
    assert node.call('rollback').success
    make_model('a.yaml', {'force_x': (9.0, 0, 0)})
    choose(node, 'a')
    first, *history = node.node.live.history
    assert (first.path, first.since) == (None, '')
    assert [(entry.path.name, entry.how, entry.withdrawn) for entry in history] == [
        ('a.yaml', 'chosen', True), ('b.yaml', 'chosen', True), ('a.yaml', 'back', True),
        ('a.yaml', 'chosen', False),
    ]  # fmt: skip
    assert history[2].why == 'a person went back from b.yaml to a.yaml with ~/rollback'
    assert history[2].sha256 == history[0].sha256 != history[3].sha256
    dates = [entry.since for entry in history]
    assert dates == sorted(dates)
    assert abc().node.live.history == node.node.live.history
    assert node.call('rollback').success
    assert live(node) is None


def test_a_restart_with_a_broken_list_has_no_model(abc, tmp_path, capfd):
    (tmp_path / 'data/active.json').write_text('{')
    node = abc()
    status = node.diagnosis('model', 'The last model cannot be used: ')
    assert status.level == ERROR
    assert 'active.json' in status.message
    assert 'Remove it and set model_file.' in capfd.readouterr().err
    assert node.ask_output(START, [1.0] * 6) == (1.0,) * 6
    choose(node, 'a')
    assert node.diagnosis('model', lambda status: status.level == OK)
    assert live(abc()) == 'a.yaml'


def test_a_decision_after_the_last_start_goes_on(abc, make_model, capfd):
    given = {'model_file': 'models/a.yaml'}
    first = abc(parameters=given)
    assert live(first) == 'a.yaml'
    later = make_model('later.yaml', {'force_x': (9, 0, 0)})
    first.node.live.take(later, 'calibrated')
    again = abc(parameters=given)
    assert live(again) == 'later.yaml'
    assert 'was made live, and goes on' in capfd.readouterr().err
    later.path.unlink()
    assert live(abc(parameters=given)) == 'a.yaml', 'it cannot be used'
    assert 'models/a.yaml is live instead' in capfd.readouterr().err


def test_a_model_file_of_the_same_content_is_no_new_decision(abc, tmp_path, capfd):
    """Neither under another name, nor after a start without it."""
    given = str(shutil.copy(tmp_path / 'data/models/a.yaml', tmp_path / 'again.yaml'))
    choose(abc(parameters={'model_file': 'models/a.yaml'}), 'c')
    for parameters in ({'model_file': given}, {}, {'model_file': 'models/a.yaml'}):
        assert live(abc(parameters=parameters)) == 'c.yaml'
    assert f'model_file is {given} with the content of the last start' in capfd.readouterr().err


def test_a_live_model_whose_file_was_replaced_is_a_warning_until_it_is_chosen(abc, make_model):
    node = abc()
    choose(node, 'a')
    make_model('a.yaml', {'force_x': (0.5, 0, 0)})
    node = abc()
    words = 'models/a.yaml has changed since it was live, and runs as it is now'
    assert node.diagnosis('model', words).level == WARN
    choose(node, 'a')
    assert node.diagnosis('model').level == OK
    assert abc().diagnosis('model').level == OK


def test_another_model_file_at_start_is_a_new_decision(abc):
    for name in 'abca':
        node = abc(parameters={'model_file': f'models/{name}.yaml'})
        assert live(node) == f'{name}.yaml'
    assert node.call('rollback').success
    assert live(node) == 'c.yaml'


class TestModelFile:
    def test_a_model_file_outside_is_refused_at_run_time(self, rig, make_model, tmp_path):
        make_model(tmp_path / 'elsewhere.yaml')
        make_model('live.yaml')
        (tmp_path / 'data/link.yaml').symlink_to(tmp_path / 'elsewhere.yaml')
        node = rig()
        assert node.set('model_file', 'models/live.yaml').successful
        sentence = node.refused_value('model_file', str(tmp_path / 'data/link.yaml'))
        assert f'must lie inside data_directory ({tmp_path / "data"})' in sentence
        assert live(node) == 'live.yaml'
        assert node.node.get_parameter('model_file').value == 'models/live.yaml'

    @pytest.mark.parametrize('is_restarted', [False, True])
    def test_a_model_that_was_live_may_be_set_again_wherever_it_lies(
        self, rig, make_model, tmp_path, monkeypatch, is_restarted
    ):
        """As ~/rollback says where no model was live before."""
        make_model(tmp_path / 'elsewhere.yaml')
        make_model('live.yaml')
        monkeypatch.chdir(tmp_path)
        node = rig()
        assert node.set('model_file', 'models/live.yaml').successful
        assert node.call('rollback').success
        node = rig(parameters={'model_file': 'elsewhere.yaml'})
        assert node.set('model_file', 'models/live.yaml').successful
        assert node.set('model_file', 'elsewhere.yaml').successful
        node = rig() if is_restarted else node
        for _ in range(3):
            answer = node.call('rollback').message
        named = re.search('until model_file is set to (.*) while running', answer)[1]
        assert node.set('model_file', named).successful
        assert live(node) == 'elsewhere.yaml'

    def test_a_model_file_that_cannot_be_used_is_refused(self, rig, make_model):
        other = 'expects 2 thermometers, the node has 1'
        with pytest.raises(SettingsError, match=other):
            rig(model=make_model('two.yaml', thermometers=2))
        node = rig(model=make_model('live.yaml'))
        (node.directory / 'models/other.yaml').write_text('format: other')
        (node.directory / 'loop.yaml').symlink_to(node.directory / 'loop.yaml')
        os.mkfifo(node.directory / 'pipe.yaml')
        for name, words in (
            ('models/missing.yaml', 'missing.yaml'), ('models/other.yaml', 'other.yaml'),
            ('pipe.yaml', 'is no regular file'), ('loop.yaml', 'loop.yaml'),
            ('~nobody_of_this_name/a.yaml', '~nobody'), ('x' * 5000, 'xxx'), ('.', ''),
            ('/dev/zero', '/dev/zero'), ('models/two.yaml', other),
        ):  # fmt: skip
            assert words in node.refused_value('model_file', name)
        assert node.set('model_file', '').successful
        assert live(node) == 'live.yaml'
