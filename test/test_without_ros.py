"""The core and the command line where there is no ROS 2; a node asked for there is refused."""

from importlib.util import find_spec
import os
from pathlib import Path
import subprocess
import sys

import pytest

ROOT = Path(__file__).parents[1]
TABLE, CONVERTER = 'data/keller_pa10/table2_sensor_b_raw.csv', 'examples/paper/chamber_table.py'
NEEDED = ('numpy', 'scipy', 'yaml', 'matplotlib', 'jinja2', 'rich', 'rosbags')
ROS = {
    'rclpy', 'geometry_msgs', 'sensor_msgs', 'std_msgs', 'std_srvs', 'diagnostic_msgs',
    'rcl_interfaces', 'builtin_interfaces', 'ament_index_python',
}  # fmt: skip
TIMEOUT_S = 100.0


@pytest.fixture(scope='module')
def site(tmp_path_factory):
    """A folder of this Python's packages but those of ROS 2."""
    folder = tmp_path_factory.mktemp('site')
    for name in NEEDED:
        spec = find_spec(name)
        assert spec is not None
        (place, *_) = spec.submodule_search_locations or ['']
        for package in Path(place).parent.iterdir():
            link = folder / package.name
            if package.name not in ROS and package.suffix != '.pth' and not link.exists():
                link.symlink_to(package)
    return folder


def run(site, *words):
    environment = {key: value for key, value in os.environ.items() if 'ROS' not in key}
    return subprocess.run(
        [sys.executable, '-S', *words],
        env={**environment, 'PYTHONPATH': f'{ROOT}{os.pathsep}{site}', 'MPLBACKEND': 'agg'},
        cwd=site, capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
    )  # fmt: skip


def test_the_command_line_gives_its_results(site, tmp_path):
    assert "No module named 'rclpy'" in run(site, '-c', 'import numpy, rclpy').stderr
    names = ('oven.csv', 'b.yaml', 'out.csv', 'b.html')
    oven, model, out, report = (tmp_path / name for name in names)
    assert not run(site, ROOT / CONVERTER, ROOT / TABLE, '-o', oven).stderr
    commands = [
        ['calibrate', oven, '--reference', 'recorded', '-o', model, '--report', report],
        ['show', model], ['evaluate', model, oven], ['compensate', model, oven, '-o', out],
    ]  # fmt: skip
    each = f'for words in {[[*map(str, words)] for words in commands]}: assert main(words) == 0'
    done = run(site, '-c', f'from wrist_ft_comp.cli.main import main\n{each}')
    assert done.returncode == 0, done.stderr
    assert done.stdout
    assert out.read_text('utf-8').count('\n') == oven.read_text('utf-8').count('\n')


@pytest.mark.parametrize(
    ('words', 'sentence'),
    [
        (
            ['-c', 'from wrist_ft_comp.__main__ import compensator; compensator()'],
            'A node needs ROS 2, but this Python',
        ),
        (['-m', 'wrist_ft_comp', 'demo'], 'The demonstration needs rclpy'),
    ],
)
def test_a_node_that_is_asked_for_is_refused_in_one_sentence(site, words, sentence):
    done = run(site, *words)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert sentence in line
    assert not list(site.glob('demo*'))
