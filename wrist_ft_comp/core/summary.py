"""A calibration in a few lines that a person can judge."""

from wrist_ft_comp.core.calibration import Calibration
from wrist_ft_comp.core.identification import AxisFit


def summarise(calibration: Calibration) -> str:
    """
    Say what was learnt, axis by axis.

    Parameters
    ----------
    calibration : Calibration
        From calibrate.

    Returns
    -------
    str
        One line per axis, one on the recordings, then the warnings; below 100 columns wide
        but for the warnings.

    """
    lines = [_axis_line(axis, fit) for axis, fit in calibration.fits.items()]
    ranges = ', '.join(f'{low:.1f} to {high:.1f}' for low, high in calibration.temperature_range_c)
    lines.append(f'learnt from {calibration.duration_s / 3600:.2f} h at {ranges} °C')
    lines += [f'warning: {warning}' for warning in calibration.warnings]
    return '\n'.join(lines)


def _axis_line(axis: str, fit: AxisFit) -> str:
    """Describe one axis."""
    if fit.model is None:
        return f'{axis}: no compensation; drift held out {fit.rms_before:.3g} {fit.unit} RMS'
    outputs = len(fit.model.dynamics.output_mean)
    what = 'zero and sensitivity' if outputs == 2 else 'zero'
    # A method that a person named is kept although it may do harm; it must not do so silently.
    harm = ': WORSE THAN NONE' if fit.rms_after > fit.rms_before else ''
    return (
        f'{axis}: {fit.rms_before:.3g} -> {fit.rms_after:.3g} {fit.unit} RMS held out '
        f'({what}; {fit.chosen}){harm}'
    )
