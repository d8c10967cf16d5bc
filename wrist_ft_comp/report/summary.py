"""A calibration in a few lines: what was learnt of each axis, and what another day will keep."""

import numpy as np

from wrist_ft_comp.fit.folds import averaged_s
from wrist_ft_comp.fit.result import AxisFit, Calibration


def summarise(calibration: Calibration) -> str:
    """Say what was learnt: a line per axis and payload, one on the recordings, the warnings."""
    lines = [_axis_line(axis, fit) for axis, fit in calibration.fits.items()]
    ranges = ', '.join(f'{low:.1f} to {high:.1f}' for low, high in calibration.temperature_range_c)
    lines += calibration.payloads.lines() if calibration.payloads else []
    lines += acceptance(calibration)
    lines.append(f'learnt from {calibration.duration_s / 3600:.2f} h at {ranges} °C')
    lines += [f'warning: {warning}' for warning in calibration.warnings]
    return '\n'.join(lines)


def _axis_line(axis: str, fit: AxisFit) -> str:
    if fit.model is None:
        return f'{axis}: no compensation; drift held out {fit.rms_before:.3g} {fit.unit} RMS'
    drifts = 'zero and sensitivity' if fit.model.outputs == 2 else 'zero'
    # A method that a person named is kept although it may do harm; it must not do so silently.
    harm = ': WORSE THAN NONE' if fit.harmful else ''
    return (
        f'{axis}: {fit.rms_before:.3g} -> {fit.rms_after:.3g} {fit.unit} RMS held out '
        f'({drifts}; {fit.chosen}){harm}'
    )


def acceptance(calibration: Calibration) -> list[str]:
    """Say by axis what another day is accepted by; nothing of a chamber test."""
    lines = []
    for axis, fit in calibration.fits.items():
        if np.isnan(fit.largest_drift):
            continue
        limit = f'below {fit.day_limit:.2g} {fit.unit}'
        if fit.model is None:
            limit = 'not compensated'
        elif np.isnan(fit.day_limit):
            limit = 'nothing can be promised; record another day, too'
        lines.append(f'  {axis}: {limit}; uncompensated {fit.largest_drift:.2g} {fit.unit}')
    if not lines:
        return []
    ranges = calibration.temperature_range_c.tolist()
    low_c, high_c = max(ranges, key=lambda ends: ends[1] - ends[0])
    tared = f'On another day, tared, between {low_c:.0f} and {high_c:.0f} °C'
    means = f'means over {averaged_s(calibration.model):g} s'
    return [f'{tared}, {means} (95 of 100 days):', *lines]
