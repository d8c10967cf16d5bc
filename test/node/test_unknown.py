from types import SimpleNamespace

import pytest
from rclpy.node import Node

from wrist_ft_comp.ros.arguments import tell_unknown
from wrist_ft_comp.ros.parameters import declare, Parameter

TABLE = (
    Parameter('temperature_topics', ('temperature',), 'Topics.'),
    Parameter('calibration.method', 'auto', 'Method.'),
    Parameter('sensors', (), 'Sensors.', element=str),
)


@pytest.fixture
def log_of(bench):
    """Give a node arguments; what it logs about them, warnings and others."""

    def tell(*arguments):
        rules = [word for argument in arguments for word in ('-p', argument)]
        node = bench.make(Node, node_name='example', cli_args=['--ros-args', *rules])
        declare(node, TABLE)
        lines = {'warning': [], 'info': []}
        log = SimpleNamespace(**{level: of_level.append for level, of_level in lines.items()})
        tell_unknown(node, ['/late'], log)
        return lines['warning'], lines['info']

    return tell


@pytest.mark.parametrize(
    ('given', 'meant'),
    [
        ('temprature_topics', 'temperature_topics'),
        ('temperature_topic', 'temperature_topics'),
        ('calibration_method', 'calibration.method'),
        ('calibration.methd', 'calibration.method'),
        ('sensor', 'sensors'),
        ('use_simtime', 'use_sim_time'),
        ('qos_overrides./lte.subscription.depth', 'qos_overrides./late.subscription.depth'),
        (
            'qos_overrides./late.subscription.reliabilty',
            'qos_overrides./late.subscription.reliability',
        ),
    ],
)
def test_a_mistyped_parameter_is_a_warning_with_the_nearest_name(log_of, given, meant):
    warnings, others = log_of(f'{given}:=x')
    assert warnings == [
        f'There is no parameter {given}, so its value is ignored. Did you mean {meant}?'
    ]
    assert others == []


def test_parameters_of_another_node_are_one_warning(log_of):
    names = [f'joint_limits.joint_{k}.max_effort' for k in range(10)]
    also = 'qos_overrides./tf.subscription.depth'
    warnings, (line,) = log_of(*(f'{name}:=1' for name in [*names, also]))
    assert warnings == []
    assert line.startswith('Parameters that this node does not have are ignored: joint_limits')
    assert line.endswith('joint_7.max_effort and 3 more.')


def test_parameters_of_every_node_are_not_taken_for_mistyped_ones(log_of):
    given = (
        'use_sim_time:=true',
        'start_type_description_service:=true',
        'temperature_topics:=[a]',
        'qos_overrides./late.subscription.depth:=5',
    )
    assert log_of(*given) == ([], [])
