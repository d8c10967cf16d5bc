"""docs/fleet.md: its script, by the standard library's pool and on a Dask scheduler."""

from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
import json
from multiprocessing import get_context
from pathlib import Path
import re
import shutil
import sys

import pytest

import wrist_ft_comp
from wrist_ft_comp import load_model

TEXT = (Path(wrist_ft_comp.__file__).parents[1] / 'docs/fleet.md').read_text('utf-8')
SCRIPT = re.findall(r'```python\n(.*?)```', TEXT, re.DOTALL)[0]


@pytest.fixture
def robots(tmp_path, make):
    """Three robots: a good one, one whose newest day is another's, one with a broken file."""
    root = tmp_path / 'robots'
    for number in range(3):
        folder = root / f'SN-{number}'
        folder.mkdir(parents=True)
        for day in (2, 10):  # by name, day_10 comes first
            make.csv(folder / f'day_{day}.csv', make.drifting(450, 10 * number + day))
    (root / 'SN-2/day_2.csv').write_text('stamp_s,fx\n1,2\n')
    return root


@pytest.fixture
def script(tmp_path, monkeypatch):
    """The script as a module that other processes can import."""
    (tmp_path / 'fleet.py').write_text(SCRIPT)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv('PYTHONPATH', f'{tmp_path}:{Path(wrist_ft_comp.__file__).parents[1]}')
    monkeypatch.setenv('OMP_NUM_THREADS', '1')
    yield import_module('fleet')
    del sys.modules['fleet']


def test_a_fleet_is_judged_by_a_pool_worst_first_and_goes_on_where_it_was(robots, script, capsys):
    assert len(SCRIPT.splitlines()) <= 42
    with ProcessPoolExecutor(2, mp_context=get_context('spawn')) as pool:
        script.fleet(pool, robots)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:3] == ['SN-2', 'refused', 'recording']
    assert re.search(r'SN-[01] +\d+% of allowed (force_z|torque_x)', lines[1])
    assert 'day_2.csv' in str(load_model(robots / 'SN-0/model.yaml').document['provenance'])
    row = json.loads((robots / 'SN-1/judged.json').read_text())
    (robots / 'SN-1/judged.json').write_text(json.dumps({**row, 'error': 0.5}))
    shutil.rmtree(robots / 'SN-0')
    assert script.judge(robots / 'SN-1')['error'] == 0.5


def test_a_dask_cluster_learns_the_same_models(robots, script, tmp_path, capsys):
    distributed = pytest.importorskip('distributed')
    by_hand = shutil.copytree(robots / 'SN-0', tmp_path / 'SN-0')
    script.judge(by_hand)
    options = {'n_workers': 1, 'threads_per_worker': 1, 'dashboard_address': '127.0.0.1:0'}
    cluster = distributed.LocalCluster(host='127.0.0.1', **options)
    with cluster, distributed.Client(cluster) as client:
        script.fleet(client.get_executor(), robots)
    assert capsys.readouterr().out.startswith('SN-2')
    learnt = [load_model(folder / 'model.yaml') for folder in (robots / 'SN-0', by_hand)]
    assert learnt[0].document['axes'] == learnt[1].document['axes']
