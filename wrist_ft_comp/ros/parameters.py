"""
A node's parameters: declare them from one table, check every change, read their values.

The rows are described in ``parameter_table``.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, cast

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from wrist_ft_comp import SettingsError
from wrist_ft_comp.ros.parameter_table import converted, descriptor, Parameter, Value

__all__ = ['Parameter', 'declare', 'values']


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
