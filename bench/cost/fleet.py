"""
Calibrate and judge many simulated robots by docs/fleet.md's script: by a pool, and by Dask.

``python bench/cost/fleet.py [ROBOTS]`` makes robots of two recordings each (200), runs the script
by two processes of the standard library's pool and by two Dask workers, and prints both times,
their ratio, and whether the models are the same.
"""

from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stdout
import io
import os
from pathlib import Path
import re
import shutil
import sys
import tempfile
import time
from typing import Any

os.environ['OMP_NUM_THREADS'] = os.environ['OPENBLAS_NUM_THREADS'] = '1'

import distributed
import numpy as np

from wrist_ft_comp import load_model
from wrist_ft_comp.signals import AXES

ROOT = Path(__file__).resolve().parents[2]
WORKERS = 2


def write_day(path: Path, seed: int) -> None:
    """Write an hour of warming up at 1 Hz, unloaded, six axes, two thermometers."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, 3600.0)
    motor = 22 + 15 * (1 - np.exp(-t / rng.uniform(600, 1200))) + np.sin(t / rng.uniform(90, 150))
    body = 22 + 8 * (1 - np.exp(-t / 1800))
    force = np.outer(motor - 22, rng.uniform(0.2, 0.6, 6)) + rng.normal(0, 0.02, (len(t), 6))
    names = ','.join(['stamp_s', *AXES, 'temperature_c', 'temperature_2_c'])
    rows = np.column_stack((t, force, motor, body))
    np.savetxt(path, rows, '%.4f', ',', header=names, comments='')


def timed(script: Any, executor: Any, root: Path) -> float:
    """Judge all robots; the time it took, s."""
    began = time.perf_counter()
    with redirect_stdout(io.StringIO()):
        script.fleet(executor, root)
    return time.perf_counter() - began


def main() -> None:
    """Make robots, judge them twice, compare."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    with tempfile.TemporaryDirectory() as folder:
        text = (ROOT / 'docs/fleet.md').read_text('utf-8')
        Path(folder, 'fleet.py').write_text(re.findall(r'```python\n(.*?)```', text, re.DOTALL)[0])
        sys.path.insert(0, folder)
        os.environ['PYTHONPATH'] = os.pathsep.join((folder, str(ROOT)))
        import fleet  # noqa: PLC0415 -- written just now

        by_pool, by_dask = Path(folder, 'pool'), Path(folder, 'dask')
        for number in range(count):
            robot = by_pool / f'SN-{number:04d}'
            robot.mkdir(parents=True)
            for day in range(2):
                write_day(robot / f'day_{day}.csv', 10 * number + day)
        shutil.copytree(by_pool, by_dask)
        with ProcessPoolExecutor(WORKERS) as pool:
            pool_s = timed(fleet, pool, by_pool)
        untyped: Any = distributed
        options = {'processes': True, 'threads_per_worker': 1, 'dashboard_address': None}
        with (
            untyped.LocalCluster(n_workers=WORKERS, host='127.0.0.1', **options) as cluster,
            untyped.Client(cluster) as client,
        ):
            dask_s = timed(fleet, client.get_executor(), by_dask)
        same = sum(
            load_model(robot / 'model.yaml').document['axes']
            == load_model(by_dask / robot.name / 'model.yaml').document['axes']
            for robot in by_pool.iterdir()
        )
    print(f'{count} robots: pool {pool_s:.1f} s, Dask {dask_s:.1f} s, {dask_s / pool_s:.2f} times')
    print(f'{same} of {count} models are the same')


if __name__ == '__main__':
    main()
