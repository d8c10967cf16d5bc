"""
Fixtures of several rooms: recordings, temperatures, drifts with a known truth, and ROS messages.

Everything here is seeded and written without the package's mathematics and codecs.
"""

from dataclasses import replace
import gc
from importlib.util import find_spec
import struct
from types import SimpleNamespace

from hypothesis import settings
import numpy as np
import pytest

from wrist_ft_comp.channels import AXES, FORCE_CHANNELS
from wrist_ft_comp.drift.arx_pls import Arx, ArxPls
from wrist_ft_comp.drift.drift_model import AxisModel, DriftModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.result import AxisFit, Calibration
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.stored.model_file import save_model

# Machines are shared and noisy: no test fails because it took long.
settings.register_profile('shared', deadline=None)
settings.load_profile('shared')
collect_ignore = [] if find_spec('rclpy') else ['node']
#: Files whose tests take longest, in this order: each begins on a worker of its own. Others stand
#: between the walks through documents: their simulated sensors are hundreds of times faster than
#: real ones, and two at once starve each other.
LONGEST = (
    'test_tutorial', 'test_benches', 'test_separation', 'test_at_work', 'test_bad_recordings',
    'test_show_bag', 'test_readme', 'test_calibrate', 'test_browser',
    'test_html_page', 'test_learning_job', 'test_model_choice', 'test_model_file',
    'test_compensate', 'test_payload', 'test_main', 'test_fleet', 'test_bag_recording',
    'test_gaps', 'test_truth', 'test_identification', 'test_failed_thermometers',
)  # fmt: skip


def pytest_report_header():
    """Say so where the nodes' tests cannot run."""
    return 'test/node is left out: it needs ROS 2 (rclpy)' if collect_ignore else ''


def pytest_collection_modifyitems(items):
    """Run what takes longest first, so that no worker does it alone in the end."""
    place = {name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.stem, len(place)))


def pytest_collection_finish():
    """Take thousands of tests, which stay, out of every later search for garbage."""
    gc.freeze()


def _wrenches(cells, axes):
    wrench = np.full((cells, len(AXES)), np.nan)
    for axis, values in axes.items():
        wrench[:, AXES.index(axis)] = values
    return wrench


@pytest.fixture(scope='session')
def make_recording():
    """Build a recording from temperatures and the axes by name."""

    def make(  # noqa: PLR0913 -- a factory names what it can vary
        temperature_c, wrench, reference=None, *, period_s=10.0, name='run', first_cell=0
    ):
        temperature_c = temperature_c.reshape(len(temperature_c), -1)
        return Recording(
            name=name, period_ns=round(period_s * 1e9), first_cell=first_cell,
            temperature_c=temperature_c, measured=np.ones(temperature_c.shape, dtype=bool),
            wrench=_wrenches(len(temperature_c), wrench),
            reference=_wrenches(len(temperature_c), reference or {}),
        )  # fmt: skip

    return make


#: A tool, and the same with a part in it: kg, and m from the sensor.
TOOL = (1.3, np.array([0.01, -0.02, 0.09]))
HELD = (2.1, np.array([0.02, -0.01, 0.12]))
#: From the frame of the specific force to the wrench's: a quarter turn about z.
QUARTER = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def _weight(payload, force):
    """F = -m f, τ = c × F."""
    pushed = -payload[0] * force
    return np.concatenate((pushed, np.cross(payload[1], pushed)), axis=1)


