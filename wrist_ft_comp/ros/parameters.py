"""Tables of parameters: their rows, how a node declares them, and what ``--help`` says of them."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from difflib import get_close_matches
from functools import partial
import json
import math
from textwrap import fill
from typing import Any, cast, TypeAlias

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from wrist_ft_comp.errors import range_words, SettingsError
from wrist_ft_comp.ros.rclpy_internals import given_parameters

NODE_NAME = 'wrist_ft_comp'
Value: TypeAlias = bool | int | float | str | tuple[float, ...] | tuple[str, ...]
_Type = RosParameter.Type
#: Types in ROS of a scalar and of an array, and the scalar in words.
_TYPES = {
    bool: (_Type.BOOL, None, 'true or false'),
    int: (_Type.INTEGER, None, 'an integer'),
    float: (_Type.DOUBLE, _Type.DOUBLE_ARRAY, 'a number'),
    str: (_Type.STRING, _Type.STRING_ARRAY, 'a string'),
}
#: A name is taken for a mistyped one from this similarity on, 0 to 1.
_SIMILAR = 0.8


@dataclass(frozen=True)
class Parameter:
    """One row of a node's parameter table."""

    #: As on the command line; dots make groups.
    name: str
    #: Its type is the parameter's type. A tuple makes an array of doubles or of strings; an empty
    #: one is of strings.
    default: Value
    #: Its effect, in a sentence without its unit.
    description: str
    unit: str = ''
    #: Inclusive limits of a number, or of every element of an array.
    minimum: float = -math.inf
    maximum: float = math.inf
    #: The allowed strings; empty when any is.
    choices: tuple[str, ...] = ()
    read_only: bool = False

    def __post_init__(self) -> None:
        """Check the row, so that a wrong table fails in the first test that imports it."""
        converted(self, self.default)

    @property
    def is_array(self) -> bool:
        """Whether the value is an array."""
        return isinstance(self.default, tuple)

    @property
    def element_type(self) -> Any:
        """The type of the value, or of an array's elements."""
        if not isinstance(self.default, tuple):
            return type(self.default)
        return type(self.default[0]) if self.default else str

    @property
    def ros_type(self) -> Any:
        """The type as rclpy names it."""
        return _TYPES[self.element_type][self.is_array]

    @property
    def allowed(self) -> str:
        """The allowed scalars, in words."""
        if self.choices:
            return f'one of {", ".join(self.choices)}'
        limits = range_words(self.minimum, self.maximum)
        return ' '.join(filter(None, (_TYPES[self.element_type][2], limits, self.unit)))


class Parameters:
    """A node's parameters: the rows of its table, with the values that it was given."""

    def __init__(self, node: Node, table: Iterable[Parameter]) -> None:
        """Declare all rows; SettingsError where a given value is wrong."""
        self._node, self._rows = node, {row.name: row for row in table}
        given = given_parameters(node)
        for row in self._rows.values():
            value = converted(row, given.get(row.name, row.default))
            # Without the given value: rclpy refuses an integer for a double, and an empty array.
            node.declare_parameter(row.name, row.ros_type, ignore_override=True)
            node.set_parameters([_ros_parameter(row, value)])
            node.set_descriptor(row.name, descriptor(row))
        node.add_pre_set_parameters_callback(self._convert)
        node.add_on_set_parameters_callback(self._check)

    def values(self) -> dict[str, Any]:
        """Read the present values, by name; arrays are tuples."""
        return {
            name: converted(row, self._node.get_parameter(name).value)
            for name, row in self._rows.items()
        }

    def _convert(self, given: Sequence[RosParameter]) -> list[RosParameter]:
        """Convert the parameters of a set request, as far as possible."""
        wanted = list(given)
        for place, parameter in enumerate(given):
            with suppress(SettingsError, KeyError):
                row = self._rows[parameter.name]
                wanted[place] = _ros_parameter(row, converted(row, parameter.value))
        return wanted

    def _check(self, wanted: Sequence[RosParameter]) -> SetParametersResult:
        """Allow or refuse a set request, changing nothing."""
        try:
            for parameter in wanted:
                if parameter.name in self._rows:
                    converted(self._rows[parameter.name], parameter.value)
        except SettingsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)


