from dataclasses import asdict
import json
import os

import pytest

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.stored.model_store import HistoryEntry

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
OK, WARN, ERROR = b'\0', b'\1', b'\2'


def live(node):
    """Name of the live model, as the node and its diagnostics have it."""
    stored = node.node.live.stored
    shown = node.diagnosis('model').values
    assert shown.get('file') == (None if stored is None else str(stored.path))
    assert shown.get('sha256') == (None if stored is None else stored.sha256)
    return None if stored is None else stored.path.name


def remember(node_or_directory, *names):
    directory = getattr(node_or_directory, 'directory', node_or_directory)
    directory.mkdir(exist_ok=True, parents=True)
    entries = [{**asdict(HistoryEntry(None)), 'path': f'models/{name}'} for name in names]
    document = {'format': 'wrist_ft_comp live models', 'version': 1, 'history': entries}
    (directory / 'active.json').write_text(json.dumps(document))


class TestRollback:
    def test_a_rollback_goes_back_model_by_model_to_none_and_no_further(self, rig, make_model):
        for name in ('a.yaml', 'b.yaml'):
            make_model(name)
        node = rig()
        for name in ('a.yaml', 'b.yaml', 'b.yaml'):  # twice is one step back
            assert node.set('model_file', f'models/{name}').successful
        assert live(node) == 'b.yaml'
        answer = node.call('rollback')
        assert answer.success
        assert answer.message == f'compensating with {node.directory / "models/a.yaml"} again'
        assert live(node) == 'a.yaml'
        answer = node.call('rollback')
        assert answer.message == 'no model was live before: wrenches pass uncompensated'
        assert live(node) is None
        assert node.refusal('rollback').startswith('There is no earlier model to go back to')

    def test_a_rollback_passes_over_a_model_that_cannot_be_used(self, rig, make_model):
        for name in ('a.yaml', 'c.yaml'):
            make_model(name)
        node = rig()
        remember(node, 'a.yaml', 'gone.yaml', 'c.yaml')
        node = rig()
        sentence = node.refusal('rollback')
        assert 'gone.yaml cannot be read: No such file' in sentence
        assert 'The running model stays; call again for the model before' in sentence
        assert live(node) == 'c.yaml'
        assert node.call('rollback').success
        assert live(node) == 'a.yaml'

    def test_every_change_is_kept_with_its_date_and_reason(self, rig, make_model):
        for name in ('a.yaml', 'b.yaml'):
            make_model(name)
        node = rig()
        for name in ('a.yaml', 'b.yaml', 'b.yaml'):
            assert node.set('model_file', f'models/{name}').successful
        assert node.call('rollback').success
        make_model('a.yaml', {'force_x': (2.0, 0, 0)})
        assert node.set('model_file', 'models/a.yaml').successful
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
        assert rig().node.live.history == node.node.live.history
        assert node.call('rollback').success
        assert live(node) is None


class TestRestart:
    def test_a_restart_with_a_broken_list_has_no_model(self, rig, make_model, capfd):
        model = make_model('a.yaml')
        (model.path.parents[1] / 'active.json').write_text('{')
        node = rig()
        status = node.diagnosis('model', 'The last model cannot be used: ')
        assert status.level == ERROR
        assert 'active.json' in status.message
        assert 'Remove it and set model_file.' in capfd.readouterr().err
        assert node.ask_output(START, [1.0] * 6) == (1.0,) * 6
        assert node.set('model_file', 'models/a.yaml').successful
        assert node.diagnosis('model', lambda status: status.level == OK)
        assert live(rig()) == 'a.yaml'


class TestNewestDecision:
    """What is live after a restart when a model_file is given at start."""

    def test_a_calibration_after_the_last_start_goes_on(self, rig, make_model, capfd):
        given, later = make_model('given.yaml'), make_model('later.yaml', {'force_x': (1, 0, 0)})
        parameters = {'model_file': str(given.path)}
        first = rig(parameters=parameters)
        assert live(first) == 'given.yaml'
        first.node.live.take(later, 'calibrated')
        again = rig(parameters=parameters)
        assert live(again) == 'later.yaml'
        assert 'was made live after that: the latter goes on' in capfd.readouterr().err
        assert again.call('rollback').success
        assert live(again) == 'given.yaml'
        assert live(rig(parameters=parameters)) == 'given.yaml'

    def test_another_model_file_is_a_new_decision(self, rig, make_model):
        for number, name in enumerate('abc', start=1):
            make_model(f'{name}.yaml', {'force_x': (float(number), 0, 0)})
        for name in 'abca':
            node = rig(parameters={'model_file': f'models/{name}.yaml'})
            assert live(node) == f'{name}.yaml'
        assert node.call('rollback').success
        assert live(node) == 'c.yaml'

    def test_the_model_file_stands_in_for_a_later_one_that_cannot_be_used(self, rig, make_model):
        given, later = make_model('given.yaml'), make_model('later.yaml', {'force_x': (1, 0, 0)})
        parameters = {'model_file': str(given.path)}
        rig(parameters=parameters).node.live.take(later, 'calibrated')
        later.path.unlink()
        assert live(rig(parameters=parameters)) == 'given.yaml'


class TestModelFile:
    def test_a_model_for_other_thermometers_is_an_error(self, rig, make_model):
        model = make_model('two.yaml', thermometers=2)
        with pytest.raises(SettingsError, match='expects 2 thermometers, the node has 1'):
            rig(model=model)
        node = rig()
        sentence = node.refused_value('model_file', str(model.path))
        assert 'expects 2 thermometers, the node has 1' in sentence

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

    def test_a_model_file_that_cannot_be_used_is_refused_at_run_time(self, rig, make_model):
        node = rig(model=make_model('live.yaml'))
        (node.directory / 'models/other.yaml').write_text('format: other')
        (node.directory / 'loop.yaml').symlink_to(node.directory / 'loop.yaml')
        os.mkfifo(node.directory / 'pipe.yaml')
        for name, words in (
            ('models/missing.yaml', 'missing.yaml'), ('models/other.yaml', 'other.yaml'),
            ('pipe.yaml', 'is no regular file'), ('loop.yaml', 'loop.yaml'),
            ('~nobody_of_this_name/a.yaml', '~nobody'), ('x' * 5000, 'xxx'), ('.', ''),
            ('/dev/zero', '/dev/zero'),
        ):  # fmt: skip
            assert words in node.refused_value('model_file', name)
        assert node.set('model_file', '').successful
        assert live(node) == 'live.yaml'
