"""The file of payloads: what comes back, names that are never given twice, and what is refused."""

from concurrent.futures import ThreadPoolExecutor
import json

import numpy as np
import pytest

from wrist_ft_comp.errors import ModelFileError
from wrist_ft_comp.payload.weight import ForceFrame, Payload
from wrist_ft_comp.stored.payload_file import add_payloads, load_payloads, PAYLOADS

FRAME = ForceFrame(np.eye(3)[[1, 2, 0]], np.array([0.1, 0.2, 0.3]), np.array([1, 0.9, 1.1]), 'imu')
TOOL = Payload(1.25, np.array([0.01, 0.02, 0.06]), 0.01, np.array([1e-3, 2e-3, 3e-3]), 0.5)
BARE = Payload(2.5, np.zeros(3))


@pytest.fixture
def path(tmp_path):
    return tmp_path / 'models' / PAYLOADS


def test_payloads_come_back_to_the_last_bit_with_their_absent_values(path):
    assert load_payloads(path) == {}
    assert add_payloads(path, 'day', [TOOL, BARE], FRAME) == ['day-1', 'day-2']
    back = load_payloads(path)
    assert list(back) == ['day-1', 'day-2']
    for (payload, frame), given in zip(back.values(), (TOOL, BARE), strict=True):
        for name in ('mass_kg', 'center_m', 'mass_error_kg', 'center_error_m', 'share'):
            np.testing.assert_array_equal(getattr(payload, name), getattr(given, name))
        for name in ('rotation', 'bias', 'scale', 'source'):
            np.testing.assert_array_equal(getattr(frame, name), getattr(FRAME, name))


def test_a_name_is_never_given_to_another_payload(path):
    add_payloads(path, 'day', [TOOL, BARE], FRAME)
    before = path.read_text('utf-8')
    assert add_payloads(path, 'day', [TOOL], ForceFrame()) == ['day-3']
    assert add_payloads(path, 'identified', [BARE], FRAME) == ['identified-1']
    back = load_payloads(path)
    assert list(back) == ['day-1', 'day-2', 'day-3', 'identified-1']
    first = json.loads(before)['payloads']
    assert {name: json.loads(path.read_text('utf-8'))['payloads'][name] for name in first} == first


@pytest.mark.parametrize(('right', 'wrong', 'sentence'), [
    ('1.25', '-1.25', 'payloads/day-1: mass_kg must be .* from 0'),
    ('0.06', '60.0', 'center_of_mass_m .* from -10 to 10; got 60'),
    ('0.9', '0', 'payloads/day-1: scale must'),
    ('0.1,', '1e999,', 'payloads/day-1/bias must be finite numbers'),
])  # fmt: skip
def test_a_broken_file_is_refused_with_a_sentence_and_stays(path, right, wrong, sentence):
    add_payloads(path, 'day', [TOOL], FRAME)
    broken = path.read_text('utf-8').replace(right, wrong)
    path.write_text(broken, 'utf-8')
    with pytest.raises(ModelFileError, match=sentence):
        load_payloads(path)
    with pytest.raises(ModelFileError, match=sentence):
        add_payloads(path, 'day', [BARE], FRAME)
    assert path.read_text('utf-8') == broken


def test_payloads_that_are_added_at_once_are_all_kept(tmp_path):
    path = tmp_path / PAYLOADS
    with ThreadPoolExecutor(8) as pool:
        names = list(pool.map(lambda _: add_payloads(path, 'day', [TOOL], FRAME)[0], range(24)))
    assert sorted(names) == sorted(load_payloads(path)) == sorted(f'day-{n}' for n in range(1, 25))
