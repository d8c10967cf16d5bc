"""Entries of temperature topics, and the numbers they find in messages."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.wire.temperature_source import (
    header_stamp_ns,
    may_be_temperature,
    numbers_in,
    parse_source,
    parse_sources,
    path_text,
    TemperatureSource,
)


@pytest.mark.parametrize(
    ('entry', 'source'),
    [
        ('temperature', TemperatureSource('temperature')),
        (' /bus0/ft_sensor0/temperature ', TemperatureSource('/bus0/ft_sensor0/temperature')),
        ('~/temperature', TemperatureSource('~/temperature')),
        ('/{ns}/temperature', TemperatureSource('/{ns}/temperature')),
        ('/bota/frame:temperature', TemperatureSource('/bota/frame', ('temperature',))),
        ('/joints:data[5]:K', TemperatureSource('/joints', ('data', 5), 'K')),
        ('/joints:data.5:C', TemperatureSource('/joints', ('data', 5))),
        ('/a:b[2].c.d_1:F', TemperatureSource('/a', ('b', 2, 'c', 'd_1'), 'F')),
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
        (':data', 'does not begin with the name of a topic'),
        ('{bad}', 'does not begin with the name of a topic; expected TOPIC of sensor_msgs/Temp'),
        ('/9a', 'name of a topic'),
        ('/a/', 'name of a topic'),
        ('/a b', 'name of a topic'),
        ('/a.temperature', 'Did you mean /a:temperature'),
        ('/a:', 'cannot be understood; expected TOPIC'),
        ('/a::K', 'cannot be understood'),
        ('/a:b:K:C', 'cannot be understood'),
        ('/a:b:k', "in the unit 'k'; expected C, K or F"),
        ('/a:b:', "in the unit ''; expected C, K or F"),
        ('/a:K', 'names a unit and no field.*/a:temperature:K'),
        ('/a:3', "holds '3' where the name of a field is expected"),
        ('/a:[3]', "holds '' where the name of a field is expected"),
        ('/a:b..c', "holds '' where the name of a field or an index from 0 on is expected"),
        ('/a:b[-1]', r"holds 'b\[-1\]' where"),
        ('/a:b[]', r"holds 'b\[\]' where"),
        ('/a:b[3]c', "holds '3c' where"),
        ('/a:b c', "holds 'b c' where"),
    ],
)
def test_a_wrong_entry_gets_its_sentence(entry, sentence):
    with pytest.raises(SettingsError, match=sentence) as raised:
        parse_source(entry)
    assert repr(entry) in str(raised.value)


def test_the_same_number_twice_is_refused():
    entries = ['/a', '/b', '/a:data[1]', '/a:data[2]', 'a']
    assert [source.entry for source in parse_sources(entries)] == entries
    for twice in (['/a', '/a'], ['/a:data.1', '/a:data[1]:K'], ['/a', '/a:temperature']):
        with pytest.raises(SettingsError, match=f"'{twice[0]}' and .* one and the same"):
            parse_sources(twice)
    with pytest.raises(SettingsError, match="'/a' and 'a' are one and the same"):
        parse_sources(['/a', 'a'], resolve=lambda name: f'/{name.strip("/")}')


class Message:
    """As rclpy makes it."""

    def get_fields_and_field_types(self):
        return dict.fromkeys(self.__dataclass_fields__)


@dataclass
class Header(Message):
    stamp: object = field(default_factory=lambda: SimpleNamespace(sec=3, nanosec=7))
    seq: int = 4


@dataclass
class Joint(Message):
    motor_temp: float = 40.0
    name: str = 'elbow'
    enabled: bool = True


@dataclass
class State(Message):
    header: Header = field(default_factory=Header)
    temperature: object = np.float32(300.0)
    data: object = field(default_factory=lambda: np.array([20.0, 21.0, np.nan]))
    joints: list[Joint] = field(default_factory=lambda: [Joint(), Joint(41.0)])
    empty: list[float] = field(default_factory=list)


@pytest.mark.parametrize(
    ('entry', 'celsius'),
    [
        ('/s', 300.0),
        ('/s:temperature:K', 26.85),
        ('/s:data[1]', 21.0),
        ('/s:joints.1.motor_temp:F', 5.0),
        ('/s:header.seq', 4.0),
    ],
)
def test_a_number_is_found_anywhere_in_a_message(entry, celsius):
    read = parse_source(entry).read(State())
    assert isinstance(read, float)
    assert read == pytest.approx(celsius)


@pytest.mark.parametrize(
    ('entry', 'sentence'),
    [
        ('/s:temprature', 'the message has no field temprature. Its numbers are temperature, '),
        ('/s:data', 'data is an array of 3, and no index is named; expected an index from 0 to 2'),
        ('/s:data[3]', 'array of 3, and there is no element 3; expected an index from 0 to 2'),
        ('/s:data.size', 'there is no element size'),
        ('/s:data[2]', 'is nan; expected a finite number'),
        ('/s:empty[0]', r'empty is an array of 0, and there is no element 0\. Its'),
        ('/s:joints[0]', r'joints\[0\] is no number.*joints\[0\]\.motor_temp'),
        ('/s:joints[0].name', r'joints\[0\].name is no number'),
        ('/s:joints[0].enabled', r'joints\[0\].enabled is no number'),
        ('/s:joints[0].motor', r'joints\[0\] has no field motor. Its .*joints\[0\].motor_temp'),
        ('/s:temperature.real', 'temperature has no field real'),
        ('/s:temperature[0]', 'temperature has no element 0'),
        ('/s:header[0]', 'header has no element 0'),
    ],
)
def test_the_sentence_for_a_missing_number_names_the_fields_there_are(entry, sentence):
    with pytest.raises(SettingsError, match=sentence) as raised:
        parse_source(entry).read(State())
    assert repr(entry) in str(raised.value)


def test_a_message_with_many_numbers_names_those_that_look_right_first():
    @dataclass
    class Image(Message):
        data: object = field(default_factory=lambda: np.zeros(100_000))
        sensor_temp: float = 1.0

    with pytest.raises(SettingsError, match=r'numbers are sensor_temp, data.* and 93 more\.'):
        parse_source('/image:heat').read(Image())
    with pytest.raises(SettingsError, match='holds no number at all'):
        parse_source('/text').read(SimpleNamespace(data='hello'))


def test_all_numbers_but_the_headers_are_found_with_their_paths():
    found = {path_text(path): value for path, value in numbers_in(State())}
    assert list(found) == [
        'temperature', 'data[0]', 'data[1]', 'data[2]', 'joints[0].motor_temp',
        'joints[1].motor_temp',
    ]  # fmt: skip
    assert found['joints[1].motor_temp'] == 41.0


def test_the_stamp_is_the_headers_where_it_was_filled():
    assert header_stamp_ns(State()) == 3_000_000_007
    assert header_stamp_ns(Joint()) is None
    unfilled = Header(SimpleNamespace(sec=0, nanosec=0))
    assert header_stamp_ns(State(unfilled)) == 0


@pytest.mark.parametrize(
    ('name', 'telling'),
    [
        ('temperature', True), ('tool_temp', True), ('motorTemperature', True), ('temp_2', True),
        ('thermocouple', True), ('template', False), ('attempts', False), ('temporary', False),
        ('force', False),
    ],
)  # fmt: skip
def test_a_field_may_be_a_temperature_by_its_name(name, telling):
    assert may_be_temperature(('joints', 2, name)) is telling
    assert may_be_temperature((name, 0)) is telling
