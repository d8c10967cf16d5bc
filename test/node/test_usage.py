import pytest

from wrist_ft_comp.node import compensator_node, simulated_sensor
from wrist_ft_comp.node.compensator_node import CompensatorNode
from wrist_ft_comp.node.simulated_sensor import SimulatedSensor

#: What every node has.
COMMON = ('/rosout', 'logger_levels', '/parameter_events', 'parameter', 'type_description')


@pytest.mark.parametrize(('module', 'node', 'name'), [
    (compensator_node, CompensatorNode, 'compensator'),
    (simulated_sensor, SimulatedSensor, 'simulated_sensor'),
])  # fmt: skip
def test_help_names_what_the_node_has_and_exits(bench, capsys, module, node, name):
    assert module.main([name, '--ros-args', '--help']) == 0
    shown = capsys.readouterr()
    assert shown.out.startswith(f'usage: {name} --ros-args ')
    assert shown.err == ''
    lines = shown.out.splitlines()
    assert max(map(len, lines)) <= 79
    marked = [f'  {row.name}{"" if row.read_only else " *"}' for row in module.PARAMETERS]
    assert [line for line in lines if line in marked] == marked
    made = bench.make(node, namespace='/shown')
    ends = [end.topic_name for end in (*made.subscriptions, *made.publishers)]
    ends += [service.srv_name for service in made.services]
    of_the_node = [end for end in ends if not any(word in end for word in COMMON)]
    assert len(of_the_node) >= 4
    for end in of_the_node:
        inside = f'/shown/{made.get_name()}/'
        asked = f'~/{end.removeprefix(inside)}' if end.startswith(inside) else end
        assert asked.removeprefix('/shown/') in shown.out
