"""The paper's performance indices of a sensor over temperature: K_s (eq. 23) and A (eq. 24)."""

import numpy as np

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.series import FloatArray


def thermal_sensitivity_drift(
    temperature_c: FloatArray,
    zero_output: FloatArray,
    full_scale_output: FloatArray,
    reference_c: float,
) -> FloatArray:
    """
    Compute the coefficient of thermal sensitivity drift K_s (eq. 23).

        K_s(T_i) = (Y_f(T_i) - Y_0(T_i) - Y_f(T) + Y_0(T)) / ((T_i - T)(Y_f(T) - Y_0(T))) · 100

    Parameters
    ----------
    temperature_c : ndarray, shape (P,)
        T_i, °C.
    zero_output : ndarray, shape (P,)
        Y_0, the output without load at every T_i, in any unit.
    full_scale_output : ndarray, shape (P,)
        Y_f, the output under full load.
    reference_c : float
        T, one of the temperatures, °C.

    Returns
    -------
    ndarray, shape (P,)
        K_s, % of full scale per °C; NaN at T itself.

    Raises
    ------
    SettingsError
        When T is none of the temperatures, or the output does not change with load there.

    """
    at_reference = np.flatnonzero(temperature_c == reference_c)
    spans = full_scale_output - zero_output
    if len(at_reference) != 1 or spans[at_reference[0]] == 0:
        raise SettingsError(
            f'The reference temperature of K_s must be one of {temperature_c.tolist()} °C, where '
            f'zero and full load read differently; got {reference_c:g} °C.'
        )
    span = spans[at_reference[0]]
    distance = np.where(temperature_c == reference_c, np.nan, temperature_c - reference_c)
    return np.asarray(100 * (spans - span) / (distance * span))


def accuracy(output: FloatArray, expected: FloatArray, full_scale: float) -> float:
    """
    Compute the accuracy A: the largest absolute error, in % of full scale (eq. 24).

    Parameters
    ----------
    output : ndarray, any shape
        What was measured, in any unit; NaN where nothing was.
    expected : ndarray, of a shape that broadcasts with it
        What should have been.
    full_scale : float
        Y_FS, the output of full load over that without load.

    Returns
    -------
    float
        A, % of full scale.

    Raises
    ------
    SettingsError
        When the full scale is 0.

    """
    if full_scale == 0:
        raise SettingsError('The full scale of A must not be 0.')
    return float(100 * np.nanmax(np.abs(output - expected)) / abs(full_scale))
