"""The drift between thermal cells: reached one cell after a cell's end, and ramped to."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.model.drift_model import DriftModel
from wrist_ft_comp.model.offline import correct_many, simulate_drift, track_drift
from wrist_ft_comp.model.signals import AXES, Recording

Z = AXES.index('force_z')
CELLS = 60


@pytest.fixture(scope='module')
def model(make_model: Callable[..., DriftModel]) -> DriftModel:
    return make_model({'force_z': (0.4, 1e-2, 50.0)}, period_s=10.0)


@pytest.fixture(scope='module')
def recording(make_recording: Callable[..., Recording]) -> Recording:
    temperature_c = 20 + np.linspace(0, 15, CELLS)
    return make_recording(temperature_c, {'force_z': np.zeros(CELLS)}, first_cell=1000)


def test_a_cells_drift_is_reached_one_cell_after_its_end_and_ramped_to(
    model: DriftModel, recording: Recording
) -> None:
    track, simulated = track_drift(model, recording), simulate_drift(model, recording)

    def zero_at(cell: float) -> float:
        stamps = np.full(2, round(cell * recording.period_ns))
        one, nothing = correct_many(track, stamps, np.array([[1.0] * 6, [0.0] * 6]))[:, Z]
        return float(-nothing / (one - nothing))  # -(0 - o)/(1 + s) over 1/(1 + s)

    first = recording.first_cell
    for k in range(CELLS):
        assert zero_at(first + k + 2) == pytest.approx(simulated.zero[k, Z], abs=1e-9)
    half_way = (simulated.zero[4, Z] + simulated.zero[5, Z]) / 2
    assert zero_at(first + 6.5) == pytest.approx(half_way, abs=1e-9)
    assert zero_at(first - 5) == pytest.approx(simulated.zero[0, Z], abs=1e-9)
    assert zero_at(first + CELLS + 99) == pytest.approx(simulated.zero[-1, Z], abs=1e-9)


def test_stamps_since_1970_lose_nothing(model: DriftModel, recording: Recording) -> None:
    shift = 176_722_560  # cells of 10 s
    late = replace(recording, first_cell=recording.first_cell + shift)
    stamps = (recording.first_cell * 10**10) + np.arange(1, 500) * 1_234_567_891
    raw = np.full((len(stamps), 6), 10.0)
    early = correct_many(track_drift(model, recording), stamps, raw)
    shifted = correct_many(track_drift(model, late), stamps + shift * 10**10, raw)
    np.testing.assert_allclose(shifted, early, atol=1e-9)
    assert np.ptp(early[:, Z]) > 1
