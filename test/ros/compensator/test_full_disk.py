"""A disk that takes no more: clear messages, the stream goes on, and what was there stays."""

from contextlib import suppress
import queue
import signal

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='the node tests need ROS 2 (rclpy)')

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import Temperature
from std_srvs.srv import SetBool, Trigger

from wrist_ft_comp.files.model_file import load_model
from wrist_ft_comp.files.model_store import ModelStore
from wrist_ft_comp.files.recordings import read_recording
from wrist_ft_comp.files.state_file import load_state
from wrist_ft_comp.model.signals import AXES
from wrist_ft_comp.ros.messages import wrench_message

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
TIMEOUT_S = 60.0
#: No file may grow beyond this: a header and some rows of a recording fit, a state does not.
LIMIT = 400
#: Python ignores the signal that would end it, so that writing fails as on a full disk.
LIMITED = f"""
import resource, sys
from wrist_ft_comp.ros import compensator_node
resource.setrlimit(resource.RLIMIT_FSIZE, ({LIMIT}, {LIMIT}))
sys.exit(compensator_node.main())
"""


class Peer:
    """Talks to a process's node."""

    def __init__(self, bench, name):
        self.bench, self.name = bench, name
        self.outputs = bench.listen(WrenchStamped, f'/{name}/wrench')
        self.arrays = bench.listen(DiagnosticArray, '/diagnostics')
        self._raw = bench.publisher(WrenchStamped, f'/{name}/wrench_raw')
        self._heat = bench.publisher(Temperature, f'/{name}/temperature')
        self._second = 0

    def goes_on(self, cells=1):
        """Send thermal cells, and wrenches until one comes out."""
        for _ in range(cells):
            message = Temperature(temperature=25.0)
            self._second += 1
            message.header.stamp.sec = START // SECOND + self._second
            self._heat.publish(message)
            for nanosecond in range(100):
                stamp = START + self._second * SECOND + nanosecond
                self._raw.publish(wrench_message(stamp, 'tool0', [1.0] * 6))
                with suppress(queue.Empty):
                    self.outputs.get(timeout=0.2)
                    break
            else:
                pytest.fail('no output')

    def call(self, service, data=None):
        kind = Trigger if data is None else SetBool
        request = kind.Request() if data is None else kind.Request(data=data)
        return self.bench.call(kind, f'/{self.name}/{self.name}/{service}', request, 60.0)

    def says(self, words):
        """Wait until a status says so; cells go on meanwhile."""
        for _ in range(200):
            self.goes_on()
            with suppress(queue.Empty):
                while True:
                    statuses = self.arrays.get(timeout=0.05).status
                    if any(words in each.message for each in statuses):
                        return
        pytest.fail(f'no status says {words!r}')


@pytest.fixture
def data(tmp_path, make_model):
    """A folder with a model that is live, a state, and a recording to calibrate from."""
    folder = tmp_path / 'data'
    model = make_model('a.yaml', {'force_z': (0.5, 0.0, 30.0)})
    store = ModelStore(folder)
    store.activate([None, model.path])
    cells = np.arange(600)
    celsius = 20 + 10 * (1 - np.exp(-cells / 100))
    lines = [','.join(['stamp_s', *AXES, 'temperature_c'])]
    for k, value in zip(cells, celsius, strict=True):
        lines.append(','.join(f'{x:.5f}' for x in (k, *(value - 20) * np.ones(6), value)))
    (folder / 'run.csv').write_text('\n'.join([*lines, '']))
    return folder


def test_a_full_disk_is_told_and_the_stream_goes_on(bench, executable, data):
    name = 'full'
    process = executable(
        '',
        *('-r', f'__ns:=/{name}', '-r', f'__node:={name}', '-p', f'data_directory:={data}'),
        *('-p', f'calibration.recordings:=[{data / "run.csv"}]', '-p', 'save_period:=0.1'),
        *('-p', 'calibration.method:=pls', '--disable-external-lib-logs'),
        source=LIMITED,
    )
    bench.wait_for_node(name)
    before = (data / 'active.json').read_bytes()
    peer = Peer(bench, name)

    peer.goes_on(3)
    peer.says('state.json cannot be written: File too large')

    assert peer.call('record', True).success
    peer.says('The recording has ended after')
    answer = peer.call('record', False)
    assert not answer.success
    assert 'cannot be written: File too large' in answer.message
    assert 'Make room or choose another data_directory' in answer.message
    (recording,) = (data / 'recordings').glob('*.csv')
    assert len(read_recording(recording)) >= 1

    answer = peer.call('calibrate')
    assert not answer.success
    assert 'cannot be written: File too large' in answer.message
    assert 'or make room; no file was changed' in answer.message
    peer.goes_on(3)

    code, errors = process.end(signal.SIGINT)
    assert code == 0, errors
    assert 'Traceback' not in errors
    assert (data / 'active.json').read_bytes() == before
    assert load_state(data / 'state.json') is None
    (model,) = (data / 'models').iterdir()
    assert load_model(model).path.name == 'a.yaml'
    assert not list(data.rglob('.*.tmp')), 'nothing half-written is left'
