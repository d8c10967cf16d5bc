"""
A model for the benches of cost, and where they keep their figures.

The model is calibrated from a made-up warm-up of six axes, in a process of its own: a bench that
measures memory must not have calibrated.
"""

import json
from pathlib import Path
import subprocess
import sys

import numpy as np


def write_warm_up(path: Path, seconds: int = 7200) -> Path:
    """Write a CSV recording of one row per second."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    cells = np.arange(seconds)
    temperature = 25 + 20 * (1 - np.exp(-cells / 1500)) + 3 * np.sin(cells / 500)
    drift = np.outer(temperature - 25, [0.1, -0.1, 0.4, 0.01, -0.01, 0.02])
    rows = np.column_stack((cells, drift + rng.normal(0, 0.05, drift.shape), temperature))
    names = 'stamp_s,force_x,force_y,force_z,torque_x,torque_y,torque_z,temperature_c'
    np.savetxt(path, rows, delimiter=',', header=names, comments='', fmt='%.6f')
    return path


def make_model(folder: Path) -> Path:
    """Calibrate from a warm-up of two hours; returns the model file."""
    recording, model = write_warm_up(folder / 'warm_up.csv'), folder / 'model.yaml'
    command = [sys.executable, '-m', 'wrist_ft_comp', 'calibrate']
    subprocess.run(
        [*command, str(recording), '-o', str(model)], check=True, stdout=subprocess.DEVNULL
    )
    return model


def keep(name: str, figures: object) -> None:
    """Write figures into out/."""
    folder = Path(__file__).resolve().parents[2] / 'out'
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(json.dumps(figures, indent=1), 'utf-8')
