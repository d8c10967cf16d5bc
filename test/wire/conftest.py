"""Messages of any type, and where their parts lie."""

from types import SimpleNamespace

import pytest

from wrist_ft_comp.wire.numbers_in_messages import follow


@pytest.fixture(scope='session')
def define(messages):
    """Give a type's definition, and of all it is made of, by way of the first backend."""
    from rosbags import interfaces  # noqa: PLC0415 -- only who needs it

    from wrist_ft_comp.recordings.rosbags_backend import _define  # noqa: PLC0415

    def of(kind):
        text = messages.store.generate_msgdef(kind, ros_version=2)[0]
        definition = interfaces.MessageDefinition(interfaces.MessageDefinitionFormat.MSG, text)
        native = interfaces.Connection(1, '/a', kind, definition, '', 1, None, None)
        return _define(SimpleNamespace(msgtype=kind, native=native))

    return of


@pytest.fixture
def lay_out(messages, define):
    """Follow a message of a known type, made of its fields."""
    return lambda kind, *fields: follow(define(kind), kind, messages.pack(kind, *fields))
