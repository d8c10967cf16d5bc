"""
``auto`` of another version, which lives in a tree of its own and runs in a process of its own.

Run as a program it answers worlds with the package of ``PYTHONPATH``: pickled plain values in,
pickled drift and claim out. 0.2.0 has the same names in other modules.
"""

from __future__ import annotations

from functools import lru_cache
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

    from wrist_ft_comp.signals import FloatArray, Recording

#: Where names live that are not public: in this version, and in 0.2.0.
_OFFLINE = ('wrist_ft_comp.stream.offline', 'wrist_ft_comp.model.offline')


class OtherTree:
    """A process that calibrates with the package of another tree."""

    def __init__(self, tree: str) -> None:
        environment = {**os.environ, 'PYTHONPATH': tree}
        self.process = subprocess.Popen(
            [sys.executable, str(Path(__file__).resolve())],
            env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE)  # fmt: skip

    @staticmethod
    @lru_cache(maxsize=1)
    def at(tree: str) -> OtherTree:
        """Start the process of a tree once."""
        return OtherTree(tree)

    def answer(self, world: World) -> tuple[FloatArray, FloatArray]:
        """Calibrate in the other process: drift of the judged day, (N, 6), and claim, (6,)."""
        assert self.process.stdin  # noqa: S101 -- opened above
        assert self.process.stdout  # noqa: S101
        days = [_plain(day) for day in (*world.learn, world.judge)]
        pickle.dump((days, world.reference), self.process.stdin)
        self.process.stdin.flush()
        drift, claim = pickle.load(self.process.stdout)  # noqa: S301 -- from our own process
        return drift, claim


def _plain(day: Recording) -> tuple[Any, ...]:
    """Take out what any version can build a recording of."""
    return (
        day.name, day.period_ns, day.first_cell, day.temperature_c, day.measured, day.wrench,
        day.reference)  # fmt: skip


def _module(names: tuple[str, str]) -> Any:
    """Import the first of some modules that there is."""
    here, before = names
    try:
        return importlib.import_module(here)
    except ModuleNotFoundError:
        return importlib.import_module(before)


def serve() -> None:
    """Answer worlds until there are no more."""
    package = importlib.import_module('wrist_ft_comp')
    offline = _module(_OFFLINE)
    while True:
        try:
            days, reference = pickle.load(sys.stdin.buffer)  # noqa: S301 -- from our own process
        except EOFError:
            return
        *learn, judge = (package.Recording(*day) for day in days)
        drift, claim = np.zeros_like(judge.wrench), np.full(judge.wrench.shape[1], np.nan)
        try:
            model = package.calibrate(
                learn, package.CalibrationSettings(reference=reference)
            ).model
        except package.WristFtCompError:
            pass
        else:
            zero, gain = offline.simulate_drift(model, judge)
            drift = zero + np.where(gain == 0.0, 0.0, gain * judge.reference)
            deviation = model.uncertainty(judge.temperature_c)
            claim = np.sqrt(np.mean(deviation**2, axis=0))
        pickle.dump((drift, claim), sys.stdout.buffer)
        sys.stdout.buffer.flush()


if __name__ == '__main__':
    serve()
