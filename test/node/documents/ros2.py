"""
A stand-in for the command ``ros2`` where only rclpy is installed: just what the documents use.

``run`` starts the package's executables; ``service call``, ``param describe`` and ``topic echo``
talk over DDS.
"""

from contextlib import contextmanager
import importlib
import os
import sys
from typing import Any

from rcl_interfaces.srv import DescribeParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
import yaml

MODULES = {
    'compensator': 'wrist_ft_comp.node.compensator_node',
    'simulated_sensor': 'wrist_ft_comp.node.simulated_sensor',
}
TIMEOUT_S = 60.0
POLL_S = 0.1


@contextmanager
def own_node():
    """Make a node for one command, and what spins it."""
    context = Context()
    context.init([])
    node = Node('ros2_stand_in', context=context, use_global_arguments=False)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        yield node, executor
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


def call(service_type, name, request):
    """Call a service."""
    with own_node() as (node, executor):
        client = node.create_client(service_type, name)
        # A node drops its answer to a client that it has not discovered yet. It discovers them in
        # the order in which they were made, so one answer to the second says that it knows both.
        second = f'{name.rpartition("/")[0]}/describe_parameters'
        knock = node.create_client(DescribeParameters, second)
        if not (client.wait_for_service(TIMEOUT_S) and knock.wait_for_service(TIMEOUT_S)):
            sys.exit(f'no service {name}')
        knocks = []
        while not any(answer.done() for answer in knocks):  # a busy node answers late
            knocks.append(knock.call_async(DescribeParameters.Request()))
            executor.spin_until_future_complete(knocks[-1], 1.0)
        future = client.call_async(request)
        executor.spin_until_future_complete(future, TIMEOUT_S)
        return future.result() or sys.exit(f'{name} does not answer')


def echo(topic):
    """Wait for one message of a topic."""
    received: list[Any] = []
    with own_node() as (node, executor):
        for _ in range(round(TIMEOUT_S / POLL_S)):
            executor.spin_once(POLL_S)
            kinds = dict(node.get_topic_names_and_types()).get(topic)
            if kinds and not list(node.subscriptions):
                package, _, name = kinds[0].split('/')
                kind = getattr(importlib.import_module(f'{package}.msg'), name)
                node.create_subscription(kind, topic, received.append, qos_profile_sensor_data)
            if received:
                return received[0]
        sys.exit(f'no message on {topic}')


def main(words):
    """Run one command."""
    if words[:2] == ['run', 'wrist_ft_comp']:
        program = [sys.executable, '-m', MODULES[words[2]], *words[3:]]
        os.execv(sys.executable, program)  # noqa: S606
    if words[:3] == ['topic', 'echo', '--once']:
        sys.stdout.write(f'{echo(words[3])}\n')
        return 0
    if words[:2] == ['service', 'call']:
        package, _, name = words[3].split('/')
        service_type = getattr(importlib.import_module(f'{package}.srv'), name)
        fields = yaml.safe_load(words[4]) if len(words) > 4 else {}
        response = call(service_type, words[2], service_type.Request(**fields))
        sys.stdout.write(f'{response}\n')
        return 0 if response.success else 1
    if words[:2] == ['param', 'describe']:
        request = DescribeParameters.Request(names=words[3:])
        described = call(DescribeParameters, f'{words[2]}/describe_parameters', request)
        sys.stdout.write(f'{described}\n')
        return 0 if described.descriptors[0].description else 1
    sys.exit(f'the stand-in does not know: ros2 {" ".join(words)}')


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
