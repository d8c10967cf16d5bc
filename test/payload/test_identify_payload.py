"""A payload from a minute of motion: its cells, what is found, how well, and what is refused."""

from contextlib import suppress
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrist_ft_comp.channels import GRAVITY
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.payload.identify_payload import identify
from wrist_ft_comp.payload.motion_collector import CELL_S, DURATION_S, MotionCollector
from wrist_ft_comp.payload.weight import ForceFrame, Payload
from wrist_ft_comp.simulation import robot_at_work

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND + 1
RATE_HZ = 50
TOOL = Payload(1.5, np.array([0.01, -0.02, 0.06]))
CONSTANT = np.array([3.0, -4.0, 5.0, 0.1, -0.2, 0.3])
LEVEL = ForceFrame()
CROOKED = ForceFrame(Rotation.from_rotvec([0.1, -0.2, 1.0]).as_matrix())


def test_cells_are_means_over_a_quarter_of_a_second_and_begin_anew_with_the_stamps():
    collector = MotionCollector()
    for first in (START, START - 1000 * SECOND):
        for k in range(12):
            wrench, stamp = [float(k)] * 6, first + k * SECOND // 20
            assert not collector.add(stamp, wrench, (1.0, 2.0, k), 3.0 * (k % 5))
        speed = 3.0 * np.sqrt(30 / 5)
        expected = [[2.0] * 6 + [1.0, 2.0, 2.0, speed], [7.0] * 6 + [1.0, 2.0, 7.0, speed]]
        np.testing.assert_allclose(collector.cells, expected)
        assert collector.share == pytest.approx(0.5 / DURATION_S)
    last = first + round(DURATION_S * SECOND)
    assert collector.add(last, [0.0] * 6, (1.0, 2.0, 3.0), 0.0)


def collected(seed, contacts):
    """Let the simulated robot work for a minute in a world of its own; cells, and its tool."""
    rng = np.random.default_rng([2024, seed])
    work = robot_at_work.draw_work(robot_at_work.WorkSettings(part_kg=0.0, contacts=contacts), rng)
    time_s = rng.uniform(0, 500) + np.arange(0, DURATION_S + 2 / RATE_HZ, 1 / RATE_HZ)
    motion = robot_at_work.move(work, time_s)
    accelerometer = robot_at_work.draw_accelerometer(rng)
    imu = robot_at_work.read_imu(accelerometer, motion, np.zeros(len(time_s)), rng)
    noise = rng.normal(0, [0.1] * 3 + [0.005] * 3, (len(time_s), 6))
    wrench = motion.weight + motion.contact + noise + rng.normal(0, 5, 6) * np.repeat([1, 0.1], 3)
    collector = MotionCollector()
    for k, row in enumerate(wrench.tolist()):
        stamp = START + round(k * SECOND / RATE_HZ)
        if collector.add(stamp, row, imu[k, :3].tolist(), math.hypot(*imu[k, 3:])):
            break
    assert k == DURATION_S * RATE_HZ
    touched = np.abs(motion.contact).sum(axis=1) > 0
    return np.array(collector.cells), work.payloads[0], touched.mean()


def still(up, frame=CROOKED):
    """Cells at rest under directions (n, 3), without noise, as a crooked accelerometer sees."""
    force = GRAVITY * up / np.linalg.norm(up, axis=1, keepdims=True)
    measured = force @ frame.rotation * frame.scale + frame.bias
    return np.column_stack((TOOL.weight(force) + CONSTANT, measured, np.zeros(len(up))))


def tilted(angles):
    """Directions of up, tilted about x and y by degrees (n, 2)."""
    return Rotation.from_euler('xy', angles, degrees=True).apply([0, 0, 1], inverse=True)


def changed(cells, **parts):
    columns = {'wrench': slice(0, 6), 'force': slice(6, 9), 'speed': 9}
    cells = cells.copy()
    for name, values in parts.items():
        cells[:, columns[name]] = values
    return cells


EVERYWHERE = still(np.random.default_rng(3).normal(size=(100, 3)))


@pytest.mark.parametrize('contacts', [0.0, 0.15])
def test_a_minute_of_ordinary_motion_gives_mass_and_center(contacts):
    pressed = []
    for seed in range(4):
        cells, tool, share = collected(seed, contacts)
        payload, _ = identify(cells, CELL_S, None)
        assert payload.mass_kg == pytest.approx(tool.mass_kg, rel=0.03)
        assert np.linalg.norm(payload.center_m - tool.center_m) < 5e-3
        assert abs(payload.mass_kg - tool.mass_kg) < 2.5 * payload.mass_error_kg
        assert payload.mass_error_kg < 0.03 * tool.mass_kg
        assert (payload.center_error_m < 5e-3).all()
        pressed.append(share)
    assert np.mean(pressed) == pytest.approx(contacts, abs=0.1)


