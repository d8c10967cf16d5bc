"""
A stand-in for the command ``ros2`` where only rclpy is installed: just what the documents use.

``run`` starts the package's executables; ``param describe`` talks over DDS.
"""

import os
import sys

from rcl_interfaces.srv import DescribeParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

MODULES = {
    'compensator': 'wrist_ft_comp.node.compensator_node',
    'simulated_sensor': 'wrist_ft_comp.node.simulated_sensor',
}
TIMEOUT_S = 60.0


def describe(node_name, names):
    """Ask a node what its parameters are."""
    context = Context()
    context.init([])
    node = Node('ros2_stand_in', context=context, use_global_arguments=False)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        client = node.create_client(DescribeParameters, f'{node_name}/describe_parameters')
        if not client.wait_for_service(TIMEOUT_S):
            sys.exit(f'no service {client.srv_name}')
        answers = []
        # A node drops its answer to a client that it has not discovered yet.
        while not any(answer.done() for answer in answers):
            answers.append(client.call_async(DescribeParameters.Request(names=names)))
            executor.spin_until_future_complete(answers[-1], 1.0)
        return next(answer.result() for answer in answers if answer.done())
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


def main(words):
    """Run one command."""
    if words[:2] == ['run', 'wrist_ft_comp']:
        program = [sys.executable, '-m', MODULES[words[2]], *words[3:]]
        os.execv(sys.executable, program)  # noqa: S606
    if words[:2] == ['param', 'describe']:
        described = describe(words[2], words[3:])
        sys.stdout.write(f'{described}\n')
        return 0 if described.descriptors[0].description else 1
    sys.exit(f'the stand-in does not know: ros2 {" ".join(words)}')


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