@pytest.fixture(scope='session')
def make_working_day(make_recording, warm_up):
    """Work for some cells of 1 s: poses of 3 to 9 s, a part in every other minute, contacts."""

    def make(  # noqa: PLR0913 -- a factory names what it can vary
        seed=0, cells=1200, *, part=True, contacts=0.15, noise=0.05, tare_at=None, poses=None
    ):
        rng = np.random.default_rng([13, seed])
        n = np.arange(cells)
        poses = rng.standard_normal((cells // 3, 3)) if poses is None else poses
        poses = poses / np.linalg.norm(poses, axis=1, keepdims=True)
        starts = np.cumsum(rng.integers(3, 10, cells // 3))
        at = np.searchsorted(starts, n, side='right')
        felt = 9.807 * poses[at % len(poses)]
        held = part * (n // 60 % 2)
        wrench = np.where(held[:, None], _weight(HELD, felt), _weight(TOOL, felt))
        temperature_c = warm_up(cells, seed, period_s=4.0)
        drift = (temperature_c - 20.0)[:, None] * [0.3, -0.2, 0.5, 0.01, 0.02, -0.01]
        pushed = rng.uniform(size=cells // 10 + 1) < contacts
        pressed = rng.uniform(5, 60, (len(pushed), 1)) * rng.standard_normal((len(pushed), 6))
        raw = wrench + drift + (pushed * pressed.T).T[n // 10] * [1, 1, 1, 0.1, 0.1, 0.1]
        raw += noise * rng.standard_normal(raw.shape) * [1, 1, 1, 0.02, 0.02, 0.02]
        if tare_at is not None:
            raw[tare_at:] -= raw[tare_at - 1]
        axes = dict(zip(AXES, raw.T, strict=True))
        day = make_recording(temperature_c, axes, period_s=1.0, name=f'day{seed}.csv')
        speed = np.where(np.isin(n, starts), 1.0, 0.0)
        return replace(day, specific_force=felt @ QUARTER, rotation_speed=speed)

    return make


def _write_table(path, columns):
    """Write columns by name as a CSV file; None and NaN become empty cells."""
    import pandas  # noqa: PLC0415 -- only who needs it

    pandas.DataFrame(columns).to_csv(path, index=False)
    return path


def _warm_day(seconds, seed):
    """A warm-up, sampled once a second: times, and two thermometers, °C."""
    t = np.arange(float(seconds))
    wave_s = np.random.default_rng(seed).uniform(60, 90)
    inside = 20 + 12 * (1 - np.exp(-t / 150)) + 3 * np.sin(t / wave_s)
    return t, inside, 20 + 6 * (1 - np.exp(-t / 400)) + 2 * np.sin(t / 150)


def _drifting(seconds=400, seed=0, *, both=False, offset=3.0, every=1):
    """Columns of an unloaded recording: force z drifts with temperatures, torque x hardly."""
    t, inside, outside = _warm_day(seconds, seed)
    rng = np.random.default_rng(seed + 100)
    drift = 1.5 * (inside - 20) - 0.8 * (outside - 20) * both
    columns = {
        'stamp_s': t, 'temperature_c': inside, **({'temperature_2_c': outside} if both else {}),
        'force_z': offset + drift + rng.normal(0, 0.02, seconds),
        'torque_x': 0.01 * (inside - 20) + rng.normal(0, 0.001, seconds),
    }  # fmt: skip
    return {name: column.tolist()[::every] for name, column in columns.items()}


def _loaded(seconds=600, seed=0):
    """Columns of a loaded recording with its reference: zero 0.5 N/K, gain -0.2 %/K."""
    t, inside, _ = _warm_day(seconds, seed)
    rng = np.random.default_rng(seed + 200)
    load = np.repeat(rng.uniform(-50, 50, seconds // 5), 5)[:seconds]
    load[:60] = 0.0
    raw = (1 - 0.002 * (inside - 20)) * load + 0.5 * (inside - 20) + rng.normal(0, 0.01, seconds)
    columns = {
        'stamp_s': t, 'temperature_c': inside, 'force_z': raw, 'reference_force_z': load,
    }  # fmt: skip
    return {name: column.tolist() for name, column in columns.items()}


@pytest.fixture(scope='session')
def make():
    return SimpleNamespace(csv=_write_table, drifting=_drifting, loaded=_loaded)


@pytest.fixture(scope='session')
def write_working_day():
    """Write such a day as a CSV file, with more columns by name."""

    def write(path, day, more=None):
        columns = {
            'stamp_s': np.arange(len(day)) + 0.5, 'temperature_c': day.temperature_c[:, 0],
            **dict(zip(AXES, day.wrench.T, strict=True)),
            **dict(zip(FORCE_CHANNELS, day.specific_force.T, strict=True)),
            'rotation_speed': day.rotation_speed, **(more or {}),
        }  # fmt: skip
        return _write_table(path, columns)

    return write


@pytest.fixture(scope='session')
def warm_up():
    """Warm up from about 20 to about 40 °C, with a slow room and with switching, seeded."""

    def make(cells, seed, *, period_s=10.0):
        rng = np.random.default_rng(seed)
        t = np.arange(cells) * period_s
        working = np.repeat(rng.uniform(0.0, 1.0, cells // 30 + 1), 30)[:cells]
        temperature = 15.0 * (1 - np.exp(-t / rng.uniform(1000, 2000)))
        temperature += 3.0 * np.sin(2 * np.pi * t / rng.uniform(3000, 6000))
        heat, heated = 0.0, np.empty(cells)
        for k in range(cells):
            heat += period_s / 200.0 * (5.0 * working[k] - heat)
            heated[k] = heat
        return 20.0 + temperature + heated

    return make


@pytest.fixture(scope='session')
def lagged():
    """Relax after an input by the textbook loop, from the steady state of its first value."""

    def make(x, time_constant_s, *, period_s=10.0):
        pole = np.exp(-period_s / time_constant_s)
        u = np.empty(len(x))
        state = x[0]
        for k, value in enumerate(x):
            state = pole * state + (1 - pole) * value
            u[k] = state
        return u

    return make


@pytest.fixture(scope='session')
def make_model():
    """Build a drift model of lags by hand: per axis (gain of o, gain of s, time constant)."""

    def make(  # noqa: PLR0913 -- a factory names what it can vary
        axes, *, period_s=1.0, thermometers=1, reference_c=20.0, range_c=(-100.0, 200.0),
        prediction=None,
    ):  # fmt: skip
        ones, made = np.ones(thermometers), {}
        celsius = Features('powers', reference_c * ones, range_c[0] * ones, range_c[1] * ones)
        for axis, (zero, sensitivity, tau) in axes.items():
            pole = np.exp(-period_s / tau)
            dynamics = ArxPls(
                input_mean=np.zeros(thermometers), input_weight=ones,
                rotations=ones[:, np.newaxis] / thermometers,
                latents=(Arx(np.array([-pole]), np.array([1 - pole])),),
                output_loadings=np.array([[zero], [sensitivity]]), output_weight=np.ones(2),
                output_mean=np.zeros(2),
            )  # fmt: skip
            made[axis] = AxisModel(celsius, dynamics)
        return DriftModel(round(period_s * 1e9), thermometers, made, prediction=prediction)

    return make


@pytest.fixture(scope='session')
def save():
    """Save a model that was made by hand, as a calibration is saved."""

    def save_by_hand(path, model, range_c=(-50.0, 150.0), calibrated=()):
        fits = {
            axis: AxisFit(model.axes.get(axis), 'by hand', (), 1.0, 0.1, 0.1, None, (1.0,))
            for axis in calibrated or model.axes
        }
        ranges_c = np.tile(range_c, (model.thermometers, 1))
        return save_model(path, Calibration(model, fits, ranges_c, 3600.0, ()), {})

    return save_by_hand


class Messages:
    """ROS messages as CDR, and bags of them, by rosbags and message by message."""

    wrench_type = 'geometry_msgs/msg/WrenchStamped'
    temperature_type = 'sensor_msgs/msg/Temperature'
    text_type = 'std_msgs/msg/String'

    def __init__(self):
        typesys = pytest.importorskip('rosbags.typesys')
        self.store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)

    def _header(self, stamp_ns, frame):
        time = self.make('builtin_interfaces/msg/Time', *divmod(stamp_ns, 10**9))
        return self.make('std_msgs/msg/Header', time, frame)

    def wrench(self, stamp_ns, values, frame='ft_sensor', little=True):
        six = [float(value) for value in values]
        vectors = (self.make('geometry_msgs/msg/Vector3', *half) for half in (six[:3], six[3:]))
        body = self.make('geometry_msgs/msg/Wrench', *vectors)
        return self.pack(self.wrench_type, (stamp_ns, frame), body, little=little)

    def temperature(self, stamp_ns, value, frame='ft_sensor', little=True):
        header = stamp_ns, frame
        return self.pack(self.temperature_type, header, float(value), 0.25, little=little)

    def learn(self, kind, text):
        from rosbags.typesys import get_types_from_msg  # noqa: PLC0415 -- only who needs it

        self.store.register(get_types_from_msg(text, kind))
        return kind

    def make(self, kind, *fields):
        """Make a message of any known type; a time in ns, perhaps with a frame, is a header."""
        names = [field for field, _ in self.store.fielddefs[kind][1]]
        if names[0] == 'header':
            at = fields[0] if isinstance(fields[0], tuple) else (fields[0], 'here')
            fields = self._header(*at), *fields[1:]
        return self.store.types[kind](*fields)

    def pack(self, kind, *fields, little=True):
        message = self.make(kind, *fields)
        return bytes(self.store.serialize_cdr(message, kind, little_endian=little))

    def imu(self, stamp_ns, force, rotation, little=True):
        """Serialize an Imu of a driver that knows no orientation and no covariance."""
        kind = 'geometry_msgs/msg/Vector3'
        rotation, force = (self.make(kind, *map(float, v)) for v in (rotation, force))
        unknown, none = np.array([-1.0] + 8 * [0.0]), np.zeros(9)
        turn = self.make('geometry_msgs/msg/Quaternion', 0.0, 0.0, 0.0, 1.0)
        fields = stamp_ns, turn, none, rotation, none, force, unknown
        return self.pack('sensor_msgs/msg/Imu', *fields, little=little)

    def transforms(self, stamp_ns, links, little=True):
        """Serialize a TFMessage of (parent, child, quaternion)."""
        transforms = []
        for parent, child, quaternion in links:
            moved = self.make('geometry_msgs/msg/Vector3', 0.1, 0.2, 0.3)
            turned = self.make('geometry_msgs/msg/Quaternion', *map(float, quaternion))
            transform = self.make('geometry_msgs/msg/Transform', moved, turned)
            kind, header = 'geometry_msgs/msg/TransformStamped', (stamp_ns, parent)
            transforms.append(self.make(kind, header, child, transform))
        return self.pack('tf2_msgs/msg/TFMessage', transforms, little=little)

    def run(self, stamps_ns, wrenches, temperature_c, topic='/wrench_raw'):
        """Wrenches, and at every hundredth a temperature and a message of no interest."""
        content = bytearray(self.wrench(0, [0.0] * 6))
        text = self.pack(self.text_type, 'hello')
        for k, stamp_ns in enumerate(stamps_ns.tolist()):
            struct.pack_into('<iI', content, 4, *divmod(stamp_ns, 10**9))
            struct.pack_into('<6d', content, len(content) - 48, *wrenches[k])
            yield topic, self.wrench_type, stamp_ns + 5000, bytes(content)
            if k % 100 == 0:
                warm = self.temperature(stamp_ns, temperature_c[k])
                yield '/temperature', self.temperature_type, stamp_ns + 6000, warm
                yield '/log', self.text_type, stamp_ns + 7000, text

    def write(self, folder, parts, storage='sqlite3', compression='none'):
        """Write messages by topic, type, time and bytes; without bytes there is only the topic."""
        from rosbags import rosbag2  # noqa: PLC0415 -- only who needs it

        plugin = rosbag2.StoragePlugin[storage.upper()]
        mode = rosbag2.CompressionMode[compression.upper()]
        writer = rosbag2.Writer(folder, version=9, storage_plugin=plugin)
        writer.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
        topics = {}
        with writer:
            for topic, kind, time_ns, content in parts:
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, kind, typestore=self.store)
                if content is not None:
                    writer.write(topics[topic], time_ns, content)
        return folder


@pytest.fixture(scope='module')
def without_pictures():
    """Write reports without pictures, which take most of the time; test/report looks at them."""
    from wrist_ft_comp.report import pictures  # noqa: PLC0415 -- only who needs it

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, 'svg_text', lambda *_: '')
        yield


@pytest.fixture(scope='session')
def messages():
    return Messages()
