"""Data of one axis for fits."""

import pytest

from wrist_ft_comp.fit.axis_data import build_axis_data
from wrist_ft_comp.fit.folds import assign_folds


@pytest.fixture(scope='session')
def make_axis_data(make_recording):
    """Build force z of recordings from raw wrenches; with loads, the reference was recorded."""

    def make(temperatures, raws, loads=None, *, folds=None, period_s=10.0):
        reference = 'unloaded' if loads is None else 'recorded'
        known = [{}] * len(raws) if loads is None else [{'force_z': load} for load in loads]
        recordings = [
            make_recording(temperature_c, {'force_z': raw}, load, period_s=period_s)
            for temperature_c, raw, load in zip(temperatures, raws, known, strict=True)
        ]
        folds = assign_folds(recordings) if folds is None else folds
        return build_axis_data(recordings, 'force_z', reference, folds)

    return make
