"""The commands of docs/drivers.md that start the compensator: the node takes them as they are."""

import pytest

from wrist_ft_comp.node.compensator_node import CompensatorNode


@pytest.mark.parametrize('number', range(5))
def test_a_driver_s_topics_are_taken(commands, make_context, tmp_path, number):
    started = [words for words in commands('docs/drivers.md') if words[3] == 'compensator']
    given = started[number][4:]
    context = make_context(*given, '-p', f'data_directory:={tmp_path}')
    node = CompensatorNode(context=context)
    (raw,) = (word.partition(':=')[2] for word in given if word.startswith('wrench_raw'))
    assert node.sensor()['wrench_topic'] == [raw]
    assert list(node.get_parameter('temperature_topics').value)
    node.destroy_node()
