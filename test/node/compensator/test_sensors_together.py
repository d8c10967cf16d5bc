"""Two sensors that share a process do what each does in a process of its own, to the last bit."""

import json
import shutil
import subprocess
import sys

import pytest

# What one process does: serves sensors, and gives each the messages that belong to it.
PROGRAM = """
import json, sys
import numpy as np
from rclpy.context import Context
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Temperature
from wrist_ft_comp.node.compensator import CompensatorNode
from wrist_ft_comp.ros.messages import wrench_message
from wrist_ft_comp.ros.running import node_per_sensor

data, names = sys.argv[1], sys.argv[2:]
context = Context()
context.init([])
given = {'sensors': names, 'data_directory': data, 'model_file': data + '/models/m.yaml'}
given = [Parameter(name, value=value) for name, value in given.items()]
nodes = dict(zip(names, node_per_sensor(
    CompensatorNode, context=context, parameter_overrides=given), strict=True))
out = {name: [] for name in names}
for name, node in nodes.items():
    node._output.publish = lambda data, name=name: out[name].append(bytes(data).hex())
rng = {name: np.random.default_rng(list(name.encode())) for name in names}
for second in range(60):
    for name, node in nodes.items():
        stamp = (1_700_000_000 + second) * 1_000_000_000
        message = Temperature(temperature=20.0 + rng[name].uniform(0.0, second))
        message.header.stamp.sec = 1_700_000_000 + second
        node.inputs.on_temperature(0, serialize_message(message))
        for k in range(5):
            wrench = wrench_message(stamp + k * 200_000_000, name, rng[name].normal(0, 9, 6))
            node._on_wrench(serialize_message(wrench))
        if second == 30:
            node._swap(node.live.stored.model)
        node._keep_house()
for node in nodes.values():
    node.destroy_node()
context.try_shutdown()
print(json.dumps(out))
"""


@pytest.fixture
def outputs(ros_domain, make_model, tmp_path):  # noqa: ARG001
    gains = {'force_z': (2.0, 0.0, 20.0), 'torque_x': (0.1, 0.001, 5.0)}
    path = make_model('m.yaml', gains).path

    def run(*names):
        data = tmp_path / '_'.join(names)  # of its own, or it would go on where another ended
        shutil.copytree(path.parent, data / 'models')
        done = subprocess.run(
            [sys.executable, '-c', PROGRAM, str(data), *names],
            capture_output=True, text=True, timeout=60.0, check=True,
        )  # fmt: skip
        return json.loads(done.stdout)

    return run


def test_two_sensors_in_one_process_are_as_two_processes(outputs):
    together = outputs('left', 'right')
    assert len(together['left']) == 300
    assert together['left'] != together['right']
    assert together == {**outputs('left'), **outputs('right')}
