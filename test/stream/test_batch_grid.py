"""Samples onto the thermal grid, as a batch."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from wrist_ft_comp.channels import AXES, FORCE_CHANNELS, temperature_channel
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recording import Samples
from wrist_ft_comp.stream.batch_grid import grid_samples

SECOND = 1_000_000_000
#: Stamps as they are since 1970, so that rounding to floats would show.
EPOCH = 1_767_225_600 * SECOND


def samples(channel, *pairs, origin=0):
    """One channel: pairs of second and value."""
    stamps = np.array([origin + round(s * SECOND) for s, _ in pairs], dtype=np.int64)
    values = np.array([value for _, value in pairs], dtype=float)[:, np.newaxis]
    return Samples((channel,), stamps, values)


def wrenches(*seconds, origin=0):
    return samples('force_z', *((s, 1.0) for s in seconds), origin=origin)


def textbook_cells(block, period_ns):
    """Means per cell, sample by sample."""
    cells: dict[int, list[float]] = {}
    for stamp, (value,) in zip(block.stamps_ns.tolist(), block.values.tolist(), strict=True):
        cells.setdefault(math.floor(stamp / period_ns), []).append(value)
    return {cell: sum(values) / len(values) for cell, values in cells.items()}


def textbook_reports(temperatures, first, patience):
    """Cells in which a thermometer reports; after an outage, once those are back that will be."""
    heard = sorted({cell for cells in temperatures for cell in cells if cell >= first})
    reported, begin = [], heard[0]
    for before, cell in zip([heard[0], *heard], heard):  # noqa: B905
        if cell - before > patience:
            back = [
                min((at for at in cells if at >= cell), default=cell) for cells in temperatures
            ]
            begin = max(at for at in back if at <= cell + patience)
        if cell >= begin:
            reported.append(cell)
    return reported


@st.composite
def streams(draw):
    """One to three thermometers and a wrench, irregular, with gaps."""
    blocks = []
    for channel in [*map(temperature_channel, range(draw(st.integers(1, 3)))), 'torque_y']:
        steps = draw(
            st.lists(
                st.one_of(st.integers(1, SECOND), st.integers(SECOND, 9 * SECOND)),
                min_size=1,
                max_size=25,
            )
        )
        stamps = np.cumsum(steps) + draw(st.integers(0, 5)) * SECOND
        values = draw(st.lists(st.floats(20, 22), min_size=len(steps), max_size=len(steps)))
        blocks.append(Samples((channel,), stamps, np.array(values)[:, np.newaxis]))
    return blocks


@settings(deadline=None, max_examples=150, derandomize=True)
@given(blocks=streams(), period_s=st.sampled_from([0.5, 1.0, 3.0]), size=st.integers(1, 30))
def test_the_grid_is_the_textbook_loop_in_pieces_of_any_size(blocks, period_s, size):
    pieces = [
        Samples(block.channels, block.stamps_ns[at : at + size], block.values[at : at + size])
        for block in blocks
        for at in range(0, len(block.stamps_ns), size)
    ]
    recording = grid_samples(pieces, period_s=period_s)
    period_ns = round(period_s * SECOND)
    *temperatures, torque = (textbook_cells(block, period_ns) for block in blocks)
    first = max(min(cells) for cells in temperatures)
    last = max(max(cells) for cells in (*temperatures, torque))
    assert recording.first_cell == first
    assert len(recording) == last - first + 1
    reported = textbook_reports(temperatures, first, max(1, math.ceil(5.0 / period_s)))
    for j, cells in enumerate(temperatures):
        for row, cell in enumerate(range(first, last + 1)):
            before = max(at for at in reported if at <= cell)
            after = min((at for at in reported if at >= cell), default=before)
            held = [cells[max(at for at in cells if at <= end)] for end in (before, after)]
            line = held[0] + (cell - before) / max(after - before, 1) * (held[1] - held[0])
            assert recording.temperature_c[row, j] == pytest.approx(line, abs=1e-10)
            assert recording.measured[row, j] == (cell in cells)
    for row, cell in enumerate(range(first, last + 1)):
        expected = torque.get(cell, math.nan)
        gridded = recording.wrench[row, AXES.index('torque_y')]
        assert gridded == pytest.approx(expected, abs=1e-10, nan_ok=True)
    assert np.isnan(np.delete(recording.wrench, AXES.index('torque_y'), axis=1)).all()
    assert np.isnan(recording.reference).all()
    assert (recording.specific_force, recording.rotation_speed) == (None, None)
    assert recording.warnings == ()


@pytest.mark.parametrize('fault', ['repeated', 'backward', 'ahead', 'nan', 'infinite', 'kelvin'])
def test_unusable_samples_are_dropped_and_counted(fault):
    good = [(float(k), 20.0 + k / 10) for k in range(200)]
    bad = {
        'repeated': (99.0, 1e6),
        'backward': (50.0, 1e6),
        'ahead': (9000.0, 1e6),
        'kelvin': (99.5, 295.15),
        'nan': (99.5, math.nan),
        'infinite': (99.5, math.inf),
    }[fault]
    with_fault = [*good[:100], bad, *good[100:]]
    clean = grid_samples([samples('temperature_c', *good), wrenches(0.5)], name='a.csv')
    gridded = grid_samples([samples('temperature_c', *with_fault), wrenches(0.5)], name='a.csv')
    np.testing.assert_array_equal(gridded.temperature_c, clean.temperature_c)
    words = {'nan': 'not finite', 'infinite': 'not finite', 'kelvin': 'such as 295.1 °C'}
    (warning,) = gridded.warnings
    assert warning.startswith('temperature_c of a.csv: 1 of 201 samples ')
    assert words.get(fault, 'does not increase') in warning


def test_a_backward_stamp_is_seen_across_blocks():
    blocks = [
        samples('temperature_c', (0, 20), (1, 21), (1.5, math.nan), (2, 22)),
        samples('temperature_c', (1, 1e6), (2, 1e6), (2.5, math.nan), (3, 23)),
        wrenches(0),
    ]
    recording = grid_samples(blocks, max_bad_share=0.5)
    np.testing.assert_array_equal(recording.temperature_c[:, 0], [20, 21, 22, 23])
    assert '2 of 8 samples are not finite and 2 have a stamp that' in recording.warnings[0]


@pytest.mark.parametrize(('bad', 'refused'), [(2, False), (3, True)])
def test_too_large_a_share_of_unusable_samples_is_refused(bad, refused):
    values = [20.0] * 200
    for k in range(bad):
        values[10 * k + 5] = math.nan
    blocks = [samples('temperature_c', *enumerate(values)), wrenches(0)]
    if not refused:
        assert len(grid_samples(blocks).warnings) == 1
        return
    with pytest.raises(RecordingError, match=r'temperature_c of a.csv: 3 of 200 .* at most 1.0%'):
        grid_samples(blocks, name='a.csv')


def test_axes_that_are_exactly_zero_beside_ones_that_live_are_absent():
    """As those of a sensor of three forces whose driver fills in zeros, or of a broken one."""
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


@pytest.mark.parametrize(
    ('force', 'seconds', 'doubt'),
    [
        (np.concatenate((POSES, [[30.0, 0, 0], [0, 0, 30.0]])), range(32), ''),
        (POSES, [*range(15), *range(16, 31)], ''),
        (POSES / 9.5, range(30), ''),
        (POSES * 0.001, range(30), 'does not feel gravity, and counts as absent'),
        (POSES[:, :2], range(30), 'Record all three of linear_acceleration'),
    ],
    ids=['moving', 'one missing', 'in g', 'without gravity', 'two of three'],
)
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
