"""Two wrists in one process: each with its own model, tare, services and files."""

from functools import partial
import itertools
from pathlib import Path

import numpy as np
import pytest

from wrist_ft_comp.node.compensator import CompensatorNode
from wrist_ft_comp.ros.running import node_per_sensor

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
_NUMBERS = itertools.count()
make = partial(node_per_sensor, CompensatorNode)


@pytest.fixture
def pair(bench, wired, tmp_path):
    """Start a left and a right sensor in one executor; yields what talks to each."""

    def start(left='', right='', **options):
        namespace = f'/pair{next(_NUMBERS)}'
        file = tmp_path / 'parameters.yaml'
        lines = (
            f'{namespace}/{name}/wrist_ft_comp: {{ros__parameters: {{model_file: "{model}"}}}}\n'
            for name, model in (('left', left), ('right', right))
        )
        file.write_text(''.join(lines))
        nodes = bench.start_all(
            make,
            namespace=namespace,
            parameters={'sensors': ['left', 'right'], 'data_directory': str(tmp_path / 'data')},
            cli_args=['--ros-args', '--params-file', str(file)],
            **options,
        )
        return [wired(node=node, namespace=node.get_namespace()) for node in nodes]

    return start


@pytest.fixture
def models(make_model):
    """Write a model file per sensor; force z drifts by 2 and by 5 N/K above 20 °C, without lag."""
    left = make_model('left.yaml', {'force_z': (2.0, 0.0, 0.0)})
    right = make_model('right.yaml', {'force_z': (5.0, 0.0, 0.0)})
    return str(left.path), str(right.path)


def test_each_sensor_has_its_own_model_thermometer_tare_and_files(pair, models, tmp_path):
    left, right = sensors = pair(*models)
    left.warm_up(21.0)
    right.warm_up(23.0)
    for sensor, path, expected in zip(sensors, models, (-2.0, -15.0), strict=True):
        assert sensor.ask_output(START + 9 * SECOND, [0.0] * 6)[2] == pytest.approx(expected)
        assert sensor.node.live.stored.path == Path(path)
    answer = left.ask('tare')
    left.bench.wait_until(lambda: left.node.tare._running is not None, 'the tare')
    stamps = START + 9 * SECOND + np.arange(30) * (SECOND // 20)
    left.stream(stamps, [[7.0] * 6] * len(stamps))
    assert answer.get(timeout=20.0).success
    later = START + 12 * SECOND
    assert left.ask_output(later, [7.0] * 6) == pytest.approx([0.0] * 6)
    assert right.ask_output(later, [7.0] * 6) == pytest.approx([7, 7, -8, 7, 7, 7])
    for sensor, name in zip(sensors, ('left', 'right'), strict=True):
        assert sensor.call('record', data=True).success
        (path,) = (tmp_path / 'data' / name / 'recordings').glob('*.csv')
        assert str(path) in sensor.call('record', data=False).message
        assert list(sensor.node.get_parameter('sensors').value) == ['left', 'right']
        sensor.refused_value('sensors', ['other'])


def test_a_remap_by_full_name_means_one_sensor(ros_context):
    arguments = ['--ros-args', '-p', 'sensors:=[left, right]', '-r', '/left/wrench_raw:=/driver']
    nodes = make(context=ros_context, cli_args=arguments)
    assert [node.own_topics[0] for node in nodes] == ['/driver', '/right/wrench_raw']
    for node in nodes:
        node.destroy_node()
