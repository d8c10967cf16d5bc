"""Which way requirements/setup.sh goes: around a sourced ROS 2, or with ROS from wheels."""

import os
from pathlib import Path
import shutil
import subprocess
import sys

import pytest

ROOT = Path(__file__).parents[1]
TIMEOUT_S = 60.0
#: Does not make environments nor install, but tells what it was asked for.
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
def clone(tmp_path):
    """A clone with the script, and a Python that tells what it was asked for."""
    shutil.copytree(ROOT / 'requirements', tmp_path / 'requirements')
    stand_in = tmp_path / 'python'
    stand_in.write_text(STAND_IN.format(python=sys.executable))
    stand_in.chmod(0o755)
    return tmp_path


def source_ros(clone, content):
    """Lay out what a sourced installation puts on PYTHONPATH."""
    package = clone / 'opt/ros/jazzy/lib/python3/site-packages/rclpy'
    package.mkdir(parents=True)
    (package / '__init__.py').write_text(content)
    return str(package.parent)


def run(clone, path=''):
    return subprocess.run(
        ['/bin/sh', 'requirements/setup.sh', str(clone / 'python')],
        cwd=clone,
        env={**os.environ, 'PYTHONPATH': path},
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )


def calls(clone):
    return (clone / 'calls').read_text().splitlines()


def test_around_a_sourced_ros_its_packages_and_the_versions_of_ubuntu_are_used(
    clone,
):
    done = run(clone, source_ros(clone, ''))
    assert done.returncode == 0, done.stderr
    venv, pip = calls(clone)
    assert venv == '-m venv --system-site-packages .venv'
    assert 'noble.txt' in pip
    assert 'lock.txt' not in pip
    assert pip.endswith('-e .[test,lint]')


def test_without_one_ros_comes_from_wheels_in_the_locked_versions(clone):
    done = run(clone)
    assert done.returncode == 0, done.stderr
    venv, pip = calls(clone)
    assert venv == '-m venv .venv'
    assert 'lock.txt' in pip
    assert 'noble.txt' not in pip
    assert pip.endswith('-e .[ros,test,lint]')


def test_a_ros_for_another_python_is_a_sentence_and_changes_nothing(clone):
    (clone / '.venv').mkdir()
    (clone / '.venv/kept').touch()
    done = run(clone, source_ros(clone, 'raise ImportError("built for another one")'))
    assert done.returncode == 1
    assert 'cannot import: built for another one' in done.stderr
    assert 'make PYTHON=/usr/bin/python3 setup' in done.stderr
    assert 'Traceback' not in done.stderr
    assert (clone / '.venv/kept').exists()
    assert not (clone / 'calls').exists()
