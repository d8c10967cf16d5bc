"""Recordings to read: bags, written by rosbags message by message, and CSV files."""

import numpy as np
import pytest


@pytest.fixture
def make_bag(tmp_path, messages):
    """Write a bag of 1 kHz wrenches and 10 Hz temperatures, of some storage and compression."""

    def make(  # noqa: PLR0913 -- a factory names what it can vary
        storage='sqlite3',
        compression='none',
        *,
        count=3000,
        name='bag',
        wrench='/wrench_raw',
        start_ns=1_723_248_197_000_000_000,
    ):
        k = np.arange(count)
        channels = k % 7, -2.0 + 0 * k, 0.5 * (k % 11), 0.01 + 0 * k, 0.02 + 0 * k, k % 3
        wrenches = np.stack(channels, axis=1)
        parts = messages.run(start_ns + k * 10**6, wrenches, 25 + 1e-4 * k, wrench)
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
    """Write text as a CSV file, byte for byte."""

    def make(text, name='run.csv'):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return make
