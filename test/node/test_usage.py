import pytest

from wrist_ft_comp.node import compensator as compensator_node
from wrist_ft_comp.node import simulated_sensor as simulated_sensor_node
from wrist_ft_comp.node.compensator import CompensatorNode
from wrist_ft_comp.node.simulated_sensor import SimulatedSensor

NODES = pytest.mark.parametrize(
    ('module', 'node', 'name'),
    [
        (compensator_node, CompensatorNode, 'compensator'),
        (simulated_sensor_node, SimulatedSensor, 'simulated_sensor'),
    ],
)
#: What every node has.
COMMON = ('/rosout', 'logger_levels', '/parameter_events', 'parameter', 'type_description')


@NODES
@pytest.mark.parametrize('words', [['--help'], ['-h'], ['--ros-args', '--help']])
def test_help_explains_the_node_and_exits(capsys, module, node, name, words):
    assert module.main([name, *words]) == 0
    shown = capsys.readouterr()
    assert shown.out.startswith(f'usage: {name} --ros-args ')
    lines = shown.out.splitlines()
    marked = [f'  {row.name}{"" if row.read_only else " *"}' for row in module.PARAMETERS]
    assert [line for line in lines if line in marked] == marked
    assert max(map(len, lines)) <= 79
    assert shown.err == ''
    assert node.__name__ not in shown.out, 'no word of classes'


@NODES
def test_help_names_what_the_node_has_on_the_graph(bench, module, node, name, capsys):
    made = bench.make(node, namespace='/shown')
    assert module.main([name, '--help']) == 0
    text = capsys.readouterr().out
    ends = [end.topic_name for end in (*made.subscriptions, *made.publishers)]
    ends += [service.srv_name for service in made.services]
    of_the_node = [end for end in ends if not any(word in end for word in COMMON)]
    assert len(of_the_node) >= 4
    for end in of_the_node:
        inside = f'/shown/{made.get_name()}/'
        asked = f'~/{end.removeprefix(inside)}' if end.startswith(inside) else end
        assert asked.removeprefix('/shown/') in text
