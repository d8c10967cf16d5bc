"""
Where a temperature comes from: a topic, or a number inside the messages of a topic.

An entry of ``temperature_topics``, or of ``--temperature-topic``, is one of::

    /ft_sensor/temperature                    sensor_msgs/Temperature, °C
    /bota/bota_frame:temperature              a field of any message, °C
    /joint_states_extra:data[5]:K             an element of an array, in kelvin
    /motors:temperatures[wrist_3]             the one that an array of names beside calls so
    /drives:joints[2].motor.temperature:F     any depth, in degrees Fahrenheit
    /plc/state:data[3]*0.1                    in tenths of °C; with :K behind it, of a kelvin

An index may also be written like a field: ``data.5``. A number is multiplied with the factor, and
then is in the unit. Units are never guessed, but a sentence may say which one is probably meant.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
import math
import re
from typing import TypeVar

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.units import TEMPERATURE_UNITS, to_celsius
from wrist_ft_comp.wire.numbers_in_messages import Layout, Path

_Number = TypeVar('_Number', float, FloatArray)
_NAME_PART = r'(?![0-9])(?:[A-Za-z0-9_]|\{(?:node|ns|namespace)\})+'
#: Names of topics as ROS allows them.
_TOPIC = re.compile(rf'(?:~?/)?{_NAME_PART}(?:/{_NAME_PART})*')
#: What stands behind the topic's colon: names of fields and indices, a factor, a unit.
_FIELD = re.compile(
    r'(?P<path>[A-Za-z]\w*(?:\.[A-Za-z]\w*|\.\d+|\[\d+\]|\[[A-Za-z_/][^][:*]*\])*)'
    r'(?:\*(?P<factor>[^:]*))?(?::(?P<unit>[CKF]?))?', re.ASCII)  # fmt: skip
#: Names of fields that are probably temperatures, but not those of a template or an attempt.
_TEMPERATURE_NAME = re.compile(r'(?<!at)temp(?!la|o)|thermo|celsius|kelvin', re.IGNORECASE)
#: Most numbers of a message that a sentence lists.
_NAMED = 8
#: Most elements of an array that are examined.
_LOOKED_AT = 100
_FORM = (
    'expected TOPIC of sensor_msgs/Temperature, or TOPIC:FIELD, TOPIC:FIELD*FACTOR or '
    'TOPIC:FIELD:UNIT, such as /driver/state:joints[2].temperature:K'
)


@dataclass(frozen=True)
class TemperatureSource:
    """One thermometer: a topic, and where in its messages the temperature is."""

    topic: str
    #: Empty for a topic of sensor_msgs/Temperature.
    path: Path = ()
    #: ``C``, ``K`` or ``F``.
    unit: str = 'C'
    #: What the number is multiplied with, before it is in the unit.
    factor: float = 1.0
    #: As it was written.
    entry: str = field(default='', compare=False)

    @property
    def number(self) -> Path:
        """Path of the number, also in a sensor_msgs/Temperature."""
        return self.path or ('temperature',)

    def celsius(self, numbers: _Number) -> _Number:
        """Convert the number, or an array of them, to °C."""
        return to_celsius(numbers * self.factor, self.unit)

    def missing(self, layout: Layout) -> str:
        """Say that a message holds no finite number at the path, and which numbers it has."""
        if layout.find(self.number) is not None:
            return f'The temperature {self.entry!r} is NaN or infinite; expected a finite number.'
        # Those that may be meant come first.
        paths = sorted(numbers_in(layout), key=may_be_temperature, reverse=True)
        named = [path_text(layout.named(path)) for path in paths]
        more = f' and {len(named) - _NAMED} more' if len(named) > _NAMED else ''
        numbers = f'{", ".join(named[:_NAMED]) or "none"}{more}'
        return f'The temperature {self.entry!r} is not there: the numbers there are {numbers}.'


def parse_source(entry: str) -> TemperatureSource:
    """Parse one entry; SettingsError with what was expected where it is wrong."""
    entry = entry.strip()
    topic, colon, inside = entry.partition(':')
    if not _TOPIC.fullmatch(topic):
        name, dot, field_name = topic.partition('.')
        meant = f' Did you mean {name}:{field_name}?' if dot and _TOPIC.fullmatch(name) else ''
        raise SettingsError(
            f'The temperature {entry!r} does not begin with the name of a topic; {_FORM}.{meant}'
        )
    if not colon:
        return TemperatureSource(topic, entry=entry)
    found = _FIELD.fullmatch(inside)
    if not found or inside in TEMPERATURE_UNITS:
        raise SettingsError(
            f'The temperature {entry!r} cannot be understood behind its topic; {_FORM}. A path is '
            'made of names of fields and indices from 0 on, and a unit is C, K or F.'
        )
    try:
        factor = float('1' if found['factor'] is None else found['factor'])
    except ValueError:
        factor = math.nan
    if not math.isfinite(factor) or factor == 0:
        raise SettingsError(f'A factor is a number, such as *9.81; got {entry!r}.')
    steps = re.findall(r'\[\D[^]]*\]|\w+', found['path'])
    path = tuple(int(step) if step.isdecimal() else step for step in steps)
    return TemperatureSource(topic, path, found['unit'] or 'C', factor, entry)


def parse_sources(
    entries: Sequence[str], resolve: Callable[[str], str] = str
) -> tuple[TemperatureSource, ...]:
    """Parse all entries; SettingsError where one is wrong, or two resolve to the same number."""
    sources = tuple(parse_source(entry) for entry in entries)
    seen: dict[tuple[str, Path], str] = {}
    for source in sources:
        key = resolve(source.topic), source.number
        if key in seen:
            raise SettingsError(
                f'The temperatures {seen[key]!r} and {source.entry!r} are one and the same, '
                'named twice; each must be another thermometer. Leave one out.'
            )
        seen[key] = source.entry
    return sources


def path_text(path: Path) -> str:
    """Write a path as in an entry, such as ``joints[2].temperature``."""
    steps = (f'[{step}]' if isinstance(step, int) else f'.{step}' for step in path)
    return ''.join(steps).lstrip('.').replace('.[', '[')


def may_be_temperature(path: Path) -> bool:
    """Whether a field's name says that it is a temperature."""
    return any(_TEMPERATURE_NAME.search(step) for step in path if isinstance(step, str))


