"""Recordings with a known truth, and data of one axis for fits."""

import numpy as np
import pytest

from wrist_ft_comp.fit.axis_data import build_axis_data
from wrist_ft_comp.fit.folds import assign_folds


@pytest.fixture(scope='session')
def make_axis_data(make_recording):
    """Build force z of recordings from raw wrenches; with loads, the reference was recorded."""

    def make(temperatures, raws, loads=None, *, period_s=10.0):
        known = [{}] * len(raws) if loads is None else [{'force_z': load} for load in loads]
        recordings = [
            make_recording(temperature_c, {'force_z': raw}, load, period_s=period_s)
            for temperature_c, raw, load in zip(temperatures, raws, known, strict=True)
        ]
        return axis_data_of(recordings, 'unloaded' if loads is None else 'recorded')

    return make


def axis_data_of(recordings, reference='unloaded'):
    return build_axis_data(recordings, 'force_z', reference, assign_folds(recordings))


@pytest.fixture(scope='session')
def axis_data():
    return axis_data_of


@pytest.fixture(scope='session')
def simulate(make_recording, warm_up, lagged):
    """
    Record a sensor with known gains at known time constants; o in N/K, s in 1/K.

    A share below 1 keeps a recording within the temperatures of the others.
    """

    def make(seed, zero, sensitivity=None, *, thermometers=1, share=1.0, **more):
        rng = np.random.default_rng([seed, 7])
        cells = more.get('cells', 360)
        noise, gain_error = more.get('noise', 0.0), more.get('gain_error', 0.0)
        both = [20 + share * (warm_up(cells, seed + 1000 * j) - 20) for j in range(thermometers)]
        theta = both[0] - 30
        parts = [gain * lagged(theta, tau) for tau, gain in zero.items()]
        o = sum(part + more.get('square', 0.0) * part**2 for part in parts)
        load = 40 * rng.standard_normal(cells)
        s = gain_error + sum(g * lagged(theta, tau) for tau, g in (sensitivity or {}).items())
        raw = (1 + s) * load + o + 10.0 * seed + noise * rng.standard_normal(cells)
        if sensitivity is None:
            raw -= load
        reference = {} if sensitivity is None else {'force_z': load}
        return make_recording(np.stack(both, axis=1), {'force_z': raw}, reference)

    return make
