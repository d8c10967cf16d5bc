"""Units in which a table may hold times, forces, torques and temperatures, and their names."""

from collections.abc import Mapping
from itertools import chain
import re
from typing import TypeVar
from unicodedata import normalize

from wrist_ft_comp.channels import axis_unit
from wrist_ft_comp.series import FloatArray, NANOSECONDS

#: What stands for a channel where a column holds stamps.
STAMP = 'stamp'
#: Units of times, the first of which is taken where none is named.
TIME_UNITS_NS = {
    's': NANOSECONDS, 'ns': 1, 'us': 1_000, 'ms': 1_000_000, 'min': 60 * NANOSECONDS,
    'h': 3600 * NANOSECONDS, 'd': 86_400 * NANOSECONDS,
}  # fmt: skip
#: Forms of times that are days, as spreadsheets and MATLAB's datenum have them: the day of 1970.
DAYS_TO_1970 = {'excel': 25_569, 'datenum': 719_529}
#: A form of times: 0 days 00:10:00, as pandas writes it.
TIMEDELTA = 'timedelta'
#: Weight of a kilogram as units define it, N.
_KILOPOND_N = 9.80665
#: By quantity: what one of a unit is in the channel's. The first is taken where none is named.
_UNITS: Mapping[str, Mapping[str, float]] = {
    's': TIME_UNITS_NS,
    '°C': dict.fromkeys('CKF', 1.0),
    'N': {
        'N': 1.0, 'kN': 1e3, 'daN': 10.0, 'mN': 1e-3, 'cN': 1e-2, 'lbf': 4.4482216152605,
        'ozf': 0.27801385095378, 'kgf': _KILOPOND_N, 'gf': _KILOPOND_N / 1e3,
        'g': _KILOPOND_N / 1e3,
    },
    'N m': {
        'Nm': 1.0, 'kNm': 1e3, 'daNm': 10.0, 'cNm': 1e-2, 'mNm': 1e-3, 'Nmm': 1e-3,
        'Ncm': 1e-2, 'lbfin': 0.1129848290276, 'lbfft': 1.3558179483314,
        'ozfin': 0.0070615518333, 'kgfm': _KILOPOND_N, 'kgfcm': _KILOPOND_N / 1e2,
    },
    'm/s²': {'m/s2': 1.0, 'g': _KILOPOND_N},
    'rad/s': {'rad/s': 1.0, 'deg/s': 0.017453292519943},
}  # fmt: skip
#: All names of units.
UNIT_WORDS = {unit for units in _UNITS.values() for unit in units}
#: Other names of units, in small letters, without the signs that plain_unit leaves out.
_OTHER_UNITS = {
    # In capitals, too, but what would be another unit, as MN, or a word of names, as S.
    **{unit.lower(): unit for unit in UNIT_WORDS - {*TIME_UNITS_NS, 'mN', 'mNm', 'g'}},
    'н': 'N', 'нм': 'Nm', 'newton': 'N', 'newtons': 'N', 'lb': 'lbf', 'lbs': 'lbf', 'oz': 'ozf',
    'kg': 'kgf', 'kp': 'kgf', 'grams': 'g', 'newtonmeter': 'Nm', 'newtonmeters': 'Nm',
    'lbin': 'lbfin', 'inlb': 'lbfin', 'inlbf': 'lbfin', 'lbft': 'lbfft', 'ftlb': 'lbfft',
    'inlbs': 'lbfin', 'ftlbf': 'lbfft', 'ozin': 'ozfin', 'inoz': 'ozfin', 'inozf': 'ozfin',
    'degc': 'C', 'degf': 'F', 'celsius': 'C', 'kelvin': 'K', 'fahrenheit': 'F', 'sec': 's',
    'secs': 's', 'seconds': 's', 'sekunden': 's', 'msec': 'ms', 'millis': 'ms', 'micros': 'us',
    'milliseconds': 'ms', 'microseconds': 'us', '\u03bcs': 'us', 'usec': 'us', 'hours': 'h',
    'hr': 'h', 'hrs': 'h', 'stunden': 'h', 'minutes': 'min', 'mins': 'min', 'days': 'd',
}  # fmt: skip
#: What may stand between the units of a product, as in N·mm; in a name a blank or _ may, too.
TIMES = r'*.·⋅∙•×\-'
#: A product with a length, or with a weight: N_mm and in-lbf, but not C_Nm, which is of an axis C.
_PRODUCT = rf'[^\W\d_]+[{TIMES}_ ](?i:[mc]?m|in|ft|lb[fs]?|ozf?)'
#: A word in brackets in a column's name.
_IN_BRACKETS = re.compile(r'[\[(]([^\[\]()]*[^\W\d][^\[\]()]*)[\])]')

