"""Definitions of message types, taken from the Python packages that are installed."""

import importlib
import re

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings.bag import Connection
from wrist_ft_comp.wire.cdr_fields import Definitions, FieldType, SEQUENCE

_NAME = re.compile(r'([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)')
#: What messages say of a field that is an array.
_SEQUENCE = re.compile(r'sequence<(.+?)(?:, [0-9]+)?>')
_ARRAY = re.compile(r'(.+)\[([0-9]+)\]')


def define_installed(connection: Connection) -> Definitions:
    """Collect what a topic's type is made of, and so on; RecordingError where one is missing."""
    definitions: dict[str, list[tuple[str, FieldType]]] = {}
    missing = [connection.msgtype]
    while missing:
        kind = missing.pop()
        parts = _NAME.fullmatch(kind)  # it comes from a file, and names what is imported
        if parts is None:
            raise RecordingError(f'{connection.topic} is {kind!r}, which is no message of ROS.')
        package, name = parts.groups()
        try:
            message = getattr(importlib.import_module(f'{package}.msg'), name)
        except (ImportError, AttributeError) as error:
            raise RecordingError(
                f'{connection.topic} is {connection.msgtype}, and {kind} is not known here '
                f'({error}). Install and source its package {package}; or, where the bag carries '
                "its definition, as those of ROS 2 Iron and later do, run 'pip install rosbags'."
            ) from error
        fields = message.get_fields_and_field_types()
        definitions[kind] = [(field, _field_type(text)) for field, text in fields.items()]
        for _, (element, _) in definitions[kind]:
            if '/' in element and element not in definitions:
                missing.append(element)
    return definitions


def _field_type(text: str) -> FieldType:
    """Read such as ``sequence<double, 5>``, ``double[6]``, ``std_msgs/Header``, ``string<9>``."""
    times: int | None = None
    if match := _SEQUENCE.fullmatch(text):
        text, times = match[1], SEQUENCE
    elif match := _ARRAY.fullmatch(text):
        text, times = match[1], int(match[2])
    package, slash, name = text.partition('/')
    if slash:
        return f'{package}/msg/{name}', times
    return text.partition('<')[0], times
