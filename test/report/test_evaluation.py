"""Models on whole recordings, and a real load cell that they must help."""

from collections.abc import Callable
import csv
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from wrist_ft_comp.calibration.calibrate import calibrate
from wrist_ft_comp.calibration.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.model import offline
from wrist_ft_comp.model.batch_grid import grid_samples
from wrist_ft_comp.model.drift_model import DriftModel
from wrist_ft_comp.model.signals import AXES, Recording, Samples
from wrist_ft_comp.report import evaluation

Array = np.ndarray
LOAD_CELL = (
    Path(__file__).resolve().parents[2].parent / 'shared/data/load_cell/constant_load_run1.csv'
)
Z = AXES.index('force_z')
CELLS = 60


@pytest.fixture(scope='module')
def model(make_model: Callable[..., DriftModel]) -> DriftModel:
    return make_model({'force_z': (0.4, 1e-2, 50.0)}, period_s=10.0)


@pytest.fixture(scope='module')
def loaded(make_recording: Callable[..., Recording], lagged: Callable[..., Array]) -> Recording:
    """A sensor as the model says, with an offset and an error of its own."""
    rng = np.random.default_rng(0)
    temperature_c = 20 + np.linspace(0, 15, CELLS)
    moved = lagged(temperature_c - 20, 50.0)
    load = 30 * rng.standard_normal(CELLS)
    raw = (1 + 1e-2 * moved) * load + 0.4 * moved + 7 + 0.1 * rng.standard_normal(CELLS)
    raw[[0, 1, 30]] = np.nan
    return make_recording(temperature_c, {'force_z': raw}, {'force_z': load}, first_cell=1000)


class TestEvaluate:
    @pytest.mark.parametrize(('tare_s', 'tare_cells'), [(60.0, 6), (65.0, 7), (0.0, 1)])
    def test_it_is_what_a_hand_computes(
        self,
        model: DriftModel,
        loaded: Recording,
        lagged: Callable[..., Array],
        tare_s: float,
        tare_cells: int,
    ) -> None:
        moved = lagged(loaded.temperature_c[:, 0] - 20, 50.0)
        raw, true = loaded.wrench[:, Z], loaded.reference[:, Z]
        first = [k for k in range(CELLS) if np.isfinite(raw[k])][0]  # noqa: RUF015 -- plain
        tared = range(first, first + tare_cells)
        errors: dict[str, list[float]] = {'before': [], 'after': []}
        for name, o, s in (('before', 0 * moved, 0 * moved), ('after', 0.4 * moved, 1e-2 * moved)):
            tare = np.mean([raw[k] - o[k] - (1 + s[k]) * true[k] for k in tared])
            for k in range(CELLS):
                if np.isfinite(raw[k]):
                    errors[name].append((raw[k] - o[k] - tare) / (1 + s[k]) - true[k])
        found = evaluation.evaluate(model, loaded, 'recorded', tare_s)
        assert set(found) == {'force_z'}
        for name, values in errors.items():
            rms = np.sqrt(sum(v * v for v in values) / len(values))
            assert getattr(found['force_z'], f'rms_{name}') == pytest.approx(rms, rel=1e-9)
            peak = max(abs(v) for v in values)
            assert getattr(found['force_z'], f'max_{name}') == pytest.approx(peak, rel=1e-9)
        assert found['force_z'].rms_after < 0.1 * found['force_z'].rms_before

    def test_a_perfect_model_leaves_nothing(
        self, model: DriftModel, loaded: Recording, lagged: Callable[..., Array]
    ) -> None:
        moved = lagged(loaded.temperature_c[:, 0] - 20, 50.0)
        wrench = loaded.wrench.copy()
        wrench[:, Z] = (1 + 1e-2 * moved) * loaded.reference[:, Z] + 0.4 * moved + 7
        found = evaluation.evaluate(model, replace(loaded, wrench=wrench), 'recorded')['force_z']
        assert found.rms_after < 1e-9
        assert found.rms_before > 1

    def test_an_axis_without_model_stays_as_it_was(
        self, model: DriftModel, make_recording: Callable[..., Recording]
    ) -> None:
        raw = np.random.default_rng(1).standard_normal(CELLS)
        recording = make_recording(np.linspace(20, 30, CELLS), {'torque_y': raw})
        found = evaluation.evaluate(model, recording, 'unloaded')['torque_y']
        assert found.rms_before == found.rms_after > 0

    def test_nothing_to_compare_with_is_refused(
        self, model: DriftModel, loaded: Recording
    ) -> None:
        bare = replace(loaded, reference=np.full_like(loaded.reference, np.nan))
        with pytest.raises(RecordingError, match='no cell with both wrench and reference'):
            evaluation.evaluate(model, bare, 'recorded')

    @pytest.mark.parametrize(
        ('change', 'sentence'),
        [
            ({'period_s': 1.0}, 'cells of 10.0 s, the model runs on 1.0 s'),
            ({'thermometers': 2}, 'has 1 thermometers, the model expects 2'),
        ],
    )
    def test_a_recording_that_does_not_fit_is_refused(
        self,
        make_model: Callable[..., DriftModel],
        loaded: Recording,
        change: dict[str, float],
        sentence: str,
    ) -> None:
        other = make_model({'force_z': (0.4, 0.0, 50.0)}, **{'period_s': 10.0, **change})
        for use in (
            lambda: evaluation.evaluate(other, loaded, 'unloaded'),
            lambda: offline.simulate_drift(other, loaded),
            lambda: offline.track_drift(other, loaded),
        ):
            with pytest.raises(RecordingError, match=sentence):
                use()


