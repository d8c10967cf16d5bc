"""The README's commands, run as they are written, in their order."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
TIMEOUT_S = 60.0


def commands() -> list[list[str]]:
    """Every line of every ``sh`` block, split as a shell splits it."""
    blocks = re.findall(r'^```sh\n(.*?)^```', (ROOT / 'README.md').read_text('utf-8'), re.M | re.S)
    return [shlex.split(line) for block in blocks for line in block.splitlines() if line]


def runnable(words: list[str]) -> list[str]:
    """Put programs in the place of names that a user has on the PATH."""
    if words[0] == 'ros2' and shutil.which('ros2') is None:
        return [sys.executable, str(Path(__file__).with_name('ros2.py')), *words[1:]]
    if words[0] == 'wrist_ft_comp':
        return [sys.executable, '-m', 'wrist_ft_comp.cli.main', *words[1:]]
    return words


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder that looks like the project's root to the commands."""
    for name in ('data', 'config'):
        (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


@pytest.fixture
def start(ros_domain: int, folder: Path) -> Iterator[Callable[[list[str]], Any]]:  # noqa: ARG001
    """Start programs that go on; end them, and whatever they started, by their own group."""
    running: list[Any] = []

    def begin(words: list[str]) -> Any:
        running.append(subprocess.Popen(runnable(words), cwd=folder, start_new_session=True))
        return running[-1]

    yield begin
    for process in running:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
            process.wait(TIMEOUT_S)


def run(words: list[str], folder: Path) -> str:
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    done = subprocess.run(
        runnable(words),
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert done.returncode == 0, f'{shlex.join(words)}\n{done.stdout}{done.stderr}'
    return done.stdout


def test_commands_for_files_run_as_written_and_give_the_figures_of_the_table(folder: Path) -> None:
    lines = [words for words in commands() if words[0] == 'wrist_ft_comp']
    assert len(lines) >= 5
    printed = ''.join(run(words, folder) for words in lines)
    readme = (ROOT / 'README.md').read_text('utf-8')
    for title in ('max \\|K_s\\|, %FS/°C (eq. 23)', 'zero spread, %FS'):
        figures = re.search(re.escape(f'| {title} |') + r'(.*)\|', readme)
        assert figures is not None, title
        expected = [cell.strip() for cell in figures[1].split('|')]
        shown = re.search(re.escape(title.replace('\\', '')) + r'(.*)', printed)
        assert shown is not None
        assert shown[1].split() == expected


def homes(bench: Any) -> list[str]:
    """List the namespaces of the compensators that are up."""
    nodes = bench.helper.get_node_names_and_namespaces()
    return sorted(namespace for name, namespace in nodes if name == 'wrist_ft_comp')


def test_node_commands_run_as_written(
    ros_domain: int,  # noqa: ARG001
    bench: Any,
    start: Callable[[list[str]], Any],
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from sensor_msgs.msg import Temperature  # noqa: PLC0415 -- only where ROS is

    monkeypatch.setenv('PYTHONPATH', str(ROOT))
    monkeypatch.setenv('ROS_HOME', str(folder / 'ros_home'))
    lines = [words for words in commands() if words[0] == 'ros2']
    runs = [words for words in lines if words[1] == 'run']
    beside_driver, simulator, compensator, several = runs
    for words, namespaces in ((beside_driver, ['/']), (several, ['/left', '/right'])):
        process = start(words)
        up = partial(lambda wanted: homes(bench) == wanted, namespaces)
        bench.wait_until(up, f'nodes in {namespaces}')
        os.killpg(process.pid, signal.SIGINT)
        process.wait(TIMEOUT_S)
        bench.wait_until(lambda: not homes(bench), 'the end of the nodes')

    temperatures = bench.listen(Temperature, 'temperature_2')
    start(compensator)
    bench.wait_for_node('wrist_ft_comp')
    begun = False
    for words in lines:
        if words in runs:
            continue
        if words[3:] and 'false' in words[-1]:
            first = temperatures.get(timeout=TIMEOUT_S).temperature
            while temperatures.get(timeout=TIMEOUT_S).temperature < first + 5.0:
                pass
        run(words, folder)
        if not begun:
            start(simulator)
            begun = True