def numbers_in(layout: Layout) -> list[Path]:
    """List the numbers of a message, without its headers and the ends of long arrays."""
    found: list[Path] = []
    for path, place in layout.places.items():
        far = any(isinstance(step, int) and step >= _LOOKED_AT for step in path)
        if 'header' not in path and not far:
            indices = range(min(place.size or 0, _LOOKED_AT))
            found += [path] if place.size is None else [(*path, index) for index in indices]
    return found


def temperatures_in(layout: Layout, topic: str) -> list[Path]:
    """
    Find the numbers of a message that are probably temperatures, in the order of its fields.

    A field is one by its name. An element of an array is one by the name at the same place in an
    array of texts beside it, as in control_msgs/DynamicJointState. Where there are none, and the
    topic has the name of a temperature, all numbers of the message may be one.
    """

    def beside(path: Path) -> tuple[Path, str | int, int | None]:
        return path[:-2], path[-1], layout.sizes.get(path[:-1])

    texts = [path for path in layout.texts if isinstance(path[-1], int)]
    named = {beside(path) for path in texts if _TEMPERATURE_NAME.search(layout.text(path))}
    paths = [path for path in numbers_in(layout) if path[0] != 'layout']
    found = [path for path in paths if may_be_temperature(path) or beside(path) in named]
    found = found or (paths if _TEMPERATURE_NAME.search(topic) else [])
    return list(map(layout.named, found))
