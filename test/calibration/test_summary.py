from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.calibration.calibrate import summarise
from wrist_ft_comp.calibration.result import AxisFit, Calibration
from wrist_ft_comp.model.drift_model import DriftModel


@pytest.fixture
def make(make_model):
    """A calibration of some fits, with both outputs unless told otherwise."""

    def build(fits, warnings=(), outputs=2, ranges=((20.0, 35.55),)):
        axes = make_model(dict.fromkeys(fits, (1.0, 0.01, 100.0))).axes
        filled = {}
        for axis, fit in fits.items():
            model = axes[axis]
            if outputs == 1:
                dynamics = replace(
                    model.dynamics, output_loadings=np.ones((1, 1)),
                    output_weight=np.ones(1), output_mean=np.zeros(1),
                )  # fmt: skip
                model = replace(model, dynamics=dynamics)
            filled[axis] = fit if fit.chosen == 'none' else replace(fit, model=model)
        live = {axis: fit.model for axis, fit in filled.items() if fit.model is not None}
        model = DriftModel(10**9, 1, live)
        return Calibration(model, filled, np.array(ranges), 5400.0, tuple(warnings))

    return build


def fit(chosen='static, degree 1', before=12.3456, after=0.0123456):
    return AxisFit(None, chosen, (), before, after, unit='N')


def test_an_axis_says_before_after_unit_and_choice(make):
    lines = summarise(
        make({'force_z': fit(), 'torque_x': replace(fit(), unit='N m')})
    ).splitlines()
    assert lines[:2] == [
        'force_z: 12.3 -> 0.0123 N RMS held out (zero and sensitivity; static, degree 1)',
        'torque_x: 12.3 -> 0.0123 N m RMS held out (zero and sensitivity; static, degree 1)',
    ]


def test_zero_drift_alone_is_called_so(make):
    assert '(zero; static, degree 1)' in summarise(make({'force_z': fit()}, outputs=1))


def test_an_axis_without_compensation_says_so(make):
    line = summarise(make({'force_y': fit('none', 0.5, 0.5)})).splitlines()[0]
    assert line == 'force_y: no compensation; drift held out 0.5 N RMS'


def test_harm_is_called_harm(make):
    worse = summarise(make({'force_z': fit(before=1.0, after=2.0)})).splitlines()[0]
    assert worse.endswith('WORSE THAN NONE')
    assert 'WORSE' not in summarise(make({'force_z': fit(before=1.0, after=1.04)}))


def test_recordings_are_summed_up_and_warnings_follow(make):
    text = summarise(make({'force_z': fit()}, ['One.', 'Two.'], ranges=((20, 35.5), (-5, 30))))
    assert text.splitlines()[1:] == [
        'learnt from 1.50 h at 20.0 to 35.5, -5.0 to 30.0 °C',
        'warning: One.',
        'warning: Two.',
    ]
