"""
Do the tests bite: mutants of five folders against their own tests.

``python bench/mutants.py [--count N]`` draws from the mutants that mutmut makes of them,
the same ones as long as their functions do not change, and runs the tests of their room on each.
Mutants of the words of a sentence only are left out. Survivors are shown; about 2 %
of all mutants change nothing. It fails below 90 % killed.
"""

import argparse
import ast
from collections import Counter
import hashlib
import json
import os
from pathlib import Path
import shutil
import subprocess
import sys

from wrist_ft_comp import ONE_THREAD

#: Rooms, and the tests beside their own that go through a door to what only that door shows.
ROOMS = {
    'drift': ('test/stream/test_compensator.py', 'test/stream/test_thermometer_faults.py'),
    'stream': ('test/test_gaps.py', 'test/recordings/test_recordings.py'),
    'payload': (
        'test/learning',
        'test/jobs/test_learning_job.py',
        'test/recordings/test_specific_force.py',
        'test/cli/test_payload.py',
        'test/cli/test_compensate.py',
    ),
    'learning': (
        'test/jobs/test_learning_job.py',
        'test/cli/test_show.py',
        'test/node/compensator/learning/test_diary.py',
    ),
    'stored': ('test/test_old_files.py',),
}
SEED = 11
LEAST_KILLED = 0.9
TREES = Path('build/mutated')
MUTMUT = Path('build/mutants/bin/mutmut').absolute()
#: By the exit code that mutmut stores; no test runs 33, and a signal ends what takes too long.
FATES: dict[int | None, str] = {1: 'killed', 3: 'killed', 0: 'survived', 33: 'survived'}
FATES |= dict.fromkeys((-24, 24, 36, 152, 255), 'timed out')

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
    """
    Run mutmut in a room's tree, numpy in one thread; return what it prints.

    It may fail with an error that holds ``fails``; any other error ends this program.
    """
    done = subprocess.run(  # noqa: PLW1510 -- looked at below
        [MUTMUT, *words],
        cwd=TREES / room,
        env={**os.environ, **ONE_THREAD},
        capture_output=True,
        text=True,
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
        tests = [f'test/{room}', *ROOMS[room]]
        settings.write(CONFIGURATION.format(room=room, tests=tests))


def exit_codes(room: str) -> dict[str, int | None]:
    """Exit code of every mutant of a room but those of sentences; None before it is run."""
    codes: dict[str, int | None] = {}
    for path in (TREES / room).glob('mutants/**/*.meta'):
        worded = sentences_changed(path.with_suffix('').read_text())
        of_file = json.loads(path.read_text())['exit_code_by_key']
        codes |= {
            name: code for name, code in of_file.items() if name.rpartition('.')[2] not in worded
        }
    return codes


def sentences_changed(code: str) -> set[str]:
    """Name the mutants, in code with all of them, that change the words of a sentence only."""
    # Tests assert what a sentence is about, and its numbers, but not its words.
    bodies: dict[str, str] = {}
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.FunctionDef) and '__mutmut_' in node.name:
            for text in ast.walk(node):
                if isinstance(text, ast.Constant) and ' ' in str(text.value):
                    text.value = ' '
            bodies[node.name] = ast.dump(ast.Module(node.body, []))
    return {
        name
        for name, body in bodies.items()
        if not name.endswith('_orig') and body == bodies[name.rpartition('_')[0] + '_orig']
    }


def draw(count: int) -> list[tuple[str, str]]:
    """Draw rooms and names of mutants by a hash of each, so that no change draws others."""
    for room in ROOMS:
        make_tree(room)
        # It makes all of them before it looks for those that it is asked to run.
        mutmut(room, 'run', 'none', fails='nothing matches')
    mutants = [(room, name) for room in ROOMS for name in exit_codes(room)]
    mutants.sort(key=lambda mutant: hashlib.sha256(f'{SEED} {mutant[1]}'.encode()).digest())
    return mutants[:count]


def main() -> int:
    """Draw, run, and judge."""
    parser = argparse.ArgumentParser()
    parser.add_argument('--count', type=int, default=300, help='how many are drawn')
    drawn, survivors = draw(parser.parse_args().count), 0
    for room in ROOMS:
        names = [name for where, name in drawn if where == room]
        mutmut(room, 'run', *names)
        codes = exit_codes(room)
        fates = {name: FATES.get(codes[name], 'unclear') for name in names}
        print(f'{room}: {len(names)} mutants,', dict(Counter(fates.values())), flush=True)
        for name in names:
            if fates[name] in ('survived', 'unclear'):
                survivors += 1
                print(mutmut(room, 'show', name))
    killed = 1 - survivors / len(drawn)
    print(f'{killed:.1%} are killed.')
    return int(killed < LEAST_KILLED)


if __name__ == '__main__':
    sys.exit(main())
