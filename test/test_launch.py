"""The launch file by what it declares: there are no wheels of launch, so stand-ins take notes."""

from pathlib import Path
import re
import sys
from types import ModuleType

import pytest
import yaml

from wrist_ft_comp.wire.temperature_source import parse_sources

ROOT = Path(__file__).parents[1]
INTERFACE = (ROOT / 'docs/interface.md').read_text('utf-8')


class Declared:
    """Stands for what launch makes of a call: it keeps what was given."""

    def __init__(self, *values, **named):
        self.values, self.named = values, named

    def perform(self, context):
        return context[self.values[0]]


@pytest.fixture
def load(monkeypatch):
    for name, classes in {
        'launch': ['LaunchDescription'],
        'launch.actions': ['DeclareLaunchArgument', 'OpaqueFunction'],
        'launch.substitutions': ['LaunchConfiguration'],
        'launch_ros': [],
        'launch_ros.actions': ['Node'],
    }.items():
        module = ModuleType(name)
        vars(module).update({of: type(of, (Declared,), {}) for of in classes})
        monkeypatch.setitem(sys.modules, name, module)

    def run(name):
        scope = {}
        source = (ROOT / 'launch' / name).read_text('utf-8')
        exec(compile(source, name, 'exec'), scope)  # noqa: S102 -- our own file
        return scope['generate_launch_description']().values[0]

    return run


@pytest.fixture
def launch(load):
    """Give the declared arguments, and a function that makes the node from some that are given."""
    *declared, made = load('compensator.launch.py')
    defaults = {argument.values[0]: argument.named['default_value'] for argument in declared}

    def node(**given):
        assert given.keys() <= defaults.keys()
        (result,) = made.named['function']({**defaults, **given})
        return result.named

    return declared, node


def test_two_wrists_are_two_nodes_in_namespaces_of_their_own(load):
    left, right = (node.named for node in load('two_wrists.launch.py'))
    assert (left['namespace'], right['namespace']) == ('left', 'right')
    for node in (left, right):
        assert f'{node["executable"]} = ' in (ROOT / 'setup.py').read_text('utf-8')
        assert parse_sources(node['parameters'][0]['temperature_topics'], str)
    assert left['remappings'] != right['remappings']


def test_without_arguments_the_executable_starts_as_it_is(launch):
    declared, make = launch
    for argument in declared:
        assert argument.named['description']
        assert isinstance(argument.named['default_value'], str)
    node = make()
    assert (node['package'], node['executable']) == ('wrist_ft_comp', 'compensator')
    assert f'{node["executable"]} = ' in (ROOT / 'setup.py').read_text('utf-8')
    assert node['parameters'] == node['remappings'] == []
    assert node['respawn'] is True


def test_launch_arguments_reach_the_node_by_its_own_names(launch):
    names = 'wrench_raw', 'wrench', 'wrench_external', 'imu'
    topics = {name: f'/robot/{name}' for name in names}
    entries = ['/robot/temperature', '/driver/state:data[3]:K']
    node = launch[1](
        **topics, temperature_topics=str(entries), params_file='f.yaml', data_directory='/d',
        namespace='left', respawn='false', log_level='debug',
    )  # fmt: skip
    given = {'temperature_topics': entries}, {'data_directory': '/d'}
    assert node['parameters'] == ['f.yaml', *given]
    assert dict(node['remappings']) == topics
    assert len(parse_sources(entries, str)) == 2
    for name in (*topics, 'temperature_topics', 'data_directory'):
        assert re.search(rf'\b{name}\b', INTERFACE), name
    assert (node['namespace'], node['respawn']) == ('left', False)
    assert node['ros_arguments'] == ['--log-level', 'left.wrist_ft_comp:=debug']


def test_the_aggregator_s_analyzer_takes_the_names_of_our_statuses():
    settings = yaml.safe_load((ROOT / 'config/diagnostics.yaml').read_text('utf-8'))
    analyzer = settings['/**']['ros__parameters']['wrist_ft_comp']
    assert analyzer['type'] == 'diagnostic_aggregator/GenericAnalyzer'
    name = 'left/wrist_ft_comp: input'  # as Hub._diagnose writes it
    assert any(part in name for part in analyzer['contains'])
