"""Recordings to read: bags, written by rosbags message by message, and CSV files."""

from importlib import import_module
import sys
from types import ModuleType

import numpy as np
import pytest

T0 = 1_723_248_197_000_000_000


@pytest.fixture(params=['rosbags', 'rosbag2_py'])
def backend(request, monkeypatch):
    """Read and write by either backend; the second one where rosbags cannot be imported."""
    name = 'wrist_ft_comp.recordings.rosbags_backend'
    if request.param == 'rosbag2_py':
        monkeypatch.setitem(sys.modules, 'rosbag2_py', import_module('rosbag2_stand_in'))
        monkeypatch.setitem(sys.modules, name, None)
        monkeypatch.delitem(sys.modules, name.replace('rosbags', 'rosbag2'), raising=False)
    return request.param


@pytest.fixture
def make_bag(tmp_path, messages):
    """Write a bag of 1 kHz wrenches and 10 Hz temperatures, of some storage and compression."""

    def make(storage='sqlite3', compression='none', *, count=3000, name='bag', start_ns=T0):
        k = np.arange(count)
        channels = k % 7, -2.0 + 0 * k, 0.5 * (k % 11), 0.01 + 0 * k, 0.02 + 0 * k, k % 3
        wrenches = np.stack(channels, axis=1)
        parts = messages.run(start_ns + k * 10**6, wrenches, 25 + 1e-4 * k)
        return messages.write(tmp_path / name, parts, storage, compression)

    return make


@pytest.fixture(
    params=[
        'sqlite3 none', 'sqlite3 file', 'sqlite3 message',
        'mcap none', 'mcap file', 'mcap message', 'mcap storage',
    ]
)  # fmt: skip
def storage(request):
    """Every storage that ros2 bag writes, with every compression."""
    return request.param.split()


@pytest.fixture
def make_csv(tmp_path):
    def make(text, name='run.csv'):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return make


IDL = {
    'bool': 'boolean', 'byte': 'octet', 'char': 'uint8', 'float32': 'float', 'float64': 'double',
}  # fmt: skip


def idl(what):
    """Name a field's type as the messages of rclpy do."""
    node, content = what
    if node.name == 'NAME':
        return content.replace('/msg/', '/')
    if node.name == 'BASE':
        name, bound = content
        return f'{name}<{bound}>' if bound else IDL.get(name, name)
    element, size = content
    if node.name == 'ARRAY':
        return f'{idl(element)}[{size}]'
    return f'sequence<{idl(element)}{f", {size}" if size else ""}>'


@pytest.fixture
def installed(messages, monkeypatch):
    """Let Python packages of all known types be there, with what ROS's have to say of fields."""
    modules = {}
    for kind, (_, fields) in messages.store.fielddefs.items():
        package, _, name = kind.partition('/msg/')
        if package not in modules:
            modules[package] = ModuleType(package)
            modules[f'{package}.msg'] = modules[package].msg = ModuleType(f'{package}.msg')
        texts = {field: idl(what) for field, what in fields}
        texts.pop('structure_needs_at_least_one_member', None)  # rclpy does not show it
        lists_fields = classmethod(lambda _, texts=texts: texts)
        made = type(name, (), {'get_fields_and_field_types': lists_fields})
        setattr(modules[package].msg, name, made)
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    return modules
