"""Parameter files and QoS overrides given to the executable, as a launch file gives them."""

from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='the node tests need ROS 2 (rclpy)')

from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import QoSReliabilityPolicy
import yaml

from wrist_ft_comp.ros.messages import wrench_message
from wrist_ft_comp.ros.parameters import PARAMETERS

ROOT = Path(__file__).parents[3]
MODULE = 'wrist_ft_comp.ros.compensator_node'
TIMEOUT_S = 60.0
LOAD = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]


@pytest.fixture
def start(bench, executable, tmp_path):
    """Start the executable with files of parameters; gives the values that it then has."""

    def launch(name, *files):
        arguments = [part for file in files for part in ('--params-file', str(file))]
        own = ('-r', f'__ns:=/{name}', '-r', f'__node:={name}')
        executable(MODULE, *own, '-p', f'data_directory:={tmp_path}', *arguments)
        bench.wait_for_node(name)

        def value(*names):
            request = GetParameters.Request(names=list(names))
            answer = bench.call(GetParameters, f'/{name}/{name}/get_parameters', request)
            return [parameter_value_to_python(each) for each in answer.values]

        return value

    return launch


def flat(tree, prefix=''):
    """Names with dots, as the node has them."""
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from flat(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value


def test_the_file_that_is_installed_is_taken(start):
    path = ROOT / 'config/compensator.yaml'
    wanted = dict(flat(yaml.safe_load(path.read_text('utf-8'))['/**']['ros__parameters']))
    assert set(wanted) <= {row.name for row in PARAMETERS}
    value = start('from_installed_file', path)
    assert value(*wanted) == list(wanted.values())


def test_each_node_takes_its_own_part_of_a_file(start, tmp_path):
    path = tmp_path / 'cell.yaml'
    parts = {
        '/**': {'max_drift': 3, 'temperature_topics': ['inside', 'flange']},
        '/left_arm/left_arm': {'max_drift': 4, 'tare': {'duration': 2.5}},
        '/right_arm/right_arm': {'tare': {'duration': 7.5}},
    }
    tree = {name: {'ros__parameters': values} for name, values in parts.items()}
    path.write_text(yaml.safe_dump(tree, sort_keys=False))
    value = start('left_arm', path)
    names = ('max_drift', 'tare.duration', 'temperature_topics')
    assert value(*names) == [4.0, 2.5, ['inside', 'flange']]


def test_a_file_overrides_quality_of_service_as_the_graph_shows(bench, start, tmp_path):
    path = tmp_path / 'qos.yaml'
    topics = {
        '/qos_file/wrench': {'publisher': {'reliability': 'best_effort'}},
        '/qos_file/wrench_raw': {'subscription': {'reliability': 'reliable'}},
    }
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': {'qos_overrides': topics}}}))
    start('qos_file', path)
    outputs = bench.listen(WrenchStamped, '/qos_file/wrench')
    helper = bench.helper
    bench.wait_until(lambda: helper.count_publishers('/qos_file/wrench') > 0, 'the output')
    (output,) = helper.get_publishers_info_by_topic('/qos_file/wrench')
    assert output.qos_profile.reliability == QoSReliabilityPolicy.BEST_EFFORT
    raw = bench.publisher(WrenchStamped, '/qos_file/wrench_raw')
    (subscription,) = helper.get_subscriptions_info_by_topic('/qos_file/wrench_raw')
    assert subscription.qos_profile.reliability == QoSReliabilityPolicy.RELIABLE
    raw.publish(wrench_message(7, 'tool0', LOAD))
    assert outputs.get(timeout=TIMEOUT_S).header.stamp.nanosec == 7
