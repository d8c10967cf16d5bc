"""A calibration in a few lines."""

from types import SimpleNamespace

import numpy as np
import pytest

from wrist_ft_comp.fit.calibrate import summarise
from wrist_ft_comp.fit.result import AxisFit, Calibration


def lines(before, after, *, outputs=2, warnings=(), unit='N'):
    """Sum up a calibration of force z, by a model of so many outputs."""
    model = SimpleNamespace(dynamics=SimpleNamespace(output_mean=np.zeros(outputs)))
    chosen = 'static, degree 1'
    fit = AxisFit(model if outputs else None, chosen, (), before, after, unit=unit)
    ranges = np.array([[20, 35.5], [-5, 30]])
    return summarise(Calibration(None, {'force_z': fit}, ranges, 5400.0, warnings)).splitlines()


@pytest.mark.parametrize(('outputs', 'what'), [(1, 'zero'), (2, 'zero and sensitivity')])
@pytest.mark.parametrize('unit', ['N', 'N m'])
def test_an_axis_says_before_after_unit_and_choice(outputs, what, unit):
    line = lines(12.3456, 0.0123456, outputs=outputs, unit=unit)[0]
    assert line == f'force_z: 12.3 -> 0.0123 {unit} RMS held out ({what}; static, degree 1)'


def test_an_axis_without_compensation_says_so():
    line = lines(0.5, 0.5, outputs=0)[0]
    assert line == 'force_z: no compensation; drift held out 0.5 N RMS'


def test_harm_is_called_harm():
    assert lines(1.0, 2.0)[0].endswith('WORSE THAN NONE')
    assert 'WORSE' not in lines(1.0, 1.04)[0]


def test_recordings_are_summed_up_and_warnings_follow():
    assert lines(2.0, 1.0, warnings=('One.', 'Two.'))[1:] == [
        'learnt from 1.50 h at 20.0 to 35.5, -5.0 to 30.0 °C',
        'warning: One.',
        'warning: Two.',
    ]
