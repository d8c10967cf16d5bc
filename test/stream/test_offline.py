"""The drift of a whole recording, and its wrenches corrected, offline."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.stream.offline import correct_many, simulate_drift, track_drift

AXES = {'force_z': (0.4, 1e-3, 50.0), 'torque_x': (0.01, 0.0, 5.0)}
FIRST, CELLS = 7, 60


@pytest.fixture(scope='module')
def recording(make_recording, warm_up):
    return make_recording(warm_up(CELLS, 1), {'force_z': 1.0}, first_cell=FIRST)


def test_a_cells_drift_is_reached_one_cell_after_its_end_and_ramped_to(make_model, recording):
    model = make_model(AXES, period_s=10.0)
    simulated, track = simulate_drift(model, recording), track_drift(model, recording)
    at = np.array([0, FIRST + 1, FIRST + 2, FIRST + 6.5, FIRST + CELLS + 1, 999])
    raw, tare = np.random.default_rng(0).standard_normal((6, 6)), np.arange(6.0)
    corrected = correct_many(track, np.round(at * 1e10).astype(int), raw, tare)
    cells = [[0, 0], [0, 0], [0, 0], [4, 5], [-1, -1], [-1, -1]]
    zero, sensitivity = (part[cells].mean(axis=1) for part in simulated)
    np.testing.assert_allclose(corrected * (1 + sensitivity) + zero + tare, raw, atol=1e-12)
    assert np.ptp(zero[:, 2]) > 1
    assert simulated.zero[0, 2] == pytest.approx(0.4 * (recording.temperature_c[0, 0] - 20.0))
    untared = correct_many(track, np.round(at * 1e10).astype(int), raw + tare)
    np.testing.assert_allclose(untared, corrected + 2 * tare / (1 + sensitivity), atol=1e-12)
    shift = 176_722_560  # since 1970, in cells of 10 s
    late = track_drift(model, replace(recording, first_cell=FIRST + shift))
    stamps = np.round((at + shift) * 1e9).astype(int) * 10
    np.testing.assert_allclose(correct_many(late, stamps, raw, tare), corrected, atol=1e-9)


def test_a_recording_that_does_not_fit_is_refused(make_model, recording):
    slow, two = make_model(AXES, period_s=1.0), make_model(AXES, period_s=10.0, thermometers=2)
    with pytest.raises(RecordingError, match=r'^run is on .* 10\.0 s, .* on 1\.0 s\. .* model\.$'):
        track_drift(slow, recording)
    with pytest.raises(RecordingError, match=r'^run has 1 therm.*, .* expects 2\. .* with\.$'):
        track_drift(two, recording)
