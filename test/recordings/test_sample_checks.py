"""Samples onto the thermal grid, as a batch."""

import math

import numpy as np
import pytest

from wrist_ft_comp.channels import AXES, FORCE_CHANNELS
from wrist_ft_comp.recording import Samples
from wrist_ft_comp.recordings.sample_checks import grid_samples

SECOND = 1_000_000_000


def samples(channel, *pairs, origin=0):
    """One channel: pairs of second and value."""
    stamps = np.array([origin + round(s * SECOND) for s, _ in pairs], dtype=np.int64)
    values = np.array([value for _, value in pairs], dtype=float)[:, np.newaxis]
    return Samples((channel,), stamps, values)


def wrenches(*seconds, origin=0):
    return samples('force_z', *((s, 1.0) for s in seconds), origin=origin)


@pytest.mark.parametrize('period_s', [0.5, 1.0, 3.0])
@pytest.mark.parametrize('size', [1, 7, 1000])
def test_cells_are_means_in_pieces_of_any_size(period_s, size):
    rng, pieces, expected = np.random.default_rng(0), [], []
    for channel in ('temperature_c', 'temperature_2_c', 'torque_y'):
        stamps = np.sort(rng.integers(0, 60 * SECOND, 200))
        stamps[0] = 0
        values = rng.uniform(20, 22, 200)
        cells = stamps // round(period_s * SECOND)
        expected.append({cell: values[cells == cell].mean() for cell in cells.tolist()})
        for at in range(0, 200, size):
            part = slice(at, at + size)
            pieces.append(Samples((channel,), stamps[part], values[part, np.newaxis]))
    recording = grid_samples(pieces, period_s=period_s)
    columns = *recording.temperature_c.T, recording.wrench[:, AXES.index('torque_y')]
    for column, means in zip(columns, expected, strict=True):
        np.testing.assert_allclose(column[list(means)], list(means.values()))
    for measured, means in zip(recording.measured.T, expected, strict=False):
        assert np.flatnonzero(measured).tolist() == list(means)
    assert np.isfinite(recording.wrench).any(axis=0).tolist() == [False] * 4 + [True, False]
    assert recording.warnings == ()


@pytest.mark.parametrize('fault', ['backward', 'ahead', 'nan', 'inf', 'kelvin', 'two'])
def test_unusable_samples_are_dropped_and_counted(fault):
    """They come first in a block: of the stamps before it, only the last one is known."""
    good = [(float(k), 20.0 + k / 10) for k in range(200)]
    bad = {
        'backward': [(50.0, 1e6)], 'ahead': [(9000.0, 1e6), (99.0, 29.9)],
        'kelvin': [(99.5, 295.15)], 'nan': [(99.5, math.nan)], 'inf': [(99.5, math.inf)],
        'two': [(50.0, 1e6), (99.5, math.nan)],
    }[fault]  # fmt: skip
    parts = good[:100], [*bad, *good[100:]]
    clean = grid_samples([samples('temperature_c', *good), wrenches(0.5)], name='a.csv')
    blocks = [samples('temperature_c', *part) for part in parts]
    gridded = grid_samples([*blocks, wrenches(0.5)], name='a.csv')
    np.testing.assert_array_equal(gridded.temperature_c, clean.temperature_c)
    words = {
        'nan': 'not finite', 'inf': 'not finite', 'kelvin': 'such as 295.1 °C',
        'two': 'are not finite and 1 of 202 samples have no stamp, or',
    }  # fmt: skip
    (warning,) = gridded.warnings
    assert warning.startswith(f'temperature_c of a.csv: 1 of {200 + len(bad)} samples ')
    assert words.get(fault, 'ran back') in warning


def test_axes_that_are_exactly_zero_beside_ones_that_live_are_absent():
    stamps = np.arange(5) * SECOND
    force = np.stack((np.full(5, -0.0), np.arange(5.0), np.zeros(5)), axis=1)
    temperature = samples('temperature_c', *((k, 20) for k in range(5)))
    recording = grid_samples([Samples(AXES[:3], stamps, force), temperature], name='a.csv')
    assert np.isnan(recording.wrench).all(axis=0).tolist() == [True, False, *[True] * 4]
    (warning,) = recording.warnings
    assert warning.startswith('force_x, force_z of a.csv: exactly 0 in every sample')
    still = grid_samples([Samples(AXES[:3], stamps, 0 * force), temperature])
    assert (still.wrench[:, :3] == 0).all(), 'of a sensor that is off, none is broken alone'


def test_a_broken_first_stamp_is_not_taken_for_a_late_thermometer():
    blocks = [samples('temperature_c', (10**6, 20), (10**6 + 1, 21)), wrenches(0, 10**6)]
    assert not grid_samples(blocks).warnings


POSES = np.repeat([[0, 0, 9.5], [9.5, 0, 0], [0, -9.5, 0]], 10, axis=0)


def test_speed_of_rotation_is_averaged_as_a_root_mean_square():
    stamps = np.arange(4) * SECOND // 2
    speed = Samples(('rotation_speed',), stamps, np.array([[3.0], [-4.0], [0.5], [0.5]]))
    temperature = samples('temperature_c', *((s, 20.0) for s in range(3)))
    recording = grid_samples([wrenches(0, 1, 2), temperature, speed])
    np.testing.assert_allclose(recording.rotation_speed, [math.sqrt(12.5), 0.5, np.nan])


@pytest.mark.parametrize(('force', 'seconds', 'doubt'), [
    (np.concatenate((POSES, [[30.0, 0, 0], [0, 0, 30.0]])), range(32), ''),
    (POSES, [*range(15), *range(16, 31)], ''), (POSES / 9.5, range(30), ''),
    (POSES[:, :2], range(30), 'Record all three of linear_acceleration'),
])  # fmt: skip
def test_specific_force_stays_as_measured_or_is_doubted_or_absent(force, seconds, doubt):
    block = Samples(FORCE_CHANNELS[: force.shape[1]], np.array(seconds) * SECOND, force)
    temperature = samples('temperature_c', *((s, 20.0) for s in range(32)))
    recording = grid_samples([wrenches(*range(32)), temperature, block])
    assert all(doubt in warning for warning in recording.warnings)
    assert len(recording.warnings) == bool(doubt)
    if doubt:
        assert recording.specific_force is None
        return
    np.testing.assert_array_equal(recording.specific_force[list(seconds)], force)
    assert np.isfinite(recording.specific_force).all(axis=1).sum() == len(force)
