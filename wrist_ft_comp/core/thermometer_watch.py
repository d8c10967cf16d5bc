"""Watching thermometers: readings no sensor has, jumps no body makes, and units mixed up."""

from wrist_ft_comp.core.recording import FloatArray, NANOSECONDS

#: A wrist sensor's thermometer reads nothing outside this, °C; 0 K and kelvins are.
PLAUSIBLE_C = (-100.0, 200.0)
#: No thermometer in a piece of metal moves by more between two cells: this, K, and this, K/s.
_JUMP_K, _JUMP_K_S = 2.0, 0.2


class ThermometerWatch:
    """
    Remembers the thermal cells of several thermometers.

    Parameters
    ----------
    thermometers : int
        Number of thermometers J.

    """

    def __init__(self, thermometers: int) -> None:
        #: Jumps of each thermometer.
        self.jumps = [0] * thermometers
        #: The newest jump of each, K.
        self.last_jump_k = [0.0] * thermometers
        self._before: FloatArray | None = None

    def look(self, temperature_c: FloatArray, cells: int, period_ns: int) -> None:
        """
        Look at completed cells.

        Parameters
        ----------
        temperature_c : ndarray, shape (J,)
            Their temperatures, °C.
        cells : int
            How many.
        period_ns : int
            Length of one, ns.

        """
        before, self._before = self._before, temperature_c
        if before is None:
            return
        limit_k = _JUMP_K + _JUMP_K_S * cells * period_ns / NANOSECONDS
        for j, step_k in enumerate((temperature_c - before).tolist()):
            if abs(step_k) > limit_k:
                self.jumps[j] += 1
                self.last_jump_k[j] = step_k


def other_unit(value: float, lower_c: float, upper_c: float) -> str:
    """
    Guess the unit of a temperature that is far off.

    Parameters
    ----------
    value : float
        As it was read.
    lower_c, upper_c : float
        What would be expected, °C.

    Returns
    -------
    str
        The unit in which it would be as expected, or empty.

    """
    in_units = {'degrees Fahrenheit': (value - 32.0) / 1.8, 'kelvins': value - 273.15}
    fitting = [unit for unit, celsius in in_units.items() if lower_c <= celsius <= upper_c]
    return fitting[0] if fitting else ''


def is_plausible(value: float) -> bool:
    """Tell whether a thermometer may read a value, °C; NaN and infinities may not."""
    return PLAUSIBLE_C[0] < value < PLAUSIBLE_C[1]