def test_without_noise_payload_and_turn_are_found_with_bias_and_scale_that_are_known():
    bias, scale = np.array([0.3, -0.2, 0.1]), np.array([1.1, 1.12, 1.08])
    biased = changed(EVERYWHERE, force=EVERYWHERE[:, 6:9] * scale + bias)
    payload, frame = identify(biased, CELL_S, ForceFrame(np.eye(3), bias, scale))
    assert payload.mass_kg == pytest.approx(1.5, rel=1e-5)
    np.testing.assert_allclose(payload.center_m, TOOL.center_m, atol=1e-6)
    np.testing.assert_array_equal(frame.bias, bias)
    np.testing.assert_array_equal(frame.scale, scale)
    np.testing.assert_allclose(frame.rotation, CROOKED.rotation, atol=1e-6)


TURNED = CELL_S * np.cumsum(np.repeat([0.4, 0.8], [60, 80]))
TURNING = still(np.column_stack((np.sin(TURNED), np.sin(3 * TURNED) / 9, np.cos(TURNED))))


@pytest.mark.parametrize(('cells', 'fast', 'speed'), [
    (EVERYWHERE, np.arange(100) < 55, 0.8 * (np.arange(100) < 55)),
    (TURNING, np.arange(140) >= 60, np.nan),
], ids=['a speed that was measured', 'one that nobody measured is that of gravity'])  # fmt: skip
def test_cells_that_turn_fast_are_left_out(cells, fast, speed):
    heavier = cells[:, :6] + fast[:, None] * (cells[:, :6] - CONSTANT)  # twice the weight
    for known, mass_kg in ((speed, 1.5), (0.0, 3.0)):
        payload, _ = identify(changed(cells, wrench=heavier, speed=known), CELL_S, LEVEL)
        assert payload.mass_kg == pytest.approx(mass_kg, rel=1e-5)


SHAKEN = np.random.default_rng(7).normal(size=(100, 3))
REST = still(np.tile([0.0, 0.0, 1.0], (100, 1)), frame=LEVEL)


@pytest.mark.parametrize('scale', [0.0, 1e-300, 1e4, 1e200, np.nan])
@pytest.mark.parametrize('part', [slice(0, 6), slice(6, 9), slice(0, 9)])
@pytest.mark.parametrize('cells', [REST, still(SHAKEN)], ids=['rest', 'motion'])
def test_whatever_comes_gives_a_payload_or_a_sentence(cells, part, scale):
    spoiled = cells.copy()
    with np.errstate(all='ignore'):
        spoiled[:, part] *= scale
    for sensor in (None, LEVEL):
        with suppress(CalibrationRefusedError):
            assert identify(spoiled, CELL_S, sensor)[0].mass_kg > 0


ANGLES = np.linspace(-30, 30, 60)
PUSHED = np.random.default_rng(5).normal(0, 20, (100, 6)) * (np.arange(100) < 70)[:, None]


@pytest.mark.parametrize(('cells', 'said'), [
    (still(tilted(np.column_stack((ANGLES / 4, 0 * ANGLES)))), '0.75, 0.03, 0.00 .* along x'),
    (still(tilted(np.column_stack((ANGLES, -ANGLES)))[:39]), 'or 10 s only .* least 10 s'),
    (changed(EVERYWHERE, force=EVERYWHERE[:, 6:9] / 9.807), 'or 0 s only .* 9.8 m/s²'),
    (changed(EVERYWHERE, wrench=EVERYWHERE[:, :6] + PUSHED), 'not follow|not that of a rigid'),
    (REST, r'gravity moved by 0\.00, 0\.00, 0\.00'),
    (changed(REST, wrench=0.0), r'gravity moved by 0\.00, 0\.00, 0\.00'),
    (changed(still(SHAKEN), wrench=EVERYWHERE[:, :6] / 1000), 'nothing weighs on the sensor'),
])  # fmt: skip
def test_what_shows_no_payload_is_refused_with_what_is_missing(cells, said):
    with pytest.raises(CalibrationRefusedError, match=said):
        identify(cells, CELL_S, None)


def test_an_accelerometer_that_changed_is_fitted_anew():
    louder = changed(EVERYWHERE, force=1.05 * EVERYWHERE[:, 6:9])
    payload, frame = identify(louder, CELL_S, LEVEL)
    assert payload.mass_kg == pytest.approx(1.5, rel=1e-3)
    np.testing.assert_allclose(frame.scale, 1.05, rtol=1e-3)
