"""What a node that learns does with what its job found, and what it says."""

from moments import OK, WARN
import numpy as np
import pytest

from wrist_ft_comp.errors import ModelFileError
from wrist_ft_comp.learning.days import Memory

#: After all that was heard.
LATE = 1_800_000_000 * 10**9


@pytest.fixture
def models(make_model):
    """A model that is live and one that is better."""
    return make_model('old.yaml', {'force_z': (0.5, 0, 0)}), make_model('new.yaml')


@pytest.mark.parametrize(
    ('chosen', 'state', 'level', 'words'),
    [
        ({}, {}, OK, 'the day is being recorded; no better model is offered'),
        ({}, {'memory': Memory(offered='new.yaml')}, OK, 'a better model is offered'),
        ({}, {'memory': Memory(incident='it froze')}, WARN, 'it froze'),
        ({}, {'memory': Memory(incident='it froze', paused='a jump')}, WARN, 'a jump'),
        ({}, {'memory': Memory(paused='a jump'), 'problem': 'no disk'}, WARN, 'no disk'),
        ({'gravity.source': 'none'}, {}, WARN, 'they are payload and none'),
        ({'calibration.reference': 'constant'}, {}, WARN, 'they are constant and imu'),
    ],
)
def test_the_worst_is_said_first(learner, chosen, state, level, words):
    part = learner(**chosen).node.learning
    vars(part).update(state)
    (status,) = part.statuses()
    assert (status.level, words in status.message) == (level, True), status.message


def test_off_is_off(learner):
    node = learner(mode='off')
    node.hear(147)
    assert not node.rig.directory.exists() or not node.days.exists()
    assert not node.node.recorder._running, 'the force path has nothing to do'
    assert list(node.node.learning.statuses()) == []
    assert 'learning is off' in node.rig.call('adopt').message


def test_a_decision_ends_what_was_said_of_an_incident(learner, models):
    node, sentence = learner(), 'thermometer 1 stood still for 3.0 h'
    node.answer(success=True, message=sentence, incident=sentence, paused=sentence)
    node.a_day()
    assert node.rig.diagnosis('learning', sentence).level == WARN
    assert node.rig.set('model_file', str(models[1].path)).successful
    assert node.rig.diagnosis('learning', 'no better model is offered').level == OK


def test_a_day_that_has_ended_is_judged_once_at_the_lowest_priority(learner, models):
    node = learner(model_file=str(models[0].path))
    node.a_day()
    node.a_day()
    one, two = node.asked()
    names = [[path.rsplit('/', 1)[1] for path in job['recordings']] for job in (one, two)]
    assert names == [['day_00001.csv'], ['day_00001.csv', 'day_00002.csv']]
    (given,) = two['history']
    assert (given['path'], given['sha256']) == (str(models[0].path), models[0].sha256)
    assert two['max_mb'] == 400.0
    assert two['settings']['reference'] == 'payload'
    assert two['nice'] == 19
    status = node.rig.diagnosis('learning', 'no better model is offered')
    assert status.level == OK
    assert status.values['last_day'] == 'day_00002.csv: no better model'
    assert status.values['days'] == '2'
    assert node.node.live.sha256 == models[0].sha256, 'nothing else happens'


def test_a_better_model_is_offered_adopted_and_rolled_back(learner, models):
    old, new = models
    node = learner(model_file=str(old.path))
    said = 'No better model is offered: no day is judged yet. The running model stays.'
    assert node.rig.refusal('adopt') == said
    node.find(new, message='leaves half')
    node.a_day()
    status = node.rig.diagnosis('learning', 'a better model is offered')
    assert status.values['why'] == 'leaves half'
    assert status.values['report'].endswith('.html')
    node.node.destroy_node()

    node = learner(model_file=str(old.path))
    assert node.node.live.sha256 == old.sha256
    before = node.rig.ask_output(LATE, [5.0] * 6)
    answer = node.rig.call('adopt')
    assert answer.success, answer.message
    assert node.node.live.sha256 == new.sha256
    assert 'leaves half' in answer.message
    np.testing.assert_allclose(node.rig.ask_output(LATE, [5.0] * 6), before)
    node.rig.refusal('adopt')
    node.node.destroy_node()

    node = learner(model_file=str(old.path))
    assert node.node.live.sha256 == new.sha256, 'a decision outlives a restart'
    node.answer(success=True, message='nothing new')
    node.a_day()
    before, after = node.asked()[-1]['history']
    assert (before['day'], before['path']) == ('', str(old.path))
    assert (after['day'], after['how']) == ('day_00002.csv', 'chosen'), 'it ended the day'
    assert after['why'] == 'a person called ~/adopt: leaves half'
    assert after['path'] == str(node.node.live.stored.path)
    assert node.rig.call('rollback').success
    assert node.node.live.sha256 == old.sha256
    node.wait(lambda: node.node.learning.memory.champion == old.sha256, 'its notice')
    node.a_day()
    *_, back = node.asked()[-1]['history']
    assert (back['day'], back['how']) == ('day_00004.csv', 'back'), 'these do not bring it back'
    assert back['path'] == str(old.path)
    assert ' to old.yaml with ~/rollback' in node.rig.diagnosis('learning').values['last_change']


