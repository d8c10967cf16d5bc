HEAVY = (
    'matplotlib', 'rosbags', 'pandas', 'scipy', 'jinja2', 'rich', 'wrist_ft_comp.cli',
    'wrist_ft_comp.fit.auto_method', 'wrist_ft_comp.fit.calibrate', 'wrist_ft_comp.report',
    'wrist_ft_comp.simulation',
)  # fmt: skip
#: A node with a model gets temperatures and a wrench, swaps its model, and tells what is imported.
SOURCE = """
from pathlib import Path
import sys
from rclpy.context import Context
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Temperature
from wrist_ft_comp.node.compensator_node import CompensatorNode
from wrist_ft_comp.ros.topics import wrench_message

context = Context()
context.init([])
parameters = [Parameter(name, value=value) for name, value in GIVEN.items()]
node = CompensatorNode(context=context, parameter_overrides=parameters)
for second in range(1, 4):
    message = Temperature(temperature=30.0)
    message.header.stamp.sec = second
    node.inputs.by_topic[0].read(serialize_message(message))
    node._on_wrench(serialize_message(wrench_message(second * 10**9, 'tool0', [1.0] * 6)))
node.housekeep()
node._diagnose()
assert node.counts.published == 3
assert node.compensator.compensating
node.live.take(node.live.load(Path(GIVEN['model_file'])), 'it is better')
print(*sys.modules)
node.destroy_node()
context.try_shutdown()
"""


def test_a_running_node_has_imported_nothing_heavy(run_python, make_model, tmp_path):
    model = make_model('m.yaml', {'force_z': (2.0, 0.0, 30.0)})
    given = {'model_file': str(model.path), 'data_directory': str(tmp_path)}
    modules = run_python('-c', f'GIVEN = {given}\n{SOURCE}').split()
    assert 'wrist_ft_comp.node.live_model' in modules
    assert not [m for m in modules for name in HEAVY if m == name or m.startswith(f'{name}.')]
