"""examples/paper/reproduce.py: what it prints and draws, and the published model in its file."""

from pathlib import Path
import re
import subprocess
import sys

import numpy as np
import pytest
from scipy import signal

#: As they are printed in the paper's 4.2.
P = [
    [-0.0311, -0.2423, 0.9985, -0.1724],
    [-0.1953, 0.5380, 0.0277, -0.8360],
    [0.9545, 0.1054, 0.0463, -0.0732],
    [0.2231, -0.8004, -0.0025, -0.5157],
]
Q = [[0.5941, 0.9614, 0.5974, 0.9452], [0.8044, -0.2750, -0.8019, 0.3265]]
#: H(z) as it is printed: numerator, and denominator with the z⁻¹ behind the fraction.
H = [
    ([0.0651, -0.0688], [1, -1.1980, 0.3112, 0]),
    ([0.0024, 0.0489], [1, -1.4087, 0.4835, 0]),
    ([0.0100, 0.0131], [1, -1.2449, 0.4061]),
    ([0.0015, 0.0148], [1, -1.2194, 0.3806, 0]),
]
PAPER = Path(__file__).parents[2] / 'examples/paper'


@pytest.fixture(scope='module')
def reproduce():
    """The script as a module, imported as Python does that runs it."""
    sys.path.insert(0, str(PAPER))
    try:
        import reproduce  # noqa: PLC0415 -- found by the line above
    finally:
        sys.path.remove(str(PAPER))
    return reproduce


@pytest.fixture(scope='module')
def said(tmp_path_factory):
    """What the one command prints, and the folder where it draws."""
    folder = tmp_path_factory.mktemp('paper')
    command = [sys.executable, PAPER / 'reproduce.py', '-o', folder / 'figures']
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    return done.stdout, folder / 'figures'


def test_the_published_model_runs_as_scipy_assembles_what_is_printed(reproduce):
    model = reproduce.read_published_model(PAPER / 'published_model.yaml')
    x = np.random.default_rng(0).standard_normal((200, 4))
    x[0] = 0.0
    _, y = model.run(model.start(x[0]), x)
    scores = np.linalg.solve(P, (x * [0.2868, 0.2710, 0.2446, 0.2936]).T).T  # X W_x = T Pᵀ
    expected = np.zeros((200, 2))
    for r, (above, below) in enumerate(H):
        _, u = signal.dlsim(signal.dlti(above, below, dt=1.0), scores[:, r])
        expected += u * np.array(Q)[:, r]
    np.testing.assert_allclose(y, expected / [0.2572, 0.2694], rtol=0, atol=1e-12)
    assert np.abs(y).max() > 0.1


def test_every_part_prints_its_figures_and_draws(said):
    text, folder = said
    assert sorted(path.name for path in folder.iterdir()) == [
        'methods.png', 'published_model.png', 'tables.png'
    ]  # fmt: skip
    assert all(path.stat().st_size > 20_000 for path in folder.iterdir())
    assert text.count('Not reproduced: ') == 2
    assert 'The column of 50 °C in table1_sensor_a_raw.csv repeats that of -40 °C' in text
    assert max(map(len, text.splitlines())) <= 100


def test_k_s_and_a_stand_beside_those_of_the_papers_tables(said):
    """K_s and zero spread of the four tables stand in data/keller_pa10/README.md, too."""
    rows = re.findall(r'^([AB]), (.+?)  +([\d.]+) +([\d.]+) +([\d.]+)$', said[0], re.MULTILINE)
    found = {(sensor, name): tuple(map(float, figures)) for sensor, name, *figures in rows}
    assert found['A', 'raw'][:2] == (0.0687, 5.361)
    assert found['B', 'raw'][:2] == (0.1444, 7.512)
    assert found['A', "the paper's result"][:2] == (0.0206, 0.237)
    assert found['B', "the paper's result"][:2] == (0.0137, 0.206)
    for sensor in 'AB':
        assert found[sensor, 'pls'] == found[sensor, 'pcr'], 'by all latents both are the same'
        assert found[sensor, 'pls'][0] < found[sensor, "the paper's result"][0] / 1.5
        assert found[sensor, 'pls'][2] < found[sensor, 'raw'][2] / 4


def test_dynamics_beat_statics_and_the_free_run_beats_one_step(said):
    rows = re.findall(r'^([a-z_]+) +([\d.]+)  10\.69   ', said[0], re.MULTILINE)
    left = {method: float(rms) for method, rms in rows}
    assert list(left) == ['pcr', 'pls', 'filtered_pls', 'arx_pls', 'arx_pls_oe', 'auto']
    assert max(left['filtered_pls'], left['arx_pls']) < 0.6 * left['pls']
    assert max(left['arx_pls_oe'], left['auto']) < 0.05 * left['pls'], 'eq. 16, not eq. 17'
    assert re.search(r'latent 1: n \d, m \d, d \d.*; J_1 = [\d.e+]+ \(eq\. 19\)', said[0])
