"""
Do the tests bite: mutants of five folders against their own tests.

``python bench/mutants.py [--count N] [--seed S]`` draws from the mutants that mutmut makes, the
same ones as long as their functions do not change, and runs the tests of their room on each.
Survivors are shown; some of them change nothing. It fails below 90 % killed.
"""

import argparse
import ast
from collections import Counter
import hashlib
from importlib import import_module
import json
import os
from pathlib import Path
import shutil
import subprocess
import sys

from wrist_ft_comp import ONE_THREAD

#: Rooms, and the tests beside their own that go through a door to what only that door shows. None
#: of a node: mutmut forks, and a fork that has DDS in it aborts, whatever the tests say.
ROOMS = {
    'drift': 'stream/test_compensator.py stream/test_failed_thermometers.py '
    'stored/test_model_file.py fit/test_identification.py cli/test_sensor.py',
    'stream': 'test_gaps.py recordings/test_recordings.py report/test_evaluation.py '
    'cli/test_bad_recordings.py cli/test_foreign_logs.py',
    'payload': 'learning jobs/test_learning_job.py recordings/test_specific_force.py '
    'wire/test_gravity_by_tf.py cli/test_payload.py cli/test_compensate.py cli/test_show.py',
    'learning': 'jobs/test_learning_job.py cli/test_show.py',
    'stored': 'recordings/test_table.py learning/test_days.py cli/test_files.py',
}
LEAST_KILLED = 0.9
TREES = Path('build/mutated')
MUTMUT = Path('build/mutants/bin/mutmut').absolute()
#: By the exit code that mutmut stores; no test runs 33, and a signal ends what takes too long.
FATES: dict[int | None, str] = {1: 'killed', 3: 'killed', 0: 'survived', 33: 'survived'}
FATES |= dict.fromkeys((-24, 24, 36, 152, 255), 'timed out')
#: Arguments that say how to work: what comes out is the same where nothing else is wrong.
HOW = ('strict', 'optimize', 'hermitian')
#: A measured number never equals a tuned one: nobody sees whether it would count then.
ON_THE_LINE = {ast.LtE: ast.Lt, ast.GtE: ast.Gt}

CONFIGURATION = """
[tool.mutmut]
source_paths = ['wrist_ft_comp']
only_mutate = ['wrist_ft_comp/{room}/*']
pytest_add_cli_args_test_selection = {tests}
pytest_add_cli_args = ['-p', 'no:cacheprovider', '-p', 'no:xdist', '-q']
also_copy = ['data', 'docs']
use_git_change_detection = false
track_dependencies = false
"""


def mutmut(room: str, *words: str, fails: str = '') -> str:
    """Run mutmut in a room's tree and return what it prints; it may fail with such an error."""
    env = {**os.environ, **ONE_THREAD}
    done = subprocess.run(  # noqa: PLW1510 -- looked at below
        [MUTMUT, *words], cwd=TREES / room, env=env, capture_output=True, text=True
    )
    if done.returncode and not (fails and fails in done.stderr):
        sys.exit(f'{done.stdout[-5000:]}{done.stderr}')
    return done.stdout


def make_tree(room: str) -> None:
    """Copy what the tests of a room need."""
    tree = TREES / room
    shutil.rmtree(tree, ignore_errors=True)
    for folder in ('wrist_ft_comp', 'test', 'data', 'docs'):
        shutil.copytree(folder, tree / folder, ignore=shutil.ignore_patterns('__pycache__'))
    with Path(shutil.copy('pyproject.toml', tree)).open('a') as settings:
        tests = [f'test/{name}' for name in (room, *ROOMS[room].split())]
        settings.write(CONFIGURATION.format(room=room, tests=tests))


def exit_codes(room: str) -> dict[str, int | None]:
    """Exit code of every mutant of a room but the idle ones; None before it is run."""
    codes: dict[str, int | None] = {}
    for path in (TREES / room).glob('mutants/**/*.meta'):
        constants = vars(import_module(f'wrist_ft_comp.{room}.{path.name.partition(".")[0]}'))
        tuned = {name for name, value in constants.items() if isinstance(value, float)}
        idle = idle_mutants(path.with_suffix('').read_text(), tuned)
        all_codes = json.loads(path.read_text())['exit_code_by_key'].items()
        codes |= {name: code for name, code in all_codes if name.rpartition('.')[2] not in idle}
    return codes


def idle_mutants(code: str, tuned: set[str]) -> set[str]:
    """Name the mutants, in code with all of them, that no test is to notice."""
    bodies: dict[str, str] = {}
    for function in ast.walk(ast.parse(code)):
        if not (isinstance(function, ast.FunctionDef) and '__mutmut_' in function.name):
            continue
        for node in ast.walk(function):
            # Tests assert what a sentence is about, and its numbers, but not its words.
            if isinstance(node, ast.Constant) and ' ' in str(node.value):
                node.value = ' '
            elif isinstance(node, ast.Call):
                node.keywords = [each for each in node.keywords if each.arg not in HOW]
            elif isinstance(node, ast.Compare) and len(node.ops) == 1:
                inside = [*ast.walk(node.left), *ast.walk(node.comparators[0])]
                names = {each.id for each in inside if isinstance(each, ast.Name)}
                if tuned & names and not any(isinstance(each, ast.Compare) for each in inside):
                    node.ops = [ON_THE_LINE.get(type(op), type(op))() for op in node.ops]
        bodies[function.name] = ast.dump(ast.Module(function.body, []))
    return {
        name
        for name, body in bodies.items()
        if not name.endswith('_orig') and body == bodies[name.rpartition('_')[0] + '_orig']
    }


def draw(count: int, seed: int) -> list[tuple[str, str]]:
    """Draw rooms and names of mutants by a hash of each, so that no change draws others."""
    for room in ROOMS:
        make_tree(room)
        # It makes all of them before it looks for those that it is asked to run.
        mutmut(room, 'run', 'none', fails='nothing matches')
    mutants = [(room, name) for room in ROOMS for name in exit_codes(room)]
    mutants.sort(key=lambda mutant: hashlib.sha256(f'{seed} {mutant[1]}'.encode()).digest())
    return mutants[:count]


def main() -> int:
    """Draw, run, and judge."""
    parser = argparse.ArgumentParser()
    parser.add_argument('--count', type=int, default=300, help='how many are drawn')
    parser.add_argument('--seed', type=int, default=11, help='of the draw')
    drawn, survivors = draw(**vars(parser.parse_args())), 0
    for room in ROOMS:
        names = [name for where, name in drawn if where == room]
        mutmut(room, 'run', *names)
        codes = exit_codes(room)
        fates = {name: FATES.get(codes[name], 'unclear') for name in names}
        print(f'{room}: {len(names)} mutants,', dict(Counter(fates.values())), flush=True)
        alive = [name for name in names if fates[name] in ('survived', 'unclear')]
        survivors += len(alive)
        print(*(mutmut(room, 'show', name) for name in alive), flush=True)
    killed = 1 - survivors / len(drawn)
    print(f'{killed:.1%} are killed.')
    return int(killed < LEAST_KILLED)


if __name__ == '__main__':
    sys.exit(main())
