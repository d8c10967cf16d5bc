import numpy as np
import pytest

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.stored.demo_log import DemoLog, load_demo_log, save_demo_log


@pytest.fixture
def log():
    rng = np.random.default_rng(0)
    names = ('raw', 'compensated', 'reference', 'external', 'external_reference')
    wrenches = {name: rng.normal(size=(4, 6)) for name in names}
    return DemoLog(
        stamps_ns=np.arange(4) * 10**9 + 1_700_000_000_123_456_789,
        **wrenches,
        temperature_stamps_ns=np.arange(6),
        thermometer=np.tile([0, 1], 3),
        temperature_c=rng.normal(size=6),
        calibrated_ns=1_700_000_000_000_000_001,
    )


def test_a_saved_log_is_loaded_digit_for_digit(log, tmp_path):
    save_demo_log(tmp_path / 'log.npz', log)
    loaded = load_demo_log(tmp_path / 'log.npz')
    for name, value in vars(log).items():
        np.testing.assert_array_equal(getattr(loaded, name), value)
    assert isinstance(loaded.calibrated_ns, int)


@pytest.mark.parametrize('kept', [None, 0, 10, 300, 1000])
def test_a_log_that_is_missing_or_cut_off_is_a_sentence(kept, log, tmp_path):
    path = tmp_path / 'log.npz'
    if kept is not None:
        save_demo_log(path, log)
        path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(RecordingError, match='not a whole log'):
        load_demo_log(path)
