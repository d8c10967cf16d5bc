"""A sensor to calibrate, and a gate that holds calibrations back."""

import csv
import os
import sys

import numpy as np
import pytest

from wrist_ft_comp.channels import AXES, temperature_channel

SECOND = 1_000_000_000


class Robot:
    """
    A sensor whose drift is known: each axis follows its gains times lagged temperatures.

    Its motor works by turns; one thermometer or two follow at two speeds.
    """

    GAINS = np.array([0.3, -0.5, 1.0, 0.02, 0.03, -0.05])
    WORK = (1.0, 0.2, 0.8, 0.0, 1.0, 0.5, 0.9, 0.1, 0.0, 0.6, 0.2, 0.9, 0.0)

    def __init__(self, thermometers=1):
        work = np.repeat(self.WORK, 40)
        far, near = _lag(15.0 * work, 600.0), _lag(25.0 * work, 200.0)
        self.temperature_c = 20.0 + np.stack((far, near)[:thermometers], axis=1)
        moved = _lag(far, 300.0) + (0.7 * _lag(near, 100.0) if thermometers > 1 else 0.0)
        self.zero = moved[:, np.newaxis] * self.GAINS
        self._rng = np.random.default_rng(5)

    def raw(self, cell):
        """Reading without load, N and N m."""
        noise = self._rng.normal(0, 0.01, 6) * [1, 1, 1, 0.1, 0.1, 0.1]
        return self.zero[cell] + noise

    def stamps(self, cell):
        """Times of two wrenches in a thermal cell of 10 s."""
        return [1_700_000_000 * SECOND + (10 * cell + part) * SECOND for part in (2, 7)]

    def run(self, rig, cells):
        """Send cells one by one; return outputs, shape (2 N, 6)."""
        outputs = []
        for cell in cells:
            stamps = self.stamps(cell)
            rig.warm(stamps[0], *self.temperature_c[cell])
            outputs.append(rig.stream(stamps, [self.raw(cell) for _ in stamps]))
        return np.concatenate(outputs)

    def write(self, path, cells=300, axes=('force_z',)):
        """Write what a recording of the first cells would hold; every axis takes time to fit."""
        path.parent.mkdir(parents=True, exist_ok=True)
        temperatures = [temperature_channel(j) for j in range(self.temperature_c.shape[1])]
        rows = [
            [
                self.stamps(cell)[0],
                *(self.raw(cell)[AXES.index(axis)] for axis in axes),
                *self.temperature_c[cell],
            ]
            for cell in range(cells)
        ]
        with path.open('w') as file:
            csv.writer(file).writerows([['stamp_ns', *axes, *temperatures], *rows])
        return path


def _lag(x, tau_s):
    """Relax after an input, by the textbook loop."""
    state, lagged = 0.0, np.empty(len(x))
    for k, value in enumerate(x):
        state += (1 - np.exp(-10.0 / tau_s)) * (value - state)
        lagged[k] = state
    return lagged


@pytest.fixture
def make_robot():
    """Give the class, which test modules cannot import."""
    return Robot


class Gate:
    """Holds the next calibration process back until it is opened."""

    def __init__(self, path):
        os.mkfifo(path)
        self._end = os.open(path, os.O_RDWR)
        source = (
            f'import runpy; open({str(path)!r}, "rb", 0).read(1); '
            'runpy.run_module("wrist_ft_comp.jobs.entry", run_name="__main__")'
        )
        self.command = (sys.executable, '-c', source)

    def open(self):
        """Let one process go on."""
        os.write(self._end, b'x')

    def close(self):
        """Give the pipe back."""
        os.close(self._end)


@pytest.fixture
def gate(tmp_path, monkeypatch):
    """Hold calibration processes back."""
    result = Gate(tmp_path / 'gate')
    monkeypatch.setattr('wrist_ft_comp.node.jobs.COMMAND', result.command)
    yield result
    result.close()
