"""Entries that name a temperature: paths, factors, units, and what is said of wrong ones."""

import re

import numpy as np
import pytest

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.wire import temperature_source as sources
from wrist_ft_comp.wire.numbers_in_messages import follow
from wrist_ft_comp.wire.temperature_source import parse_source, TemperatureSource


@pytest.mark.parametrize(
    ('entry', 'source'),
    [
        (' /bus0/ft_sensor0/temperature ', TemperatureSource('/bus0/ft_sensor0/temperature')),
        ('~/temperature', TemperatureSource('~/temperature')),
        ('/{ns}/temperature', TemperatureSource('/{ns}/temperature')),
        ('/joints:data.5:C', TemperatureSource('/joints', ('data', 5))),
        ('/a:b[2].c.d_1:F', TemperatureSource('/a', ('b', 2, 'c', 'd_1'), 'F')),
        ('/a:b*1e-2:K', TemperatureSource('/a', ('b',), 'K', 0.01)),
        ('/a:b[0][1]', TemperatureSource('/a', ('b', 0, 1))),
        ('/a:k', TemperatureSource('/a', ('k',))),
    ],
)
def test_an_entry_names_topic_path_and_unit(entry, source):
    assert parse_source(entry) == source
    assert parse_source(entry).entry == entry.strip()


@pytest.mark.parametrize(
    ('entry', 'sentence'),
    [
        ('', "'' does not begin with the name of a topic"),
        (':data', 'name of a topic'),
        ('{bad}', 'name of a topic'),
        ('/9a', 'name of a topic'),
        ('/a.temperature', 'Did you mean /a:temperature'),
        ('/a*0.1', 'name of a topic'),
        *(
            (f'/a:{inside}', 'cannot be understood behind its topic; expected TOPIC .*C, K or F')
            for inside in ('', 'b:k', 'K', '3', 'b[-1]', 'b[3]c', 'b.3c', 'b:K*0.1', 'b..c')
        ),
        *((f'/a:{factor}', 'A factor is a number') for factor in ('b*', 'b*x', 'b*0', 'b*nan')),
    ],
)
def test_a_wrong_entry_gets_its_sentence(entry, sentence):
    with pytest.raises(SettingsError, match=sentence) as raised:
        parse_source(entry)
    assert repr(entry) in str(raised.value)


def test_the_same_number_twice_is_refused():
    entries = ['/a', '/b', '/a:data[1]', '/a:data[2]', 'a']
    assert [source.entry for source in sources.parse_sources(entries)] == entries
    for twice in (['/a', '/a'], ['/a:data.1', '/a:data[1]:K'], ['/a', '/a:temperature']):
        with pytest.raises(SettingsError, match=f"'{twice[0]}' and .* one and the same"):
            sources.parse_sources(twice)
    with pytest.raises(SettingsError, match="'/a' and 'a' are one and the same"):
        sources.parse_sources(['/a', 'a'], resolve=lambda name: f'/{name.strip("/")}')


BIG = """
float64[] data
float32 sensor_temp
"""


@pytest.fixture
def state(frame, define):
    """A message with numbers of every kind, two motors in it."""
    content = frame(6, heat=np.array([20.0, 21.0, np.nan]))
    return follow(define(frame.kind), frame.kind, content)


@pytest.mark.parametrize(('entry', 'celsius'), [
    ('/s', 26.0), ('/s:raw[0]*0.1', 0.6), ('/s:temperature*11:K', 12.85),
    ('/s:motors.1.heat[0]:F', -20 / 3), ('/s:header.stamp.nanosec', 6.0),
])  # fmt: skip
def test_a_number_is_found_anywhere_in_a_message(state, entry, celsius):
    source = parse_source(entry)
    number = state.find(source.number).values(np.frombuffer(state.data, np.uint8)[np.newaxis])[0]
    assert source.celsius(number) == pytest.approx(celsius)


@pytest.mark.parametrize(
    ('entry', 'sentence'),
    [
        ('/s:temprature', 'the numbers there are temperature, motors'),
        ('/s:motors[0].heat[2]', 'is NaN or infinite; expected a finite number'),
        *(
            (f'/s:{entry}', 'is not there: the numbers there are')
            for entry in ('raw[2]', 'motors[2]', 'motors[0]', 'on', 'temperature[0]', 'raw[arm]')
        ),
    ],
)
def test_the_sentence_for_a_missing_number_names_the_fields_there_are(state, entry, sentence):
    said = parse_source(entry).missing(state)
    assert sentence in said
    assert repr(entry) in said


def test_a_message_with_many_numbers_names_those_that_look_right_first(messages, define):
    kind = messages.learn('a_msgs/msg/Big', BIG)
    image = follow(define(kind), kind, messages.pack(kind, np.zeros(100_000), 1.0))
    said = parse_source('/image:heat').missing(image)
    assert re.search(r'numbers there are sensor_temp, data.* and 93 more\.', said)
    kind = 'std_msgs/msg/String'
    text = follow(define(kind), kind, messages.pack(kind, 'hello'))
    assert 'the numbers there are none.' in parse_source('/text').missing(text)


def test_all_numbers_but_the_headers_are_found_with_their_paths(state):
    parts = 'mode', 'heat[0]', 'heat[1]', 'heat[2]'
    assert [sources.path_text(path) for path in sources.numbers_in(state)] == [
        *(f'motors[{n}].{part}' for n in (0, 1) for part in parts), 'raw[0]', 'raw[1]',
        'temperature', 'counter',
    ]  # fmt: skip


@pytest.mark.parametrize(('name', 'telling'), [
    ('temperature', True), ('tool_temp', True), ('motorTemperature', True), ('temp_2', True),
    ('thermocouple', True), ('template', False), ('attempts', False), ('temporary', False),
    ('force', False),
])  # fmt: skip
def test_a_field_may_be_a_temperature_by_its_name(name, telling):
    assert sources.may_be_temperature(('joints', 2, name)) is telling
    assert sources.may_be_temperature((name, 0)) is telling
