"""A calibration in a few lines: what was learnt of each axis, and what another day will keep."""

import numpy as np

from wrist_ft_comp.fit.folds import averaged_s
from wrist_ft_comp.fit.result import AxisFit, Calibration


def summarise(calibration: Calibration) -> str:
    """Say what was learnt: a line per axis and payload, one on the recordings, the warnings."""
    lines = []
    for axis, fit in calibration.fits.items():
        line = f'{axis}: no compensation; drift held out {fit.rms_before:.3g} {fit.unit} RMS'
        if fit.model is not None:
            drifts = 'zero and sensitivity' if fit.model.outputs == 2 else 'zero'
            line = (
                f'{axis}: {fit.rms_before:.3g} -> {fit.rms_after:.3g} {fit.unit} RMS held out '
                f'({drifts}; {fit.chosen})'
            )
            # A method that a person named is kept although it may do harm, but not silently.
            line += ': WORSE THAN NONE' if fit.harmful else ''
        limit = another_day(fit)
        lines.append(f'{line}. {limit}' if limit else line)
    lines += calibration.payloads.lines() if calibration.payloads else []
    ranges = ', '.join(f'{low:.1f} to {high:.1f}' for low, high in calibration.temperature_range_c)
    lines += filter(None, [conditions_of_another_day(calibration)])
    lines.append(f'learnt from {calibration.duration_s / 3600:.2f} h at {ranges} °C')
    lines += [f'warning: {warning}' for warning in calibration.warnings]
    return '\n'.join(lines)


def another_day(fit: AxisFit) -> str:
    """Say what another day of an axis is accepted by; nothing of a chamber test."""
    if np.isnan(fit.largest_drift):
        return ''
    drift = f'{fit.largest_drift:.2g} {fit.unit}'
    if fit.model is None:
        return f'Another day: not compensated, {drift}.'
    if np.isnan(fit.day_limit):
        return f'Another day: nothing can be promised (uncompensated {drift}); record one more.'
    return f'Another day: below {fit.day_limit:.2g} {fit.unit} (uncompensated {drift}).'


def conditions_of_another_day(calibration: Calibration) -> str:
    """Say under which conditions the limits of another day hold; nothing of a chamber test."""
    if all(np.isnan(fit.largest_drift) for fit in calibration.fits.values()):
        return ''
    ranges = calibration.temperature_range_c.tolist()
    low_c, high_c = max(ranges, key=lambda ends: ends[1] - ends[0])
    return (
        f'"Another day" is 95 of 100 days, tared, between {low_c:.0f} and {high_c:.0f} °C, in '
        f'means over {averaged_s(calibration.model):g} s.'
    )
