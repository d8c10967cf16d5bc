"""
Units of temperatures, and what stands behind a name: ``NAME*FACTOR:UNIT``.

A number is multiplied with the factor, and then is in the unit: ``data[3]*0.1:K`` are tenths of a
kelvin. Units are never guessed, but a sentence may say which one is probably meant.
"""

from collections.abc import Callable
import math
from typing import TypeVar

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.series import FloatArray

_Number = TypeVar('_Number', float, FloatArray)
#: Factor and offset to °C of every unit of temperatures.
TEMPERATURE_UNITS = {'C': (1.0, 0.0), 'K': (1.0, -273.15), 'F': (5 / 9, -160 / 9)}
#: Other units, in which a reading may be that is implausible in °C.
_OTHER_UNITS = {'degrees Fahrenheit': 'F', 'kelvins': 'K'}
#: Usual temperatures of a robot's wrist, °C: a reading is probably in another unit if conversion
#: from that unit brings it into this range.
_LIKELY_C = (-40.0, 85.0)


def split_scale(text: str) -> tuple[str, float, str]:
    """
    Split ``NAME*FACTOR:UNIT`` into name, factor, 1 without one, and unit, '' without one.

    SettingsError when the factor is no finite number, or 0.
    """
    scaled, _, unit = text.partition(':')
    name, star, written = scaled.partition('*')
    try:
        factor = float(written) if star else 1.0
    except ValueError:
        factor = math.nan
    if not math.isfinite(factor) or factor == 0:
        raise SettingsError(f'A factor is a number, such as *9.81; got {text!r}.')
    return name, factor, unit


def to_celsius(numbers: _Number, unit: str) -> _Number:
    """Convert a number, or an array of numbers, from C, K or F to °C."""
    factor, offset = TEMPERATURE_UNITS[unit]
    return numbers if unit == 'C' else numbers * factor + offset


def other_unit(value: float, lower_c: float, upper_c: float) -> str:
    """Guess the unit in which a temperature that is far off would lie as expected, or empty."""
    names = _OTHER_UNITS.items()
    return next((n for n, unit in names if lower_c <= to_celsius(value, unit) <= upper_c), '')


def unit_remedy(value: float, in_unit: Callable[[str], str]) -> str:
    """
    Say what to do about a temperature, °C, that is probably in another unit.

    ``in_unit`` writes the name, a column or an entry, that reads the same number in unit K or F.
    """
    if not (name := other_unit(value, *_LIKELY_C)):
        return 'Check it and its unit.'
    unit = _OTHER_UNITS[name]
    return f'In {name} it would be {to_celsius(value, unit):.1f} °C: then name it {in_unit(unit)}.'
