"""The package as a workspace builds it; where colcon is missing, "make colcon" brings it."""

import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys

import pytest
from std_srvs.srv import Trigger

import wrist_ft_comp

ROOT = Path(__file__).parents[2]
NAME = 'wrist_ft_comp'
EXECUTABLES = {'compensator', 'simulated_sensor', 'wrist_ft_comp'}
TIMEOUT_S = 300.0
CLEAN = {name: value for name, value in os.environ.items() if name != 'PYTHONPATH'}

colcon = shutil.which('colcon')
pytestmark = pytest.mark.skipif(colcon is None, reason='colcon is not on the PATH: make colcon')


def run(words, folder, env):
    done = subprocess.run(words, cwd=folder, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f'{words}\n{done.stdout}{done.stderr}'
    return done.stdout


@pytest.fixture(scope='module')
def workspace(tmp_path_factory):
    """A workspace with this package, built."""
    folder = tmp_path_factory.mktemp('workspace')
    ignored = shutil.ignore_patterns('.*', 'build', 'install', 'log', 'out', '*.egg-info')
    shutil.copytree(ROOT, folder / 'src' / NAME, ignore=ignored)
    run([str(colcon), 'build'], folder, CLEAN)
    return folder


@pytest.fixture(scope='module')
def sourced(workspace):
    """The environment of a shell that sourced the workspace, far from these sources."""
    listing = run(['sh', '-c', '. install/setup.sh && env -0'], workspace, CLEAN)
    return dict(line.split('=', 1) for line in listing.split('\0') if '=' in line)


@pytest.fixture(scope='module')
def prefix(workspace):
    return workspace / 'install' / NAME


def test_executables_documents_and_configurations_are_where_ros2_looks(prefix, sourced):
    executables = list((prefix / 'lib' / NAME).iterdir())
    assert {file.name for file in executables} == EXECUTABLES
    assert all(os.access(file, os.X_OK) for file in executables)
    code = f"import ament_index_python as a; print(a.get_package_share_directory('{NAME}'))"
    share = prefix / 'share' / NAME
    assert run([sys.executable, '-c', code], prefix, sourced).split() == [str(share)]
    for name in ('package.xml', 'README.md', 'CHANGELOG.rst', 'LICENSE'):
        assert (share / name).read_bytes() == (ROOT / name).read_bytes(), name
    for folder in ('config', 'docs', 'data/keller_pa10'):
        wanted = {file.name for file in (ROOT / folder).iterdir() if file.is_file()}
        assert wanted == {file.name for file in (share / folder).iterdir()}, folder


def test_the_installed_command_calibrates(prefix, sourced, tmp_path):
    command = str(prefix / 'lib' / NAME / NAME)
    table = str(prefix / 'share' / NAME / 'data/keller_pa10/table2_sensor_b_raw.csv')
    converter = str(ROOT / 'examples/paper/chamber_table.py')
    run([sys.executable, converter, table, '-o', 'b.csv'], tmp_path, sourced)
    words = ['b.csv', '--reference', 'recorded', '-o', 'b.yaml']
    run([command, 'calibrate', *words], tmp_path, sourced)  # with its schema
    assert 'b.yaml: a drift model' in run([command, 'show', 'b.yaml'], tmp_path, sourced)
    module = [sys.executable, '-m', NAME, '--version']
    assert run(module, tmp_path, sourced).strip() == wrist_ft_comp.__version__


@pytest.fixture
def node(prefix, sourced, ros_domain):
    """The installed node, with the installed file of parameters."""
    environment = {**sourced, 'ROS_DOMAIN_ID': str(ros_domain)}
    for name in ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'ROS_HOME', 'ROS_LOG_DIR'):
        environment[name] = os.environ[name]
    command = [
        prefix / 'lib' / NAME / 'compensator', '--ros-args', '-r', '__ns:=/installed',
        '--params-file', prefix / 'share' / NAME / 'config/compensator.yaml',
    ]  # fmt: skip
    process = subprocess.Popen([str(word) for word in command], env=environment, cwd=prefix)
    yield
    process.send_signal(signal.SIGINT)
    assert process.wait(TIMEOUT_S) == 0


@pytest.mark.usefixtures('node')
def test_the_installed_node_answers(bench):
    service = '/installed/wrist_ft_comp/reset_tare'
    answer = bench.call(Trigger, service, Trigger.Request())
    assert answer.message == 'the tare is zero again'