class TestTrack:
    def test_a_cells_drift_is_reached_one_cell_after_its_end_and_ramped_to(
        self, model: DriftModel, loaded: Recording
    ) -> None:
        track = offline.track_drift(model, loaded)
        simulated = offline.simulate_drift(model, loaded)
        raw = np.ones((1, 6))

        def zero_at(cell: float) -> float:
            stamp = np.array([round(cell * loaded.period_ns)])
            found = offline.correct_many(track, stamp, raw)[0, Z]
            gain_free = offline.correct_many(track, stamp, 0 * raw)[0, Z]
            return float(-gain_free / (found - gain_free))  # -(0 - o)/(1 + s) over 1/(1 + s)

        first = loaded.first_cell
        for k in range(CELLS):
            assert zero_at(first + k + 2) == pytest.approx(simulated.zero[k, Z], abs=1e-9)
        half_way = (simulated.zero[4, Z] + simulated.zero[5, Z]) / 2
        assert zero_at(first + 6.5) == pytest.approx(half_way, abs=1e-9)
        assert zero_at(first - 5) == pytest.approx(simulated.zero[0, Z], abs=1e-9)
        assert zero_at(first + CELLS + 99) == pytest.approx(simulated.zero[-1, Z], abs=1e-9)

    def test_stamps_since_1970_lose_nothing(self, model: DriftModel, loaded: Recording) -> None:
        shift = 176_722_560  # cells of 10 s
        late = replace(loaded, first_cell=loaded.first_cell + shift)
        stamps = (loaded.first_cell * 10**10) + np.arange(1, 500) * 1_234_567_891
        raw = np.full((len(stamps), 6), 10.0)
        early = offline.correct_many(offline.track_drift(model, loaded), stamps, raw)
        found = offline.correct_many(
            offline.track_drift(model, late), stamps + shift * 10**10, raw
        )
        np.testing.assert_allclose(found, early, atol=1e-9)
        assert np.ptp(early[:, Z]) > 1


@pytest.fixture(scope='module')
def load_cell() -> tuple[Array, Array, Array]:
    """Stamps in ns, temperature in °C, load in kg."""
    if not LOAD_CELL.exists():
        pytest.skip(f'the load cell data are not at {LOAD_CELL}')
    with LOAD_CELL.open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file, delimiter=';'))
    stamps = [datetime.fromisoformat(row['time'].replace('Z', '+00:00')) for row in rows]
    return (
        np.array([round(stamp.timestamp()) * 10**9 for stamp in stamps]),
        np.array([float(row['T_C']) for row in rows]),
        np.array([float(row['W_raw_kg']) for row in rows]),
    )


@pytest.mark.parametrize('method', ['auto', 'arx_pls_oe'])
def test_a_real_load_cell_creeps_less_than_raw_and_than_behind_a_straight_line(
    load_cell: tuple[Array, Array, Array], method: str
) -> None:
    """22 kg for 40.8 h outdoors (TANEN project, hmd83, CC BY 4.0): learnt on the first 20 h."""
    stamps, temperature_c, kilograms = load_cell
    assert len(stamps) == 572
    learnt = stamps - stamps[0] < 20 * 3600 * 10**9

    def record(rows: Array) -> Recording:
        values = np.stack((temperature_c[rows], kilograms[rows]), axis=1)
        block = Samples(('temperature_c', 'force_z'), stamps[rows], values)
        return grid_samples([block], name='load cell', period_s=60.0)

    settings = CalibrationSettings(
        reference='constant', identification=IdentificationSettings(method=method)
    )
    calibration = calibrate([record(learnt)], settings)
    new = record(~learnt)
    simulated = offline.simulate_drift(calibration.model, new)
    compensated = (new.wrench - simulated.zero)[:, Z]
    spread = float(np.nanstd(compensated))
    slope, offset = np.polyfit(temperature_c[learnt], kilograms[learnt], 1)
    behind_line = kilograms[~learnt] - slope * temperature_c[~learnt] - offset
    assert spread < 0.2 * np.std(kilograms[~learnt])
    assert spread < 0.95 * np.std(behind_line)
    assert not simulated.sensitivity.any()
    judged = evaluation.evaluate(calibration.model, new, 'constant', tare_s=1e6)['force_z']
    assert judged.rms_after == pytest.approx(spread, rel=1e-6)
