"""
Where a temperature comes from: a topic, or a number inside the messages of a topic.

An entry of ``temperature_topics``, or of ``--temperature-topic``, is one of::

    /ft_sensor/temperature                    sensor_msgs/Temperature, °C
    /bota/bota_frame:temperature              a field of any message, °C
    /joint_states_extra:data[5]:K             an element of an array, in kelvin
    /drives:joints[2].motor.temperature:F     any depth, in degrees Fahrenheit

An index may also be written like a field: ``data.5``. Units are never guessed.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
import difflib
from functools import reduce
from itertools import islice
import math
from numbers import Real
import re
from typing import Any, TypeVar

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.signals import FloatArray, NANOSECONDS

_Number = TypeVar('_Number', float, FloatArray)
Path = tuple[str | int, ...]
#: The field of a sensor_msgs/Temperature.
_PLAIN: Path = ('temperature',)
#: Factor and offset to °C of every unit.
_UNITS = {'C': (1.0, 0.0), 'K': (1.0, -273.15), 'F': (5 / 9, -160 / 9)}
#: Other units, in which a reading may be that is implausible in °C.
_OTHER_UNITS = {'degrees Fahrenheit': 'F', 'kelvins': 'K'}
#: Usual temperatures of a robot's wrist, °C: a reading is probably in another unit if conversion
#: from that unit brings it into this range.
_LIKELY_C = (-40.0, 85.0)
_NAME_PART = r'(?![0-9])(?:[A-Za-z0-9_]|\{(?:node|ns|namespace)\})+'
#: Names of topics as ROS allows them.
_TOPIC = re.compile(rf'(?:~?/)?{_NAME_PART}(?:/{_NAME_PART})*')
#: One step of a path: the name of a field, or an index.
_STEP = re.compile(r'[A-Za-z][A-Za-z0-9_]*|[0-9]+')
#: Names of fields that are probably temperatures, but not those of a template or an attempt.
_TEMPERATURE_NAME = re.compile(r'(?<!at)temp(?!la|o)|thermo|celsius|kelvin', re.IGNORECASE)
#: Most numbers of a message that a sentence lists.
_NAMED = 8
#: Most elements of an array that are examined.
_LOOKED_AT = 100
_FORM = (
    'expected TOPIC of sensor_msgs/Temperature, or TOPIC:FIELD or TOPIC:FIELD:UNIT, such as '
    '/driver/state:joints[2].temperature:K'
)


@dataclass(frozen=True)
class TemperatureSource:
    """One thermometer: a topic, and where in its messages the temperature is."""

    topic: str
    #: Names of fields, and indices; empty for a topic of sensor_msgs/Temperature.
    path: Path = ()
    #: ``C``, ``K`` or ``F``.
    unit: str = 'C'
    #: As it was written.
    entry: str = field(default='', compare=False)

    def in_unit(self, unit: str) -> str:
        """Write the entry that reads the same number in another unit."""
        return f'{self.topic}:{path_text(self.path or _PLAIN)}:{unit}'

    def read(self, message: Any) -> float:
        """Read the temperature, °C, from a message; SettingsError, with why, if there is none."""
        path, value = self.path or _PLAIN, message
        for depth, step in enumerate(path):
            if not _has(value, step):
                raise self._refusal(message, value, path[:depth], step)
            value = _part(value, step)
        if not _is_number(value):
            raise self._refusal(message, value, path)
        if not math.isfinite(value):
            raise SettingsError(
                f'The temperature {self.entry!r} is {float(value)}; expected a finite number.'
            )
        return to_celsius(float(value), self.unit)

    def _refusal(
        self, message: Any, value: Any, path: Path, step: str | int | None = None
    ) -> SettingsError:
        """Say that the value at a path is no number, or lacks the next step of the path."""
        name = path_text(path) or 'the message'
        if _is_array(value):
            missing = 'no index is named' if step is None else f'there is no element {step}'
            found = f'{name} is an array of {len(value)}, and {missing}'
            found += f'; expected an index from 0 to {len(value) - 1}' if len(value) else ''
        elif step is None:
            found = f'{name} is no number'
        else:
            found = f'{name} has no {"field" if isinstance(step, str) else "element"} {step}'
        present = _numbers_of(message, self.path or _PLAIN)
        return SettingsError(f'The temperature {self.entry!r} is not there: {found}. {present}')


def to_celsius(numbers: _Number, unit: str) -> _Number:
    """Convert a number, or an array of numbers, from C, K or F to °C."""
    factor, offset = _UNITS[unit]
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


def parse_source(entry: str) -> TemperatureSource:
    """Parse one entry; SettingsError with what was expected where it is wrong."""
    entry = entry.strip()
    topic, *rest = split_entry(entry, 'temperature', _FORM)
    if not rest:
        return TemperatureSource(topic, entry=entry)
    inside, unit = rest[0], (rest[1:] or ['C'])[0]
    if len(rest) > 2 or not inside:
        raise SettingsError(f'The temperature {entry!r} cannot be understood; {_FORM}.')
    if unit not in _UNITS:
        raise SettingsError(
            f'The temperature {entry!r} is in the unit {unit!r}; expected C, K or F, or nothing '
            'for °C.'
        )
    if inside in _UNITS:
        raise SettingsError(
            f'The temperature {entry!r} names a unit and no field; {_FORM}. Of a '
            f'sensor_msgs/Temperature that is not in °C, name {topic}:temperature:{inside}.'
        )
    return TemperatureSource(topic, parse_path(inside, entry, 'temperature'), unit, entry)


def split_entry(entry: str, what: str, form: str) -> list[str]:
    """Split an entry at its colons; SettingsError where it does not begin with a topic."""
    topic, *rest = entry.split(':')
    if not _TOPIC.fullmatch(topic):
        name, dot, inside = topic.partition('.')
        meant = f' Did you mean {name}:{inside}?' if dot and _TOPIC.fullmatch(name) else ''
        raise SettingsError(
            f'The {what} {entry!r} does not begin with the name of a topic; {form}.{meant}'
        )
    return [topic, *rest]


def parse_path(inside: str, entry: str, what: str) -> Path:
    """Parse the names of fields and the indices of an entry; SettingsError where it has others."""
    steps = re.sub(r'\[([0-9]+)\]', r'.\1', inside).split('.')
    for place, step in enumerate(steps):
        if not _STEP.fullmatch(step) or (place == 0 and step.isdecimal()):
            raise SettingsError(
                f'The {what} {entry!r} holds {step!r} where the name of a field'
                f'{" or an index from 0 on" if place else ""} is expected; write a path such as '
                'joints[2].temperature.'
            )
    return tuple(int(step) if step.isdecimal() else step for step in steps)


def parse_sources(
    entries: Sequence[str], resolve: Callable[[str], str] = str
) -> tuple[TemperatureSource, ...]:
    """Parse all entries; SettingsError where one is wrong, or two resolve to the same number."""
    sources = tuple(parse_source(entry) for entry in entries)
    seen: dict[tuple[str, Path], str] = {}
    for source in sources:
        key = resolve(source.topic), source.path or _PLAIN
        if key in seen:
            raise SettingsError(
                f'The temperatures {seen[key]!r} and {source.entry!r} are one and the same, '
                'named twice; each must be another thermometer. Leave one out.'
            )
        seen[key] = source.entry
    return sources


def header_stamp_ns(message: Any) -> int | None:
    """Read the stamp of a message's header, ns, 0 if it was not filled; None without a header."""
    stamp = getattr(getattr(message, 'header', None), 'stamp', None)
    return None if stamp is None else int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def path_text(path: Path) -> str:
    """Write a path as in an entry, such as ``joints[2].temperature``."""
    steps = (f'[{step}]' if isinstance(step, int) else f'.{step}' for step in path)
    return ''.join(steps).lstrip('.')


