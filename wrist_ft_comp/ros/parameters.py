"""The compensator's parameters: one table, defaults from the core's settings where it has them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
import math
from typing import Any, cast, TypeAlias

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from wrist_ft_comp.calibration.settings import CalibrationSettings, METHODS
from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.model.ranges import PERIODS_S
from wrist_ft_comp.stream.compensator import StreamSettings

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


def declare(node: Node, table: Sequence[Parameter]) -> None:
    """
    Declare every parameter of a table, with the values that the user gave at start-up.

    Later changes are checked before they happen. Call it once per node.

    Parameters
    ----------
    node : Node
        The node that will own the parameters.
    table : sequence of Parameter
        Its parameters.

    Raises
    ------
    SettingsError
        When a value given at start-up has the wrong type or is not allowed.

    """
    for parameter in table:
        _declare_one(node, parameter)
    rows = {parameter.name: parameter for parameter in table}
    node.add_pre_set_parameters_callback(partial(_as_declared, rows))
    node.add_on_set_parameters_callback(partial(_verdict, rows))


def values(node: Node, table: Sequence[Parameter]) -> dict[str, Any]:
    """
    Read the present values of a table's parameters.

    Parameters
    ----------
    node : Node
        A node on which the table was declared.
    table : sequence of Parameter
        The parameters to read.

    Returns
    -------
    dict of str to bool, int, float, str or tuple
        Value by parameter name; arrays are tuples.

    """
    return {row.name: converted(row, node.get_parameter(row.name).value) for row in table}


def _declare_one(node: Node, parameter: Parameter) -> None:
    """
    Declare one parameter with its start-up value.

    rclpy refuses an integer for a double and takes an empty array for bytes. So the given value
    is read under a dynamic type first, converted, and declared again under the static type.
    """
    name = parameter.name
    node.declare_parameter(name, None, ParameterDescriptor(dynamic_typing=True))
    given = node.get_parameter(name).value
    node.undeclare_parameter(name)
    value = converted(parameter, parameter.default if given is None else given)
    node.declare_parameter(
        name, parameter.ros_type, descriptor(parameter, read_only=False), ignore_override=True
    )
    node.set_parameters([_ros_parameter(parameter, value)])
    node.set_descriptor(name, descriptor(parameter))


def _ros_parameter(parameter: Parameter, value: Value) -> RosParameter:
    """Wrap a converted value for rclpy."""
    untyped: Any = RosParameter
    plain = list(value) if isinstance(value, tuple) else value
    return cast('RosParameter', untyped(parameter.name, parameter.ros_type, plain))


def _as_declared(rows: dict[str, Parameter], given: Sequence[RosParameter]) -> list[RosParameter]:
    """Convert the parameters of a set request; what cannot be converted stays as it is."""
    return [_one_as_declared(rows.get(each.name), each) for each in given]


def _one_as_declared(row: Parameter | None, given: RosParameter) -> RosParameter:
    """Convert one parameter of a set request, if the table has it and its value fits."""
    if row is None or given.value is None:
        return given
    try:
        return _ros_parameter(row, converted(row, given.value))
    except SettingsError:
        if row.ros_type == RosParameter.Type.DOUBLE and type(given.value) is int:
            # So that the refusal speaks of the range, not of a type that would do.
            return _ros_parameter(row, float(given.value))
        return given


def _verdict(rows: dict[str, Parameter], wanted: Sequence[RosParameter]) -> SetParametersResult:
    """Allow or refuse a set request, changing nothing."""
    try:
        for ros_parameter in wanted:
            row = rows.get(ros_parameter.name)
            if row is not None:
                converted(row, ros_parameter.value)
    except SettingsError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)


#: Row for the table of a node that lets its user choose.
EXECUTOR_PARAMETER = Parameter(
    'executor',
    'auto',
    'What runs the callbacks: events (EventsExecutor, which needs less processor time), '
    'default (SingleThreadedExecutor), or auto (events where rclpy has it).',
    choices=('auto', 'events', 'default'),
    read_only=True,
)


NODE_NAME = 'wrist_ft_comp'


_STREAM = StreamSettings()


_CALIBRATION = CalibrationSettings()


#: What concerns the process, not one sensor.
PROCESS_PARAMETERS = (
    Parameter(
        'sensors',
        (),
        'Names of the sensors to serve from this process, each by a node in a namespace of that '
        'name; empty serves one sensor, in no namespace of its own.',
        read_only=True,
        element=str,
    ),
    EXECUTOR_PARAMETER,
)


PARAMETERS = (
    *PROCESS_PARAMETERS,
    Parameter(
        'temperature_topics',
        ('temperature',),
        'Topics of the thermometers; the first is the one inside the sensor.',
        read_only=True,
    ),
    Parameter(
        'model_file',
        '',
        'Model to run, relative to data_directory or to the working directory; empty takes the '
        'one that was live last. Given at start as at the start before, a calibration or rollback '
        'since then goes on. Set at run time, it must lie inside data_directory.',
    ),
    Parameter(
        'data_directory',
        '',
        'Where models and own recordings are kept, by several sensors in a folder each; empty '
        'takes wrist_ft_comp/NODE below ROS_HOME (or ~/.ros).',
        read_only=True,
    ),
    Parameter(
        'save_period',
        5.0,
        'How often the thermal state is saved, so that a restart goes on from it; also when the '
        'node ends, and when the tare or the model changes.',
        unit='s',
        minimum=0.1,
        maximum=3600.0,
        read_only=True,
    ),
    Parameter(
        'thermal_period',
        _STREAM.thermal_period_s,
        'Length of a thermal cell while no model says otherwise, and in recordings.',
        unit='s',
        minimum=PERIODS_S[0],
        maximum=PERIODS_S[1],
        read_only=True,
    ),
    Parameter(
        'temperature_timeout',
        _STREAM.temperature_timeout_s,
        'Silence of a thermometer after which its last value is held and a warning is given.',
        unit='s',
        minimum=0.1,
        maximum=3600.0,
        read_only=True,
    ),
    Parameter(
        'max_drift',
        _STREAM.max_drift_n,
        'Largest zero drift that is subtracted from a force; from a torque, a tenth of it in N m.',
        unit='N',
        minimum=0.0,
        maximum=1e6,
        read_only=True,
    ),
    Parameter(
        'max_drift_rate',
        _STREAM.max_drift_rate_n_s,
        'How fast the zero drift that is subtracted from a force may move; from a torque, a tenth '
        'of it in N m/s. A tare and its reset step at once; a change of model never steps.',
        unit='N/s',
        minimum=0.001,
        maximum=1e6,
        read_only=True,
    ),
    Parameter(
        'uncalibrated',
        'passthrough',
        'What to publish without a model or before the first temperature: the raw wrench, tared '
        '(passthrough), or nothing (silent).',
        choices=('passthrough', 'silent'),
    ),
    Parameter(
        'calibration.recordings',
        (),
        "Recordings to calibrate from; empty takes the node's own, the newest ten. Set at run "
        'time, they must lie inside data_directory.',
        element=str,
    ),
    Parameter(
        'calibration.reference',
        _CALIBRATION.reference,
        'What the true wrench was while recording: zero, an unknown constant, or recorded on '
        'wrench_reference.',
        choices=('unloaded', 'constant', 'recorded'),
    ),
    Parameter(
        'calibration.method',
        _CALIBRATION.identification.method,
        'Identification method.',
        choices=METHODS,
    ),
    Parameter(
        'calibration.min_temperature_span',
        _CALIBRATION.min_temperature_span_k,
        'A calibration is refused when no thermometer spans this much.',
        unit='K',
        minimum=0.0,
        maximum=200.0,
    ),
    Parameter(
        'tare.duration',
        1.0,
        'How long a tare averages, in stamps of the wrench.',
        unit='s',
        minimum=0.01,
        maximum=60.0,
    ),
    Parameter(
        'tare.max_deviation',
        1.0,
        'A tare is refused when a force moves by more, or a torque by more than a tenth of it in '
        'N m.',
        unit='N',
        minimum=0.001,
        maximum=1e6,
    ),
)
