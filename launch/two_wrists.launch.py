"""
Start two compensators, one for each wrist: copy this file, and write your own topics into it.

ros2 launch wrist_ft_comp two_wrists.launch.py
"""

from launch import LaunchDescription
from launch_ros.actions import Node


def compensator(side, temperature_topics):
    """Make the node of one wrist, in a namespace of its own, with files of its own."""
    return Node(
        package='wrist_ft_comp',
        executable='compensator',
        namespace=side,
        parameters=[{'temperature_topics': temperature_topics}],
        remappings=[('wrench_raw', f'/{side}_driver/wrench')],
        output='screen',
        respawn=True,
        respawn_delay=1.0,
    )


def generate_launch_description():
    """List the nodes; the thermometer inside a sensor comes first."""
    return LaunchDescription(
        [
            compensator('left', ['/left_driver/temperature', '/left_flange/temperature']),
            compensator('right', ['/right_driver/temperature']),
        ]
    )
