"""
Run a bench of this tree and of version 0.1.0 in turn, and print both.

``python bench/beside.py NAME [ARGUMENTS]``, such as ``stream`` or ``reading``. Each version runs
its own bench on its own package; times of the same minute on the same machine may be compared.
"""

import os
import subprocess
import sys

from baseline import baseline, ROOT, VERSION


def main() -> int:
    """Run both; the exit code is this tree's."""
    name, *words = sys.argv[1:]
    codes = []
    for title, tree in (('this tree', ROOT), (f'version {VERSION}', baseline())):
        print(f'===== {name} of {title}', flush=True)
        command = [sys.executable, str(tree / 'bench' / f'{name}.py'), *words]
        environment = {**os.environ, 'PYTHONPATH': str(tree)}
        codes.append(subprocess.run(command, cwd=tree, env=environment, check=False).returncode)
    return codes[0]


if __name__ == '__main__':
    sys.exit(main())
