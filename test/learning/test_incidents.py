from dataclasses import replace
import re

import numpy as np
import pytest

from wrist_ft_comp.learning.days import DayEntry
from wrist_ft_comp.learning.incidents import describe, incident, pause

TOOL = {'mass_kg': 2.5, 'center_m': (0.02, 0.0, 0.2)}


@pytest.fixture
def before(separated):
    return [describe(separated(number)) for number in (1, 2, 3)]


@pytest.fixture
def jumped(separated):
    """A day on which the zero jumps by hundreds of standard deviations."""
    return separated(9, jump=5.0)


def named(day, before):
    return incident(day, describe(day), before)


def test_ordinary_days_and_the_day_after_another_tool_are_no_incidents(separated, before):
    for number, past in enumerate(before, 1):
        assert incident(separated(number), past, before[: number - 1]) == ('', '')
    changed = replace(describe(separated(9, **TOOL)), kind='tool', incident='Another tool.')
    assert named(separated(10, **TOOL), [*before, changed]) == ('', '')


def test_a_heavier_tool_has_a_noise_of_its_own(separated, before):
    """At 20 kg, the noise of the accelerometer is five times that of the days before."""
    days, kinds = list(before), []
    for number, noise in (9, 0.02), (10, 0.02), (11, 0.02), (12, 1.0):
        day = separated(number, **{**TOOL, 'mass_kg': 20.0}, noise=noise)
        kinds.append(named(day, days)[0])
        days.append(replace(describe(day), kind=kinds[-1], incident=kinds[-1]))
    assert kinds == ['tool', '', '', 'contacts']


@pytest.mark.parametrize(('properties', 'kind', 'said'), [
    ({'jump': 5.0}, 'zero', 'by 5, -5, 3, '),
    ({'gain': 1.2}, 'sensor', 'weigh 1.20 times'),
    ({'gain': 0.8, 'turned_deg': 40.0}, 'sensor', 'weigh 0.80 times what they did (1.20 kg'),
    ({'noise': 0.2}, 'contacts', 'times that of the days before: noise'),
    ({'turned_deg': 20.0}, 'sensor', 'turned by 20°'),
    (TOOL, 'tool', '2.50 kg, before 1.5'),
    ({'stopped': True}, 'thermometer', 'Thermometer 2 reads 19.8 °C all the time'),
])  # fmt: skip
def test_an_incident_is_named_with_its_size(separated, before, properties, kind, said):
    found, sentence = named(separated(9, **properties), before)
    assert found == kind
    assert said in sentence


def test_a_day_in_contact_is_named(separated, before):
    for more in {'contact': 0.7}, {'unexplained': 0.2}:
        assert incident(replace(separated(3), **more), before[-1], before[:-1])[0] == 'contacts'


def test_drift_that_no_thermometer_sees_is_no_noise(separated, before):
    """A model of the day itself would answer it with the noise of the thermometers."""
    assert named(separated(3, unseen=200.0, cells=3660), before) == ('', '')


def test_a_weight_that_is_lost_on_two_days_is_another_gain_once(separated, before):
    day = replace(separated(3), payloads=None, doubt='It is crooked.')
    lost, unreadable = replace(before[-1], payloads=()), DayEntry('day', kind='unreadable')
    said = replace(lost, kind='sensor', incident='lost')
    for since, kind in (
        ([], ''), ([unreadable], ''), ([lost], 'sensor'), ([lost, unreadable], 'sensor'),
        ([lost, said], ''), ([lost, said, lost, lost], ''), ([lost, said, before[0]], ''),
        ([lost, said, before[0], lost], 'sensor'),
    ):  # fmt: skip
        assert incident(day, lost, [*before, *since])[0] == kind


@pytest.mark.parametrize(
    ('fault', 'said'),
    [('silent', '2 of .* is silent'), ('frozen', '2 of .* keeps one'), ('loose', '2 .* by -5')],
)
def test_a_thermometer_that_fails_within_the_day_is_named(separated, before, fault, said):
    day = separated(9, cells=1200)
    measured, temperature_c = day.recording.measured.copy(), day.recording.temperature_c.copy()
    measured[500:, 1] = fault != 'silent'
    temperature_c[500:, 1] = temperature_c[500, 1]
    if fault == 'loose':
        temperature_c[500:, 1] = day.recording.temperature_c[500:, 1] - 5
    recording = replace(day.recording, measured=measured, temperature_c=temperature_c)
    kind, sentence = incident(replace(day, recording=recording), describe(day), before)
    assert kind == 'thermometer'
    assert re.search(said, sentence), sentence


def with_raw(day, wrench):
    return replace(day, recording=replace(day.recording, wrench=wrench))


def tared(day, step):
    raw = day.recording.wrench
    return with_raw(day, raw - raw[step.cell - 3 : step.cell].mean(axis=0) - step.jump)


def tared_in_motion(day, step):
    """The robot goes from one pose to another while the driver tares."""
    raw = day.recording.wrench
    before, after = raw[step.cell - 1], raw[step.cell] - step.jump
    return with_raw(day, raw - (0.4 * before + 0.6 * after) - step.jump)


def pressed_from_then_on(day, step):
    free = day.drift.wrench.copy()
    free[step.cell : step.cell + 400] = np.nan
    return replace(day, drift=replace(day.drift, wrench=free))


@pytest.mark.parametrize('harmless', [tared, tared_in_motion, pressed_from_then_on])
def test_a_step_that_is_no_jump_of_the_zero_is_no_incident(jumped, before, harmless):
    assert named(harmless(jumped, *jumped.steps), before) == ('', '')


@pytest.mark.parametrize('missed', [0.3, 0.7])
def test_a_jump_that_leaves_a_share_of_itself_is_no_tare(jumped, before, missed):
    (step,) = jumped.steps
    raw = jumped.recording.wrench
    day = with_raw(jumped, raw - raw[step.cell - 1] - (1 - missed) * step.jump)
    assert named(day, before)[0] == 'zero'


def test_a_jump_matters_where_an_axis_drifts_by_less_than_five_times_it(jumped, before):
    entry = describe(jumped)
    drift = np.array(entry.left['none']) * [1, 100, 100, 100, 100, 100]
    for factor, kind in (1, 'zero'), (100, ''):
        less = replace(entry, left={'none': tuple(factor * drift)})
        assert incident(jumped, less, before)[0] == kind


def days(*kinds):
    return [DayEntry(f'day_{n}', kind=kind, incident=kind) for n, kind in enumerate(kinds)]


def test_learning_stops_until_three_days_agree_or_a_person_decides():
    for kind in 'zero', 'sensor':
        assert f'day_1: {kind}' in pause(days('', kind), '')
        assert '(2 so far)' in pause(days('', kind, '', 'tool'), '')
        assert pause(days('', kind, '', kind, '', ''), '')
        assert pause(days('', kind, '', 'thermometer', '', 'tool'), '') == ''
        assert pause(days('', kind, ''), 'day_0')
        assert pause(days('', kind, ''), 'day_1') == ''
    assert pause(days('tool', 'contacts', 'thermometer', 'unreadable'), '') == ''
