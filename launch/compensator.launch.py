"""
Start the compensator beside a driver: include it in a robot's launch file.

ros2 launch wrist_ft_comp compensator.launch.py wrench_raw:=/driver/wrench
  temperature_topics:='["/driver/temperature", "/driver/state:data[3]:K"]'
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
import yaml

#: Names of topics that can be given, and what they are.
TOPICS = {
    'wrench_raw': "the driver's raw wrench, heard",
    'wrench': 'the compensated wrench, published',
    'wrench_external': 'the same without the payload, published',
    'imu': 'specific force at the sensor, heard with gravity.source imu',
}
#: Other arguments with their defaults; what is empty is left to the node.
ARGUMENTS = {
    'temperature_topics': ('', 'the thermometers, a YAML list as in docs/interface.md'),
    'params_file': ('', 'a parameter file, as config/compensator.yaml'),
    'data_directory': ('', 'where models and recordings are kept'),
    'namespace': ('', 'namespace of the node and of its relative topics'),
    'name': ('wrist_ft_comp', 'name of the node'),
    'log_level': ('info', 'debug, info, warn or error'),
    'respawn': ('true', 'whether a node that died is started again after a second'),
}


def compensator(context):
    """Make the node from the arguments that were given."""
    given = {name: LaunchConfiguration(name).perform(context) for name in (*TOPICS, *ARGUMENTS)}
    parameters = [given['params_file']] if given['params_file'] else []
    if given['temperature_topics']:
        parameters.append({'temperature_topics': yaml.safe_load(given['temperature_topics'])})
    if given['data_directory']:
        parameters.append({'data_directory': given['data_directory']})
    logger = '.'.join([*given['namespace'].split('/'), given['name']]).strip('.')
    node = Node(
        package='wrist_ft_comp',
        executable='compensator',
        name=given['name'],
        namespace=given['namespace'],
        parameters=parameters,
        remappings=[(topic, given[topic]) for topic in TOPICS if given[topic]],
        ros_arguments=['--log-level', f'{logger}:={given["log_level"]}'],
        output='screen',
        respawn=given['respawn'] == 'true',
        respawn_delay=1.0,
    )
    return [node]


def generate_launch_description():
    """Declare the arguments, which ``ros2 launch … --show-args`` lists."""
    described = {topic: ('', text) for topic, text in TOPICS.items()} | ARGUMENTS
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in described.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=compensator)])
