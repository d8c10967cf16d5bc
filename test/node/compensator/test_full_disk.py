"""A disk that takes no more: clear messages, the stream goes on, and what was there stays."""

from contextlib import suppress
import queue
import signal

from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import pytest

from wrist_ft_comp.recordings.read import read_recording
from wrist_ft_comp.signals import AXES
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.model_store import HistoryEntry, ModelStore
from wrist_ft_comp.stored.state_file import load_state

#: No file may grow beyond this: a header and some rows of a recording fit, a state does not.
LIMIT = 400
#: Python ignores the signal that would end it, so that writing fails as on a full disk.
LIMITED = f"""
import resource, sys
from wrist_ft_comp.node import compensator as compensator_node
resource.setrlimit(resource.RLIMIT_FSIZE, ({LIMIT}, {LIMIT}))
sys.exit(compensator_node.main())
"""


def wait_for_status(arrays, peer, words):
    """Wait until a status wait_for_status so; cells go on meanwhile."""
    for _ in range(200):
        peer.cells()
        with suppress(queue.Empty):
            while True:
                statuses = arrays.get(timeout=0.05).status
                if any(words in status.message for status in statuses):
                    return
    pytest.fail(f'no status wait_for_status {words!r}')


@pytest.fixture
def data(tmp_path, make_model):
    """A folder with a model that is live, a state, and a recording to calibrate from."""
    folder = tmp_path / 'data'
    model = make_model('a.yaml', {'force_z': (0.5, 0.0, 30.0)})
    store = ModelStore(folder)
    store.activate([HistoryEntry(None), HistoryEntry(model.path, model.sha256)])
    cells = np.arange(600)
    celsius = 20 + 10 * (1 - np.exp(-cells / 100))
    table = np.column_stack([cells, *[celsius - 20] * len(AXES), celsius])
    names = ','.join(['stamp_s', *AXES, 'temperature_c'])
    np.savetxt(folder / 'run.csv', table, '%.5f', ',', header=names, comments='')
    return folder


def test_a_full_disk_is_a_warning_and_the_stream_goes_on(bench, peer, executable, data):
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
    peer, arrays = peer(f'/{name}', name), bench.listen(DiagnosticArray, '/diagnostics')

    peer.cells(3)
    wait_for_status(arrays, peer, 'state.json cannot be written: File too large')

    assert peer.call('record', data=True).success
    wait_for_status(arrays, peer, 'The recording has ended after')
    answer = peer.call('record', data=False)
    assert not answer.success
    assert 'cannot be written: File too large' in answer.message
    assert 'the disk has room, or choose another data_directory' in answer.message
    (recording,) = (data / 'recordings').glob('*.csv')
    assert len(read_recording(recording)) >= 1

    answer = peer.call('calibrate')
    assert not answer.success
    assert 'cannot be written: File too large' in answer.message
    assert 'or make room; no file was changed' in answer.message
    peer.cells(3)

    code, errors = process.end(signal.SIGINT)
    assert code == 0, errors
    assert 'Traceback' not in errors
    assert (data / 'active.json').read_bytes() == before
    assert load_state(data / 'state.json') is None
    (model,) = (data / 'models').iterdir()
    assert load_model(model).path.name == 'a.yaml'
    assert not list(data.rglob('.*.tmp')), 'nothing half-written is left'
