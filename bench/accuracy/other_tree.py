"""
Calibrates a world by the package of PYTHONPATH, which may be an earlier version, in its process.

Plain values in, plain values out: names that other versions have in other modules are not used.
"""

import pickle
import sys

import numpy as np

import wrist_ft_comp as package
from wrist_ft_comp.stream.drift_of_recordings import simulate_drift

AXES = 'force_x', 'force_y', 'force_z', 'torque_x', 'torque_y', 'torque_z'


def main() -> None:
    """Answer the world of standard input: drift, (N, 6), expected error and limit, (6,)."""
    days, reference = pickle.load(sys.stdin.buffer)  # noqa: S301 -- from our own process
    *learn, judge = (package.Recording(*day) for day in days)
    drift, (claim, limit) = np.zeros_like(judge.wrench), np.full((2, len(AXES)), np.nan)
    try:
        model = package.calibrate(learn, package.CalibrationSettings(reference=reference)).model
    except package.WristFtCompError:
        pass
    else:
        zero, gain = simulate_drift(model, judge)
        drift = zero + np.where(gain == 0.0, 0.0, gain * judge.reference)
        claim = np.sqrt(np.mean(model.uncertainty(judge.temperature_c) ** 2, axis=0))
        limit = np.array([model.day_limits.get(axis, np.nan) for axis in AXES])
    pickle.dump((drift, claim, limit), sys.stdout.buffer)


if __name__ == '__main__':
    main()
