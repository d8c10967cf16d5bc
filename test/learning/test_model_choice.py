from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from wrist_ft_comp.errors import CalibrationRefusedError, RecordingError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.learning import model_choice
from wrist_ft_comp.learning.days import DayEntry, NONE, worthiest
from wrist_ft_comp.learning.incidents import describe, left, look_at
from wrist_ft_comp.learning.model_choice import (
    Champion,
    compare,
    covers,
    describe_day,
    reason,
    take,
)
from wrist_ft_comp.report.evaluation import judge_errors, tared_errors
from wrist_ft_comp.stream.drift_of_recordings import streamed_drift

QUICK = CalibrationSettings(identification=IdentificationSettings('pls', degree=1))
NAMES = [f'day_{number:05d}.csv' for number in range(20)]


@pytest.fixture
def look(separated):
    return lambda name: separated(int(name[4:9]))


@pytest.fixture(scope='module')
def good(separated):
    days = [separated(n).drift for n in (1, 2)]
    return calibrate(days, replace(QUICK, reference='recorded')).model


def past(look, champion, *numbers):
    entries = []
    for number in numbers:
        entries.append(describe_day(NAMES[number], look, entries, champion))
    return entries


def test_all_days_replace_the_live_model_unless_they_leave_clearly_more(look, good, monkeypatch):
    champion = Champion('a' * 12, good)
    before = past(look, champion, 1, 2, 3, 4)
    for ratio, chosen, taken in (
        (1.2, '', True), (1.3, '', False), (0.9, NAMES[1], True), (1.2, NAMES[1], False),
    ):  # fmt: skip
        monkeypatch.setattr(model_choice, 'compare', lambda *_, ratio=ratio: (ratio, 2))
        days = before[: 4 if chosen else 3]
        choice = take(NAMES[len(days) + 1], look, days, champion, NAMES[:6], chosen, QUICK)
        assert choice.entry.challenged
        assert taken == (choice.better is not None)
        assert ('It is not used' in choice.entry.verdict) != taken


def test_days_at_rest_do_not_replace_a_model_that_knows_work(look, good):
    def wider(axis):
        upper_c = axis.range_c[1] + 3 * np.ptp(axis.range_c, axis=0)
        return replace(axis, features=replace(axis.features, upper_c=upper_c))

    known = replace(good, axes={name: wider(axis) for name, axis in good.axes.items()})
    choice = take(
        NAMES[4], look, past(look, Champion('a' * 12, known), 1, 2, 3),
        Champion('a' * 12, known), NAMES[:6], '', QUICK)  # fmt: skip
    assert choice.better is None
    assert 'its days warmed by less than half of what the live model knows' in choice.entry.verdict


def test_summer_days_replace_a_winter_model(good):
    axis = next(iter(good.axes.values()))
    found = SimpleNamespace(temperature_range_c=np.array(axis.range_c).T + 25.0)
    assert covers(found, good)


def test_days_before_a_decision_do_not_bring_a_model_back(look, good):
    """Three good days after it do, where the chosen model leaves more: it corrects twice."""

    def doubled(axis):
        weight = axis.dynamics.output_weight / 2
        return replace(axis, dynamics=replace(axis.dynamics, output_weight=weight))

    bad = replace(good, axes={name: doubled(axis) for name, axis in good.axes.items()})
    champion = Champion('a' * 12, bad, NAMES[1])
    for number, learnt in ((4, False), (5, True)):
        before = past(look, champion, *range(1, number))
        choice = take(NAMES[number], look, before, champion, NAMES, NAMES[2], QUICK)
        assert (choice.entry.challenged, choice.better is not None) == (learnt, learnt)
        assert ('On 3 days' if learnt else '2 of them have passed') in choice.entry.verdict


def test_nothing_is_learnt_from_an_incident_nor_while_learning_has_stopped(look, separated):
    before = past(look, Champion(), 1, 2)
    hit = take(NAMES[9], lambda _: separated(9, jump=5.0), before, Champion(), NAMES)
    assert (hit.better, hit.entry.kind) == (None, 'zero')
    after = take(NAMES[10], look, [*before, hit.entry], Champion(), NAMES)
    assert (after.better, after.entry.kind) == (None, '')
    assert 'No model was learnt' in after.entry.verdict


@pytest.mark.parametrize('half', [60, 100, 140])
def test_a_jump_between_minutes_of_contact_is_named_and_not_learnt_from(look, recorded, half):
    day = recorded(9, cells=3700, contact=0.2)
    cells, rng = np.arange(3700), np.random.default_rng(9)
    pressed = (np.abs(cells - 2000) < half) * (1 + 0.05 * rng.normal(size=3700))
    wrench = day.wrench + np.outer(pressed, [6.0, -4.0, -35.0, 1.0, 2.0, 0.3])
    wrench[2000:] += [40.0, 32.0, 61.0, 1.0, -2.0, 0.5]
    hit = look_at(replace(day, wrench=wrench))
    choice = take(NAMES[9], lambda _: hit, past(look, Champion(), 1, 2), Champion(), NAMES)
    assert (choice.better, choice.entry.kind) == (None, 'zero')
    if half > 100:  # contact for nine minutes: part of the press is in the size that is named
        return
    named = choice.entry.incident.split(' by ')[1].split(' (N')[0].split(', ')
    np.testing.assert_allclose([float(size) for size in named[:3]], [40, 32, 61], rtol=0.12)


