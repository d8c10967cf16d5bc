"""
One row of a node's parameter table, and everything that follows from it.

The table is the only place where names, defaults, units and ranges are written: descriptors,
checks and messages are derived. A value may be given as people type it: an integer where a
double is meant, or a single value where an array is meant. rcl drops an empty array ``[]`` of the
command line, so ``['']`` stands for the empty array, and empty strings in arrays do not count.
"""

from dataclasses import dataclass
import math
from typing import Any, cast, TypeAlias

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.parameter import Parameter as RosParameter

from wrist_ft_comp import SettingsError

Value: TypeAlias = bool | int | float | str | tuple[float, ...] | tuple[str, ...]
_Type = RosParameter.Type

_SCALAR_TYPES = {
    bool: _Type.BOOL,
    int: _Type.INTEGER,
    float: _Type.DOUBLE,
    str: _Type.STRING,
}
_ARRAY_TYPES = {float: _Type.DOUBLE_ARRAY, str: _Type.STRING_ARRAY}
_WORDS = {bool: 'true or false', int: 'an integer', float: 'a number', str: 'a string'}
_SMALLEST_INTEGER, _LARGEST_INTEGER = -(2**63), 2**63 - 1


@dataclass(frozen=True)
class Parameter:
    """
    One row of a node's parameter table.

    Attributes
    ----------
    name : str
        As on the command line; dots make groups.
    default : bool, int, float, str or tuple
        Its type is the parameter's type. A tuple makes an array of doubles or of strings.
    description : str
        What it does, a sentence without its unit.
    unit : str
        Unit of the value, empty when it has none.
    minimum, maximum : float, optional
        Inclusive limits of a number, or of every element of an array.
    choices : tuple of str
        The allowed strings; empty when any is.
    read_only : bool
        Whether it is read at start-up only.
    element : type, optional
        float or str; needed where the default is an empty tuple.

    """

    name: str
    default: Value
    description: str
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = False
    element: type | None = None

    def __post_init__(self) -> None:
        """Check the row, so that a wrong table fails in the first test that imports it."""
        known = _ARRAY_TYPES if self.is_array else _SCALAR_TYPES
        if self.element_type not in known:
            raise SettingsError(
                f'Parameter {self.name} needs a default of bool, int, float, str, or a tuple of '
                f'float or str (an empty one with its element type); got {self.default!r}.'
            )
        converted(self, self.default)

    @property
    def is_array(self) -> bool:
        """Whether the value is an array."""
        return isinstance(self.default, tuple)

    @property
    def element_type(self) -> type:
        """The type of the value, or of an array's elements."""
        if not isinstance(self.default, tuple):
            return type(self.default)
        return type(self.default[0]) if self.default else self.element or type(None)

    @property
    def ros_type(self) -> Any:
        """The type as rclpy names it."""
        return (_ARRAY_TYPES if self.is_array else _SCALAR_TYPES)[self.element_type]


def converted(parameter: Parameter, value: Any) -> Value:
    """
    Convert a given value to a parameter's type and check that it is allowed.

    Parameters
    ----------
    parameter : Parameter
        The row of the table.
    value : object
        As it came from the command line, a file or a service.

    Returns
    -------
    bool, int, float, str or tuple
        The value in the parameter's own type.

    Raises
    ------
    SettingsError
        When the type does not fit, a number is not finite or outside the range, or a string is
        not among the choices.

    """
    if not parameter.is_array:
        return cast('Value', _element(parameter, value))
    single = value is None or isinstance(value, (bool, int, float, str))
    elements = [value] if single else list(value)
    return tuple(_element(parameter, element) for element in elements if element != '')


def _element(parameter: Parameter, value: Any) -> Any:
    """Convert and check a scalar, or one element of an array."""
    wanted = parameter.element_type
    if wanted is float and type(value) is int:
        value = float(value)
    fits = type(value) is wanted
    if fits and wanted in (int, float):
        low = -math.inf if parameter.minimum is None else parameter.minimum
        high = math.inf if parameter.maximum is None else parameter.maximum
        fits = math.isfinite(value) and low <= value <= high
    if not fits or (parameter.choices and value not in parameter.choices):
        raise SettingsError(_refusal(parameter, value))
    return value


def _refusal(parameter: Parameter, value: Any) -> str:
    """Say what was expected, what came, and how to set it right."""
    kind = 'an array of which every element is ' if parameter.is_array else ''
    default: Any = parameter.default
    if isinstance(default, tuple):
        default = f"'[{', '.join(map(str, default))}]'"
    return (
        f'Parameter {parameter.name} must be {kind}{_expectation(parameter)}; got {value!r}. '
        f'Its default is {str(default) or "empty"}; '
        f'set it at start-up with -p {parameter.name}:=VALUE'
        f'{"" if parameter.read_only else ", or while running with ros2 param set"}.'
    )


def _expectation(parameter: Parameter) -> str:
    """Describe the allowed scalars of a parameter."""
    if parameter.choices:
        return f'one of {", ".join(parameter.choices)}'
    words = _WORDS[parameter.element_type]
    unit = f' {parameter.unit}' if parameter.unit else ''
    if parameter.minimum is not None and parameter.maximum is not None:
        return f'{words} from {parameter.minimum:g} to {parameter.maximum:g}{unit}'
    if parameter.minimum is not None:
        return f'{words} of at least {parameter.minimum:g}{unit}'
    if parameter.maximum is not None:
        return f'{words} of at most {parameter.maximum:g}{unit}'
    return f'a finite number{unit}' if parameter.element_type is float else words


def descriptor(parameter: Parameter, read_only: bool | None = None) -> ParameterDescriptor:
    """
    Describe a parameter as ``ros2 param describe`` shows it.

    Parameters
    ----------
    parameter : Parameter
        The row of the table.
    read_only : bool, optional
        Overrides the row's own ``read_only``.

    Returns
    -------
    ParameterDescriptor
        Description with unit and time of change, constraints, and the range of a scalar.

    """
    unit = f' Unit: {parameter.unit}.' if parameter.unit else ''
    when = 'Read at start-up only.' if parameter.read_only else 'May change at run time.'
    result = ParameterDescriptor(
        name=parameter.name,
        type=parameter.ros_type.value,
        description=f'{parameter.description}{unit} {when}',
        additional_constraints=f'Must be {_expectation(parameter)}.',
        read_only=parameter.read_only if read_only is None else read_only,
    )
    if not parameter.is_array and (parameter.minimum, parameter.maximum) != (None, None):
        _add_range(result, parameter)
    return result


def _add_range(target: ParameterDescriptor, parameter: Parameter) -> None:
    """Fill in the numeric range of a descriptor that was just made."""
    low, high = parameter.minimum, parameter.maximum
    if parameter.element_type is float:
        target.floating_point_range = [
            FloatingPointRange(
                from_value=-math.inf if low is None else float(low),
                to_value=math.inf if high is None else float(high),
            )
        ]
    else:
        target.integer_range = [
            IntegerRange(
                from_value=_SMALLEST_INTEGER if low is None else int(low),
                to_value=_LARGEST_INTEGER if high is None else int(high),
            )
        ]
