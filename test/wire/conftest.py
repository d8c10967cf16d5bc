"""Messages of any type, and where their parts lie."""

from types import SimpleNamespace

import numpy as np
import pytest

FRAME = """
std_msgs/Header header
string text
string[] names
Motor[<=9] motors
std_msgs/Empty[2] nothing
bool on
int16[2] raw
float32 temperature
uint64 counter
================================================================================
MSG: b_msgs/Motor
string<=20 name
byte mode
float64[] heat
"""


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


@pytest.fixture(scope='session')
def frame(messages):
    """Serialize a message whose texts and arrays move what lies behind them."""
    kind = messages.learn('b_msgs/msg/Frame', FRAME)

    def make(k, little=True, heat=None):
        names = ['shoulder', 'elbow', 'wrist'][: k % 4]
        heat = np.arange(k % 3) + 0.5 + k if heat is None else heat
        motors = [messages.make('b_msgs/msg/Motor', name, 7, heat) for name in names]
        empty = [messages.make('std_msgs/msg/Empty', 0)] * 2
        raw = np.array([k, -k], np.int16)
        fields = make.start_ns + k, 'x' * (k % 3), names, motors, empty, True, raw, 20.0 + k, 7
        return messages.pack(kind, *fields, little=little)

    make.kind, make.start_ns = kind, 1_723_248_197_000_000_000
    return make