def test_a_day_that_cannot_be_read_is_named_and_others_are_learnt_from(look):
    damaged = NAMES[1:3]

    def look_at_rest(error, name):
        if name in damaged:
            raise error(f'{name} is damaged.')
        return look(name)

    for error in (RecordingError, IndexError, np.linalg.LinAlgError):
        entry = describe_day(NAMES[1], partial(look_at_rest, error), [], Champion())
        assert entry.kind == 'unreadable'
        assert 'day_00001.csv is damaged.' in entry.incident
    before = past(look, Champion(), 1, 2, 3, 4)
    damaged_look = partial(look_at_rest, RecordingError)
    choice = take(NAMES[5], damaged_look, before, Champion(), NAMES, settings=QUICK)
    assert choice.days == tuple(NAMES[3:6])


def test_a_day_without_a_cell_free_of_contact_is_no_dead_sensor(look):
    def pressed(name):
        day = look(name)
        nothing = np.full_like(day.drift.wrench, np.nan)
        return replace(day, drift=replace(day.drift, wrench=nothing))

    entry = describe_day(NAMES[1], pressed, [], Champion())
    assert (entry.kind, entry.payloads != ()) == ('contacts', True)
    assert 'No cell of the day was free of contact' in entry.incident


def test_a_day_on_which_a_thermometer_lies_is_not_learnt_from(look, good, monkeypatch):
    doubts = {'thermometer 2 reads +3.0 K beside': 1.0}
    monkeypatch.setattr(model_choice, 'thermometer_doubts', lambda *_: doubts)
    champion = Champion('a' * 12, good)
    entry = describe_day(NAMES[3], look, past(look, champion, 1, 2), champion)
    assert (entry.kind, 'thermometer 2 reads' in entry.incident) == ('thermometer', True)


def test_a_day_on_which_the_live_model_breaks_its_limit_is_said_and_learnt_from(look, good):
    for limit_n, is_said in ((1e-3, True), (1.0, False)):
        champion = Champion('a' * 12, replace(good, day_limits={'force_z': limit_n}))
        entry = describe_day(NAMES[3], look, past(look, champion, 1, 2), champion)
        assert (entry.kind, 'left more of force_z' in entry.incident) == ('', is_said)


def test_the_drift_left_is_that_of_evaluate(separated, good):
    day = separated(3)
    figures = judge_errors([tared_errors(good, day.recording, 'payload')])
    before = np.array([axis.rms_before for axis in figures.values()])
    after = np.array([axis.rms_after for axis in figures.values()])
    np.testing.assert_allclose(describe(day).left[NONE], before, rtol=0.03)
    np.testing.assert_allclose(left(streamed_drift(good, day.drift), day), after, rtol=0.06)


def test_a_new_model_is_compared_on_days_that_neither_learnt_from():
    days = [DayEntry(name, left={NONE: (2.0,) * 6, 'a': (0.4,) * 6}) for name in NAMES[:4]]
    errors = np.full((4, 6), 0.1)
    errors[0] = 2.0  # the live model was learnt from this one
    errors[:, 5] = np.nan
    # With a hundredth of a usual day's drift added to both.
    assert compare(days, errors, 'a', NAMES[0]) == (pytest.approx(0.12 / 0.42), 3)
    assert compare(days, errors, '', NAMES[0]) == (pytest.approx(0.12 / 2.02), 3)
    with pytest.raises(CalibrationRefusedError):
        compare(days, errors, 'another', '')


def test_a_live_model_for_other_thermometers_is_named(look, good):
    other = Champion('a' * 12, replace(good, period_ns=1))
    choice = take(NAMES[3], look, past(look, other, 1, 2), other, NAMES, settings=QUICK)
    assert (choice.better, choice.entry.kind) == (None, '')
    assert 'for other thermometers' in choice.entry.verdict


def entries(count, **more):
    return [DayEntry(name, known=((1, 1),), left={NONE: (1.0,) * 6, 'a': (0.1,) * 6},
                     live='a', **more) for name in NAMES[:count]]  # fmt: skip


def test_new_models_become_rarer_as_the_diary_grows():
    diary, challenged, said = [], [], []
    for number in range(120):
        diary.append(replace(entries(1)[0], name=f'day_{number:05d}.csv'))
        due, why = reason(diary, 'a')
        if due:
            diary[-1] = replace(diary[-1], challenged=True)
            challenged.append(number + 1)
            said.append(why)
    assert said[2:4] == ['1 more good day', '2 more good days']
    assert challenged == [2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48, 64, 86, 115]


def test_a_bad_day_is_a_reason():
    learnt = replace(entries(12)[10], challenged=True)
    days, last = [*entries(10), learnt], entries(12)[11]
    worse = replace(last, left={NONE: (1.0,) * 6, 'a': (0.9,) * 6})
    for diary, live, due, words in (
        ([*days, last], 'a', False, 'after 3 more good days, or after a day'),
        ([*days, worse], 'a', True, 'badly'),
        (entries(20), '', True, 'no model is live'),
        (entries(1), 'a', False, 'One more good day'),
    ):
        found, sentence = reason(diary, live)
        assert found == due
        assert words in sentence


def test_newer_days_and_those_with_temperatures_of_no_other_day_are_kept():
    diary = entries(6)
    diary[1] = replace(diary[1], known=((9, 0),))
    diary[4] = replace(diary[4], kind='contacts', known=((5, 5),))
    assert [day.name for day in worthiest(diary, 3)] == [NAMES[1], NAMES[3], NAMES[5]]
    assert [day.name for day in worthiest(diary, 2)] == [NAMES[1], NAMES[5]]