def may_be_temperature(path: Path) -> bool:
    """Whether a field's name says that it is a temperature."""
    return any(_TEMPERATURE_NAME.search(step) for step in path if isinstance(step, str))


def numbers_in(message: Any, path: Path = ()) -> Iterator[tuple[Path, float]]:
    """List the numbers of a message, without its header and the ends of long arrays."""
    if _is_number(message):
        yield path, float(message)
    elif _is_array(message):
        for index, element in enumerate(islice(message, _LOOKED_AT)):
            yield from numbers_in(element, (*path, index))
    else:
        for name in _fields_of(message):
            if name != 'header':
                yield from numbers_in(getattr(message, name), (*path, name))


def temperatures_in(message: Any, topic: str = '') -> list[Path]:
    """
    Find the numbers of a message that are probably temperatures, in the order of its fields.

    A field is one by its name. An element of an array is one by the name at the same place in an
    array of texts beside it, as in control_msgs/DynamicJointState. Where there are none, and the
    topic has the name of a temperature, all numbers of the message may be one.
    """
    paths = [path for path, _ in numbers_in(message) if path[:1] != ('layout',)]
    named = [path for path in paths if may_be_temperature(path) or _named_beside(message, path)]
    return named or (paths if _TEMPERATURE_NAME.search(topic) else [])


def _named_beside(message: Any, path: Path) -> bool:
    """Whether an array of texts beside the one that a path ends in names a temperature."""
    *above, array, index = ('', *path)
    if isinstance(index, str):
        return False
    part = reduce(_part, above[1:], message)
    size = len(_part(part, array))
    return any(
        isinstance(texts, (list, tuple))
        and len(texts) == size
        and isinstance(texts[index], str)
        and _TEMPERATURE_NAME.search(texts[index]) is not None
        for texts in (getattr(part, name) for name in _fields_of(part))
    )


def _has(value: Any, step: str | int) -> bool:
    if isinstance(step, int):
        return _is_array(value) and step < len(value)
    return step in _fields_of(value)


def _part(value: Any, step: str | int) -> Any:
    return value[step] if isinstance(step, int) else getattr(value, step)


def _numbers_of(message: Any, wanted: Path) -> str:
    """Name numbers of a message: first the most similar one, then those that may be meant."""
    paths = {path_text(path): path for path, _ in numbers_in(message)}
    temperatures = [text for text, path in paths.items() if may_be_temperature(path)]
    alike = difflib.get_close_matches(path_text(wanted), paths, _NAMED, 0.5)
    named = list(dict.fromkeys([*alike[:1], *temperatures, *alike, *paths]))
    if not named:
        return 'The message holds no number at all; name another topic.'
    more = f' and {len(named) - _NAMED} more' if len(named) > _NAMED else ''
    return f'Its numbers are {", ".join(named[:_NAMED])}{more}.'


def _is_number(value: Any) -> bool:
    """Whether a value is a number; true and false are none."""
    return isinstance(value, Real) and not isinstance(value, bool)


def _is_array(value: Any) -> bool:
    """Whether a value is an array, of whatever type; a text is none."""
    return hasattr(value, '__len__') and not isinstance(value, (str, bytes))


def _fields_of(value: Any) -> list[str]:
    """List the fields of a message as rclpy makes it; empty for any other value."""
    return list(getattr(value, 'get_fields_and_field_types', dict)())