def test_auto_goes_live_without_a_step_but_not_while_learning_is_paused(learner, models):
    old, new = models
    node = learner(model_file=str(old.path), mode='auto')
    node.find(new, paused='zero of force_z jumped by 4 N')
    node.a_day()
    status = node.rig.diagnosis('learning', 'zero of force_z jumped by 4 N')
    assert status.level == WARN
    assert node.node.live.sha256 == old.sha256
    assert 'offered' in status.values
    node.find(new)
    node.hear(147)
    node.rig.outputs.queue.clear()
    before = node.rig.ask_output(LATE, [5.0] * 6)
    node.judged(2)
    assert node.node.live.sha256 == new.sha256
    np.testing.assert_allclose(node.rig.ask_output(LATE, [5.0] * 6), before)
    status = node.rig.diagnosis('learning', 'no better model is offered')
    assert 'live: leaves half' in status.values['last_change']
    assert 'offered' not in status.values
    node.a_day()
    *_, learnt = node.asked()[-1]['history']
    assert (learnt['how'], learnt['day']) == ('learnt', 'day_00002.csv'), 'nobody decided'


def test_a_model_that_cannot_be_made_live_is_only_offered(learner, models, monkeypatch):
    node = learner(model_file=str(models[0].path), mode='auto')
    node.find(models[1])
    refused = []

    def refuse(*_):
        refused.append('once')
        raise ModelFileError('No such model.')

    monkeypatch.setattr(node.node.live, 'take', refuse)
    node.a_day()
    assert node.rig.diagnosis('learning', 'No such model. The running model stays.').level == WARN
    node.rig.diagnosis('learning', lambda status: 'offered' in status.values)
    assert refused == ['once']


def test_a_calibration_goes_first(learner, models):
    node = learner(model_file=str(models[0].path))
    node.answer()
    node.hear(147)
    learning = node.node.learning
    node.wait(lambda: learning._judging is not None, 'the job')
    recording = node.rig.directory / 'recordings/one.csv'
    recording.parent.mkdir()
    recording.write_text('')
    answers = node.rig.ask('calibrate')
    node.wait(lambda: learning._judging is None, 'the end of the job')
    node.answer(success=False, message='refused')
    assert not node.rig.answered(answers).success
    assert node.node.live.sha256 == models[0].sha256
    node.wait(lambda: learning.memory.judged == 'day_00001.csv', 'the next job')


def test_a_job_that_fails_is_a_warning_until_the_next_day(learner):
    node = learner()
    node.answer(success=False, message='no temperature was seen')
    node.a_day()
    assert node.node.learning.memory.judged == 'day_00001.csv'
    assert node.rig.diagnosis('learning', 'no temperature was seen').level == WARN
    node.answer(success=True, message='no better model')
    node.a_day()
    assert node.rig.diagnosis('learning', 'no better model is offered').level == OK


@pytest.mark.parametrize('is_changed', [False, True])
def test_an_offered_model_that_is_missing_or_changed_is_refused(learner, models, is_changed):
    node = learner(model_file=str(models[0].path))
    node.find(models[1])
    node.a_day()
    path = node.node.learning.offered
    path.write_bytes(path.read_bytes() + b'# mine\n') if is_changed else path.unlink()
    sentence = node.rig.refusal('adopt')
    assert str(path) in sentence
    assert sentence.endswith('The running model stays.')
    assert node.node.live.sha256 == models[0].sha256