#: What is read of a sensor before it is in a unit.
RAW_UNIT = re.compile(r'(?<![a-z])(?:counts?|adc|lsb|mv|volts?|ohms?|(?<=_)v$)(?![a-z])')
_Number = TypeVar('_Number', float, FloatArray)
#: Factor and offset to °C of every unit of temperatures.
TEMPERATURE_UNITS = {'C': (1.0, 0.0), 'K': (1.0, -273.15), 'F': (5 / 9, -160 / 9)}
#: Other units, in which a reading may be that is implausible in °C.
_OTHER_TEMPERATURES = {'degrees Fahrenheit': 'F', 'kelvins': 'K'}
#: What to do about a temperature that no sensor reads.
UNIT_REMEDY = 'Check its unit: a column takes :K, :F or *0.1 behind it, a topic :temperature:K.'


def units_of(channel: str) -> Mapping[str, float]:
    """List the units that a channel, or a stamp, may be in."""
    return _UNITS['s' if channel == STAMP else axis_unit(channel)]


def plain_unit(text: str) -> str:
    """Write a unit as the tables have it: Nm for N*m, lbfin for lb-in, C for °C."""
    plain = re.sub(rf'[\s^°_()\[\]{TIMES}]', '', normalize('NFKC', text))
    return plain if plain in UNIT_WORDS else _OTHER_UNITS.get(plain.lower(), plain)


def known_unit(channel: str, name: str, unit: str = '') -> str:
    """Find the unit of a channel in the name of its column, or beside it; empty where unknown."""
    # In brackets, behind a slash or a comma, or behind an underscore or a blank at the end.
    forms = _PRODUCT, r'[^\W\d][^\W\d_/]*|°\w'
    # Fx (kN) is Fx_kN_ where MATLAB has written it, and Fx..kN. where R has.
    plain = re.sub(r'\.(?=.*\.$)', '_', name.strip()).strip('._')
    behind = [re.findall(rf'(?<=[^\s/_])(?:\s*/\s*|[_\s,]+)({f})$', plain) for f in forms]
    words = map(plain_unit, (*said_units(name, unit), *chain(*behind)))
    return next((word for word in words if word in units_of(channel)), '')


def said_units(name: str, unit: str = '') -> list[str]:
    """List what clearly is meant as a unit of a column: in its name, or beside it."""
    return [
        *_IN_BRACKETS.findall(name),
        *RAW_UNIT.findall(name.lower()),
        *re.findall(rf'(?:,|\s/)\s*([^\W\d]+(?:[{TIMES} ][^\W\d]+)?|°\w)\s*(?=[\[(]|$)', name),
        *filter(None, [unit]),
    ]


def to_celsius(numbers: _Number, unit: str) -> _Number:
    """Convert a number, or an array of numbers, from C, K or F to °C."""
    factor, offset = TEMPERATURE_UNITS[unit]
    return numbers if unit == 'C' else numbers * factor + offset


def other_unit(value: float, lower_c: float, upper_c: float) -> str:
    """Guess the unit in which a temperature that is far off would lie as expected, or empty."""
    names = _OTHER_TEMPERATURES.items()
    return next((n for n, unit in names if lower_c <= to_celsius(value, unit) <= upper_c), '')