def converted(row: Parameter, value: Any) -> Value:
    """Convert a given value to a parameter's type; SettingsError where that is impossible."""
    if not row.is_array:
        return cast('Value', _converted_scalar(row, value))
    # None is the empty array that was given.
    elements = [value] if isinstance(value, (bool, int, float, str)) else value or ()
    return tuple(_converted_scalar(row, element) for element in elements if element != '')


def _converted_scalar(row: Parameter, value: Any) -> Any:
    if type(value) is bool and 'off' in row.choices:  # YAML reads off and on as truth values
        value = 'on' if value else 'off'
    if row.element_type is float and type(value) is int:
        value = float(value)
    fits = type(value) is row.element_type
    if fits and row.element_type in {int, float}:
        fits = math.isfinite(value) and row.minimum <= value <= row.maximum
    if fits and (not row.choices or value in row.choices):
        return value
    default: Any = row.default
    if row.is_array:
        default = f"'[{', '.join(map(str, default))}]'"
    is_text = row.element_type is str and not (row.choices or row.is_array)
    form = """'"VALUE"'""" if is_text else 'VALUE'  # without quotes, digits are a number
    raise SettingsError(
        f'Parameter {row.name} must be '
        f'{"an array of which every element is " if row.is_array else ""}{row.allowed}; '
        f'got {value!r}. Its default is {str(default) or "empty"}; '
        f'set it at start-up with -p {row.name}:={form}'
        f'{"" if row.read_only else ", or while running with ros2 param set"}.'
    )


def descriptor(row: Parameter) -> ParameterDescriptor:
    """Describe a parameter as ``ros2 param describe`` shows it."""
    unit = f' Unit: {row.unit}.' if row.unit else ''
    when = 'Read at start-up only.' if row.read_only else 'May change at run time.'
    return ParameterDescriptor(
        name=row.name, type=row.ros_type.value,
        description=f'{row.description}{unit} {when}',
        additional_constraints=f'Must be {row.allowed}.', read_only=row.read_only)  # fmt: skip


def _ros_parameter(row: Parameter, value: Value) -> Any:
    plain = list(value) if isinstance(value, tuple) else value
    return cast('Any', RosParameter)(row.name, row.ros_type, plain)


def usage(
    name: str, what: str, table: Sequence[Parameter], *ends: tuple[str, Mapping[str, str]]
) -> str:
    """Explain a node: its name, what it does, its ends (title, name to purpose), parameters."""

    def entry(end: str, text: str) -> str:
        indent = ' ' * 6
        return f'  {end}\n{fill(text, 79, initial_indent=indent, subsequent_indent=indent)}'

    lines = [f'usage: {name} --ros-args [-p NAME:=VALUE ...] [-r FROM:=TO ...]\n', what]
    for title, purposes in ends:
        lines += [title, *(entry(end, f'{purpose}.') for end, purpose in purposes.items()), '']
    lines.append('parameters (-p, or --params-file FILE); * may change while the node runs:')
    for row in table:
        text = f'{row.description} Must be {row.allowed}; default: {json.dumps(row.default)}.'
        lines.append(entry(f'{row.name}{"" if row.read_only else " *"}', text))
    return '\n'.join([*lines, ''])


def warn_of_unknown(node: Node, log: Any) -> None:
    """
    Warn of parameters that a node was given and that are a mistyped name of one that it declared.

    Other names are those of other nodes: a file may hold the parameters of a whole robot.
    """
    names = node.list_parameters([], 0).names
    for name in sorted(set(given_parameters(node)).difference(names)):
        near = get_close_matches(name, names, 1, _SIMILAR)
        if near and not name.startswith('qos_overrides.'):  # of topics that come later
            log.warning(
                f'There is no parameter {name}, so its value is ignored. Did you mean {near[0]}?'
            )


#: A row whose value is read at start-up only.
at_start = partial(Parameter, read_only=True)
