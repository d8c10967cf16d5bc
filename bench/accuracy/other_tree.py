"""
``auto`` of another version, which lives in a tree of its own and runs in a process of its own.

Run as a program it answers a world with the package of ``PYTHONPATH``: pickled plain values in,
pickled drift and claim out. 0.2.0 has the same names in other modules.
"""

from __future__ import annotations

import importlib
import os
from pathlib import Path
import pickle
import subprocess
import sys
from typing import Any, TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from worlds_drawn import World

    from wrist_ft_comp.recording import Recording
    from wrist_ft_comp.series import FloatArray


def answer_of_tree(tree: str, world: World) -> tuple[FloatArray, FloatArray]:
    """Calibrate with the package of a tree: drift of the judged day, (N, 6), and claim, (6,)."""
    days = [_plain(day) for day in (*world.learn, world.judge)]
    done = subprocess.run(
        [sys.executable, str(Path(__file__).resolve())],
        env={**os.environ, 'PYTHONPATH': tree},
        input=pickle.dumps((days, world.reference)),
        stdout=subprocess.PIPE,
        check=True,
    )
    drift, claim = pickle.loads(done.stdout)  # noqa: S301 -- from our own process
    return drift, claim


def _plain(day: Recording) -> tuple[Any, ...]:
    """Take out what any version can build a recording of."""
    return (
        day.name, day.period_ns, day.first_cell, day.temperature_c, day.measured, day.wrench,
        day.reference)  # fmt: skip


def _simulate_drift() -> Any:
    """Find a function that is not public: where this version has it, or 0.2.0."""
    try:
        offline = importlib.import_module('wrist_ft_comp.stream.offline')
    except ModuleNotFoundError:
        offline = importlib.import_module('wrist_ft_comp.model.offline')
    return offline.simulate_drift


def main() -> None:
    """Answer a world with the package of PYTHONPATH."""
    package = importlib.import_module('wrist_ft_comp')
    days, reference = pickle.load(sys.stdin.buffer)  # noqa: S301 -- from our own process
    *learn, judge = (package.Recording(*day) for day in days)
    drift, claim = np.zeros_like(judge.wrench), np.full(judge.wrench.shape[1], np.nan)
    try:
        model = package.calibrate(learn, package.CalibrationSettings(reference=reference)).model
    except package.WristFtCompError:
        pass
    else:
        zero, gain = _simulate_drift()(model, judge)
        drift = zero + np.where(gain == 0.0, 0.0, gain * judge.reference)
        claim = np.sqrt(np.mean(model.uncertainty(judge.temperature_c) ** 2, axis=0))
    pickle.dump((drift, claim), sys.stdout.buffer)


if __name__ == '__main__':
    main()
