"""What is borrowed from rclpy's inside is there; services and spinning have tests of their own."""

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import Temperature

from wrist_ft_comp.ros.rclpy_internals import (
    given_parameters,
    keep_from_executors,
    return_to_node,
    waiting,
)
from wrist_ft_comp.ros.topics import SLOW_SENSOR


def test_a_given_empty_array_is_told_from_nothing(bench):
    words = ['--ros-args', '-p', 'speed:=1', '-p', 'topics:=[]']
    node = bench.make(Node, node_name='example', cli_args=words)
    assert given_parameters(node) == {'speed': 1, 'topics': None}


def test_a_subscription_is_kept_from_executors_and_read_by_its_owner(bench):
    heard = []
    node = bench.make(Node, node_name='example')
    kept = node.create_subscription(Temperature, 'heat', heard.append, SLOW_SENSOR, raw=True)
    keep_from_executors(node, kept)
    executor = SingleThreadedExecutor(context=bench.context)
    executor.add_node(node)
    publisher = bench.helper.create_publisher(Temperature, 'heat', 10)
    bench.wait_until(publisher.get_subscription_count, 'the subscription')
    messages = []
    publisher.publish(Temperature(temperature=21.0))
    bench.wait_until(
        lambda: executor.spin_once(timeout_sec=0.0) or messages.extend(waiting(kept)) or messages,
        'the message',
    )
    assert isinstance(messages[0], bytes)
    assert heard == []
    executor.shutdown()
    return_to_node(node, kept)
    assert node.destroy_subscription(kept)
