"""A calibration in a few lines."""

from types import SimpleNamespace

import numpy as np
import pytest

from wrist_ft_comp.fit.result import AxisFit, Calibration
from wrist_ft_comp.report.summary import summarise


@pytest.mark.parametrize(
    ('outputs', 'after', 'unit', 'line'),
    [
        (1, 0.0123456, 'N', '12.3 -> 0.0123 N RMS held out (zero; pls)'),
        (2, 11.0, 'N m', '12.3 -> 11 N m RMS held out (zero and sensitivity; pls)'),
        (0, 12.3456, 'N', 'no compensation; drift held out 12.3 N RMS'),
        (2, 14.0, 'N', '12.3 -> 14 N RMS held out (zero and sensitivity; pls): WORSE THAN NONE'),
    ],
)
def test_an_axis_is_a_line_and_warnings_follow(outputs, after, unit, line):
    model = SimpleNamespace(outputs=outputs) if outputs else None
    fits = {'force_z': AxisFit(model, 'pls', (), 12.3456, after, unit=unit)}
    ranges_c = np.array([[20, 35.5], [-5, 30]])
    assert summarise(Calibration(None, fits, ranges_c, 5400.0, ('One.', 'Two.'))).splitlines() == [
        f'force_z: {line}',
        'learnt from 1.50 h at 20.0 to 35.5, -5.0 to 30.0 °C',
        'warning: One.',
        'warning: Two.',
    ]
