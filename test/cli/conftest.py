"""Recordings with a known drift, and the command line run in this process."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
import struct
from typing import NamedTuple

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

from wrist_ft_comp.cli.main import main

ROOT = Path(__file__).parents[2]
KELLER = ROOT / 'data' / 'keller_pa10'
START_NS = 1_700_000_000_000_000_000
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
WRENCH = 'geometry_msgs/msg/WrenchStamped'
TEMPERATURE = 'sensor_msgs/msg/Temperature'


class Outcome(NamedTuple):
    """What a command left: exit code, standard output, standard error."""

    code: int
    out: str
    err: str

    @property
    def sentence(self) -> str:
        """The one line of a refusal."""
        lines = self.err.splitlines()
        assert self.code == 1, self
        assert len(lines) == 1, self.err
        assert not self.out, self.out
        assert lines[0].startswith('wrist_ft_comp: ')
        assert lines[0].endswith('.')
        assert 'Traceback' not in self.err
        return lines[0]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Run a command in this process."""

    def invoke(*argv: object) -> Outcome:
        capsys.readouterr()
        try:
            code = main([str(word) for word in argv])
        except SystemExit as stop:
            code = int(stop.code or 0)
        return Outcome(code, *capsys.readouterr())

    return invoke


@pytest.fixture
def done(run: Callable[..., Outcome]) -> Callable[..., str]:
    """Run a command that has to succeed; gives its standard output."""

    def invoke(*argv: object) -> str:
        outcome = run(*argv)
        assert outcome.code == 0, outcome
        return outcome.out

    return invoke


def write_csv(path: Path, columns: Mapping[str, Iterable[object]], delimiter=',') -> Path:
    """Write columns as text; None and NaN become empty cells."""
    rows = zip(*columns.values(), strict=True)
    lines = [
        delimiter.join('' if v is None or v != v else repr(v).strip("'") for v in row)  # noqa: PLR0124
        for row in rows
    ]
    path.write_text('\n'.join([delimiter.join(columns), *lines, '']), encoding='utf-8')
    return path


def warm_up(seconds: int, seed: int = 0) -> dict[str, list[float]]:
    """A warm-up, sampled once a second, with two thermometers."""
    rng = np.random.default_rng(seed)
    t = np.arange(seconds, dtype=float)
    inside = 20 + 12 * (1 - np.exp(-t / 150)) + 3 * np.sin(t / rng.uniform(60, 90))
    outside = 20 + 6 * (1 - np.exp(-t / 400)) + 2 * np.sin(t / 150)
    return {
        'stamp_s': t.tolist(),
        'temperature_c': inside.tolist(),
        'temperature_2_c': outside.tolist(),
    }


def drifting(seconds: int = 400, seed: int = 0, *, both: bool = False, offset: float = 3.0):
    """An unloaded recording: force z drifts with the temperatures, torque x hardly."""
    columns = warm_up(seconds, seed)
    rng = np.random.default_rng(seed + 100)
    inside = np.array(columns['temperature_c'])
    outside = np.array(columns['temperature_2_c'])
    drift = 1.5 * (inside - 20) - (0.8 * (outside - 20) if both else 0.0)
    force = offset + drift + rng.normal(0, 0.02, seconds)
    torque = 0.01 * (inside - 20) + rng.normal(0, 0.001, seconds)
    if not both:
        del columns['temperature_2_c']
    return {**columns, 'force_z': force.tolist(), 'torque_x': torque.tolist()}


def loaded(seconds: int = 600, seed: int = 0):
    """A loaded recording with its reference: zero 0.5 N/K, gain -0.2 %/K."""
    columns = warm_up(seconds, seed)
    del columns['temperature_2_c']
    rng = np.random.default_rng(seed + 200)
    inside = np.array(columns['temperature_c'])
    load = np.repeat(rng.uniform(-50, 50, seconds // 5), 5)[:seconds]
    load[:60] = 0.0
    raw = (1 - 0.002 * (inside - 20)) * load + 0.5 * (inside - 20) + rng.normal(0, 0.01, seconds)
    return {**columns, 'force_z': raw.tolist(), 'reference_force_z': load.tolist()}


@pytest.fixture(scope='session')
def drift_csv(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One thermometer, unloaded."""
    return write_csv(tmp_path_factory.mktemp('csv') / 'drift.csv', drifting())


@pytest.fixture(scope='session')
def model(tmp_path_factory: pytest.TempPathFactory, drift_csv: Path) -> Path:
    """A model of that recording; read-only."""
    path = tmp_path_factory.mktemp('model') / 'model.yaml'
    assert main(['calibrate', str(drift_csv), '-o', str(path), '--method', 'pls']) == 0
    return path


def _header(stamp_ns: int) -> object:
    time = TYPES['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
    return TYPES['std_msgs/msg/Header'](time, 'ft_sensor')


def _wrench() -> bytearray:
    vector = TYPES['geometry_msgs/msg/Vector3'](*(0.0,) * 3)
    message = TYPES[WRENCH](_header(0), TYPES['geometry_msgs/msg/Wrench'](vector, vector))
    return bytearray(STORE.serialize_cdr(message, WRENCH))


def _temperature(stamp_ns: int, value: float) -> bytes:
    return bytes(
        STORE.serialize_cdr(TYPES[TEMPERATURE](_header(stamp_ns), value, 0.0), TEMPERATURE)
    )


def write_bag(
    folder: Path, storage: str, seconds: int = 90, rate: int = 1000, seed: int = 0
) -> Path:
    """Wrenches at a rate and 10 Hz temperatures of an accelerated warm-up, plus another topic."""
    rng = np.random.default_rng(seed)
    base = _wrench()
    text = bytes(STORE.serialize_cdr(TYPES['std_msgs/msg/String']('hello'), 'std_msgs/msg/String'))
    t = np.arange(seconds * rate) / rate
    inside = 20 + 15 * (1 - np.exp(-t / 25)) + 2 * np.sin(t / 4 + rng.uniform(0, 6))
    force = 1.0 + 2.0 * (inside - 20) + rng.normal(0, 0.05, len(t))
    with Writer(folder, version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        topics = {
            '/wrench_raw': WRENCH,
            '/temperature': TEMPERATURE,
            '/log': 'std_msgs/msg/String',
        }
        raw, warm, log = (writer.add_connection(n, k, typestore=STORE) for n, k in topics.items())
        for k in range(len(t)):
            stamp = START_NS + k * (10**9 // rate)
            struct.pack_into('<iI', base, 4, *divmod(stamp, 10**9))
            struct.pack_into('<6d', base, len(base) - 48, 0.1, -0.2, force[k], 0.01, 0.02, 0.03)
            writer.write(raw, stamp + 1000, bytes(base))
            if k % (rate // 10) == 0:
                writer.write(warm, stamp + 2000, _temperature(stamp, inside[k]))
                writer.write(log, stamp + 3000, text)
    return folder


@pytest.fixture(scope='session')
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One bag of each storage."""
    folder = tmp_path_factory.mktemp('bags')
    return {storage: write_bag(folder / storage, storage) for storage in ('sqlite3', 'mcap')}


@pytest.fixture(scope='session')
def make() -> object:
    """The builders above, for tests: fixtures are what importlib mode shares."""

    class Make:
        csv = staticmethod(write_csv)
        drifting = staticmethod(drifting)
        loaded = staticmethod(loaded)
        bag = staticmethod(write_bag)
        store = STORE
        keller = KELLER
        root = ROOT

    return Make
