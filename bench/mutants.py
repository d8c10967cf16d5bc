"""
Do the tests bite: mutants of ``model`` and ``stream`` against their rooms' own tests.

``python bench/mutants.py [--count N]`` draws mutants that mutmut makes of both rooms, always the
same ones as long as a function does not change, and runs the tests of their room on each. Those
that survive are printed. Survivors that change nothing are listed in ``mutants_equivalent.yaml``
with the reason; each entry has to be one of the survivors. It fails below 90 % killed.
"""

import argparse
from collections import Counter
import hashlib
import json
import os
from pathlib import Path
import shutil
import subprocess
import sys
from typing import NamedTuple

import yaml

ROOMS = ('model', 'stream')
SEED = 11
ENOUGH = 0.9
FEW = 0.05
TREES = Path('build/mutated')
MUTMUT = Path('build/mutants/bin/mutmut').absolute()
EQUIVALENT = Path(__file__).with_name('mutants_equivalent.yaml')
#: Exit codes of the tests under a mutant, as mutmut stores them; the processor time that a mutant
#: may take ends it by a signal.
OUTCOMES = {1: 'killed', 3: 'killed', 0: 'survived', 5: 'survived', 33: 'survived'}
OUTCOMES |= dict.fromkeys((-24, 24, 36, 152, 255), 'timed out')

CONFIGURATION = """
[tool.mutmut]
source_paths = ['wrist_ft_comp']
only_mutate = ['wrist_ft_comp/{room}/*']
pytest_add_cli_args_test_selection = ['test/{room}']
pytest_add_cli_args = ['-p', 'no:cacheprovider', '-p', 'no:xdist', '-q']
use_git_change_detection = false
track_dependencies = false
"""


class Change(NamedTuple):
    """What a mutant does, without its number, which changes with what stands above it."""

    function: str
    before: str
    after: str


def mutmut(room: str, *words: str) -> str:
    """Run mutmut in a room's tree, numpy in one thread; return what it prints."""
    done = subprocess.run(
        [MUTMUT, *words],
        cwd=TREES / room,
        env={**os.environ, 'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1'},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        sys.exit(done.stdout + done.stderr)
    return done.stdout


def make_tree(room: str) -> None:
    """Copy what the tests of a room need, and make its mutants."""
    tree = TREES / room
    shutil.rmtree(tree, ignore_errors=True)
    for folder in ('wrist_ft_comp', 'test'):
        shutil.copytree(folder, tree / folder, ignore=shutil.ignore_patterns('__pycache__'))
    shutil.copy('setup.cfg', tree)
    settings = Path('pyproject.toml').read_text() + CONFIGURATION.format(room=room)
    (tree / 'pyproject.toml').write_text(settings)
    # mutmut makes all of them whichever it is asked to run.
    mutmut(room, 'run', next(iter(sorted(Path('wrist_ft_comp', room).glob('[!_]*.py')))).stem)


def outcomes(room: str) -> dict[str, int | None]:
    """Exit code of every mutant of a room, None before it was run."""
    codes: dict[str, int | None] = {}
    for path in sorted((TREES / room).glob('mutants/**/*.meta')):
        codes |= json.loads(path.read_text())['exit_code_by_key']
    return codes


def lot(name: str) -> str:
    """Draw a mutant's lot, which does not depend on how many others there are."""
    return hashlib.sha256(f'{SEED} {name}'.encode()).hexdigest()


def change(room: str, name: str) -> Change:
    """Find what a mutant does."""
    lines = mutmut(room, 'show', name).splitlines()[3:]
    before, after = (
        ' '.join(line[1:].strip() for line in lines if line[0] == sign) for sign in '-+'
    )
    function = name.removeprefix('wrist_ft_comp.').partition('__mutmut_')[0]
    return Change(function.replace('.x_', '.').replace('.xǁ', '.').replace('ǁ', '.'), before, after)
