"""requirements/setup.sh builds around a sourced ROS 2, or takes ROS from wheels."""

import os
from pathlib import Path
import shutil
import subprocess
import sys

import pytest

ROOT = Path(__file__).parents[1]
#: A Python that neither makes environments nor installs, but writes down what it was asked for.
STAND_IN = """#!/bin/sh
case "$*" in
    '-m venv '*)
        echo "$*" >> calls
        mkdir -p .venv/bin
        cp "$0" .venv/bin/python ;;
    '-m pip '*) echo "$*" >> calls ;;
    *) exec {python} -S "$@" ;;
esac
"""


@pytest.fixture
def setup(tmp_path):
    """Run the script in a clone, ROS 2 sourced whose rclpy is some text, or not at all."""
    shutil.copytree(ROOT / 'requirements', tmp_path / 'requirements')
    stand_in, package = tmp_path / 'python', tmp_path / 'opt/rclpy'
    stand_in.write_text(STAND_IN.format(python=sys.executable))
    stand_in.chmod(0o755)

    def run(rclpy):
        if rclpy is not None:
            package.mkdir(parents=True)
            (package / '__init__.py').write_text(rclpy)
        return subprocess.run(
            ['/bin/sh', 'requirements/setup.sh', str(stand_in)],
            cwd=tmp_path,
            env={**os.environ, 'PYTHONPATH': '' if rclpy is None else str(package.parent)},
            capture_output=True,
            text=True,
            timeout=60.0,
            check=False,
        )

    return run


@pytest.mark.parametrize(
    ('rclpy', 'expected'),
    [
        ('', ('--system-site-packages ', 'noble.txt', 'test,lint')),
        (None, ('', 'lock.txt', 'ros,test,lint')),
    ],
)
def test_the_environment_fits_the_ros_that_is_there(setup, tmp_path, rclpy, expected):
    options, versions, extras = expected
    done = setup(rclpy)
    assert done.returncode == 0, done.stderr
    venv, pip = (tmp_path / 'calls').read_text().splitlines()
    assert venv == f'-m venv {options}.venv'
    assert [name for name in ('noble.txt', 'lock.txt') if name in pip] == [versions]
    assert pip.endswith(f'-e .[{extras}]')


def test_a_ros_for_another_python_is_a_sentence_and_changes_nothing(setup, tmp_path):
    done = setup('raise ImportError("built for another one")')
    assert done.returncode == 1
    assert 'cannot import: built for another one' in done.stderr
    assert 'make PYTHON=/usr/bin/python3 setup' in done.stderr
    assert not (tmp_path / '.venv').exists()
