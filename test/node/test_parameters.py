import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.ros.parameters import Parameter, Parameters

TABLE = (
    Parameter('flag', False, 'Whether.'),
    Parameter('count', 3, 'How many.', minimum=1, maximum=9),
    Parameter('speed', 1.0, 'How fast.', unit='m/s', minimum=0.0, maximum=1000.0),
    Parameter('positive', 2.0, 'No upper limit.', unit='N', minimum=0.0),
    Parameter('mode', 'slow', 'In which way.', choices=('slow', 'fast')),
    Parameter('label', '', 'Any text.', read_only=True),
    Parameter('topics', ('temperature',), 'Topics.'),
    Parameter('files', (), 'Files.', read_only=True),
    Parameter('levels', (0.5, 1.0), 'Levels.', minimum=0.0, maximum=1.0),
)
DEFAULTS = {row.name: row.default for row in TABLE}


class Example(Node):
    def __init__(self, **kwargs):
        super().__init__('example', use_global_arguments=False, **kwargs)
        self.table = Parameters(self, TABLE)


@pytest.fixture
def make(bench):
    def start(*chosen):
        rules = [word for one in chosen for word in ('-p', one)]
        return bench.make(Example, cli_args=['--ros-args', *rules])

    return start


def set_parameter(node, name, value, type_=None):
    return node.set_parameters([RosParameter(name, type_, value)])[0]


def test_values_are_taken_as_people_type_them(make):
    typed = {
        'count': ('4', 4), 'mode': ('fast', 'fast'), 'speed': ('400', 400.0),
        'levels': ('0.25', (0.25,)), 'topics': ("['']", ()),
        'files': ('[a.csv, b.csv]', ('a.csv', 'b.csv')),
    }  # fmt: skip
    values = make(*(f'{name}:={text}' for name, (text, _) in typed.items())).table.values()
    for name, (_, expected) in typed.items():
        assert (type(values[name]), values[name]) == (type(expected), expected)


@pytest.mark.parametrize(('name', 'text', 'words'), [
    ('speed', 'quick', ["'quick'", 'a number from 0 to 1000 m/s', '-p speed:=VALUE']),
    ('positive', '.nan', ['nan', 'at least 0 N']),
    ('count', '10', ['10', 'an integer from 1 to 9']), ('flag', '1', ['1', 'true or false']),
    ('mode', 'medium', ["'medium'", 'slow, fast']), ('label', '12', ['12', 'a string']),
    ('levels', '[0.5, 1.5]', ['1.5', 'array', 'from 0 to 1']),
])  # fmt: skip
def test_bad_value_at_start_up_is_a_sentence(make, name, text, words):
    with pytest.raises(SettingsError, match=f'^Parameter {name} must be ') as refusal:
        make(f'{name}:={text}')
    assert all(word in str(refusal.value) for word in words), refusal.value


def test_change_at_run_time_is_accepted_and_converted(make):
    node = make()
    assert set_parameter(node, 'speed', 7).successful
    assert set_parameter(node, 'levels', [], RosParameter.Type.STRING_ARRAY).successful
    assert node.table.values()['speed'] == 7.0
    assert node.table.values()['levels'] == ()
    assert isinstance(node.get_parameter('speed').value, float)


def test_bad_change_at_run_time_is_refused_and_changes_nothing(make):
    node = make()
    for name, value, word in (
        ('levels', [0.5, 2.0], 'from 0 to 1'), ('count', 'three', 'INTEGER'),
        ('label', 'new', 'read-only'),
    ):  # fmt: skip
        result = set_parameter(node, name, value)
        assert not result.successful
        assert word in result.reason
    assert node.table.values() == DEFAULTS
