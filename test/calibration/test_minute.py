"""A payload from a minute of motion: what is found, how well, and which motion is refused."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.model.payload.weight import ForceFrame, Payload
from wrist_ft_comp.model.signals import GRAVITY
from wrist_ft_comp.simulation.work import (
    draw_accelerometer,
    draw_work,
    move,
    read_imu,
    WorkSettings,
)
from wrist_ft_comp.stream.payload_motion import (
    CELL_S,
    DURATION_S,
    identify,
    MotionCells,
    MotionCollector,
)

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND + 1
RATE_HZ = 50
TOOL = Payload(1.5, np.array([0.01, -0.02, 0.06]))
CONSTANT = np.array([3.0, -4.0, 5.0, 0.1, -0.2, 0.3])
CROOKED = ForceFrame(Rotation.from_rotvec([0.1, -0.2, 1.0]).as_matrix())


def collected(seed, contacts):
    """Let the simulated robot work for a minute in a world of its own; cells, and its tool."""
    rng = np.random.default_rng([2024, seed])
    work = draw_work(WorkSettings(part_kg=0.0, contacts=contacts), rng)
    time_s = rng.uniform(0, 500) + np.arange(0, DURATION_S + 2 / RATE_HZ, 1 / RATE_HZ)
    motion = move(work, time_s)
    imu = read_imu(draw_accelerometer(rng), motion, np.zeros(len(time_s)), rng)
    noise = rng.normal(0, [0.1] * 3 + [0.005] * 3, (len(time_s), 6))
    wrench = motion.weight + motion.contact + noise + rng.normal(0, 5, 6) * np.repeat([1, 0.1], 3)
    collector = MotionCollector()
    for k, row in enumerate(wrench.tolist()):
        stamp = START + round(k * SECOND / RATE_HZ)
        if collector.add(stamp, row, imu[k, :3].tolist(), math.hypot(*imu[k, 3:])):
            break
    assert k == DURATION_S * RATE_HZ
    return collector.cells(), work.payloads[0], (np.abs(motion.contact).sum(axis=1) > 0).mean()


def still(up, payload=TOOL, frame=CROOKED, sign=1.0):
    """Cells at rest under directions (n, 3), without noise, as a crooked accelerometer sees."""
    force = GRAVITY * up / np.linalg.norm(up, axis=1, keepdims=True)
    measured = sign * force @ frame.rotation * frame.scale + frame.bias
    return MotionCells(payload.weight(force) + CONSTANT, measured, np.zeros(len(up)))


def tilted(angles):
    """Directions of up, tilted about x and y by degrees (n, 2)."""
    return Rotation.from_euler('xy', angles, degrees=True).apply([0, 0, 1], inverse=True)


@pytest.fixture
def everywhere():
    return still(np.random.default_rng(3).normal(size=(100, 3)))


@pytest.mark.parametrize('contacts', [0.0, 0.15])
def test_a_minute_of_ordinary_motion_tells_mass_and_center(contacts):
    """Within 3 % and 5 mm; stated errors cover two standard errors and a half."""
    pressed = []
    for seed in range(6):
        cells, tool, share = collected(seed, contacts)
        found = identify(cells, None)
        payload = found.payload
        assert payload.mass_kg == pytest.approx(tool.mass_kg, rel=0.03)
        assert np.linalg.norm(payload.center_m - tool.center_m) < 5e-3
        assert abs(payload.mass_kg - tool.mass_kg) < 2.5 * payload.mass_error_kg
        assert payload.mass_error_kg < 0.03 * tool.mass_kg
        assert (payload.center_error_m < 5e-3).all()
        pressed.append(share)
        assert found.contact == pytest.approx(share, abs=0.25)
    assert np.mean(pressed) == pytest.approx(contacts, abs=0.1)


def test_without_noise_the_payload_and_the_turn_are_found(everywhere):
    found = identify(everywhere, ForceFrame())
    assert found.payload.mass_kg == pytest.approx(1.5, rel=1e-6)
    np.testing.assert_allclose(found.payload.center_m, TOOL.center_m, atol=1e-7)
    np.testing.assert_allclose(found.frame.rotation, CROOKED.rotation, atol=1e-6)
    assert (found.contact, found.fast) == (0.0, 0.0)


def test_bias_and_scale_that_a_calibration_has_found_are_kept(everywhere):
    bias, scale = np.array([0.3, -0.2, 0.1]), np.array([1.1, 1.12, 1.08])
    biased = everywhere._replace(force=everywhere.force * scale + bias)
    found = identify(biased, ForceFrame(np.eye(3), bias, scale))
    assert found.payload.mass_kg == pytest.approx(1.5, rel=1e-6)
    np.testing.assert_array_equal(found.frame.bias, bias)
    np.testing.assert_array_equal(found.frame.scale, scale)
    np.testing.assert_allclose(found.frame.rotation, CROOKED.rotation, atol=1e-6)


def test_cells_that_turn_fast_are_left_out(everywhere):
    fast = np.arange(100) < 30
    wrench = np.where(fast[:, None], 100.0, everywhere.wrench)
    found = identify(everywhere._replace(wrench=wrench, speed=0.6 * fast), ForceFrame())
    assert found.payload.mass_kg == pytest.approx(1.5, rel=1e-6)
    assert found.fast == pytest.approx(0.3)


def test_a_speed_that_nobody_measured_is_that_of_gravity():
    turned = CELL_S * np.cumsum(np.repeat([0.4, 0.8], [60, 30]))
    cells = still(np.column_stack((np.sin(turned), np.sin(3 * turned) / 9, np.cos(turned))))
    assert identify(cells, LEVEL).fast == 0.0
    assert identify(cells._replace(speed=np.full(90, np.nan)), LEVEL).fast == 31 / 90


def test_cells_are_means_over_a_quarter_of_a_second_of_stamps():
    collector = MotionCollector()
    assert collector.share == 0.0
    for k in range(12):
        wrench = [float(k)] * 6
        assert not collector.add(START + k * SECOND // 20, wrench, (1.0, 2.0, k), 3.0 * (k % 5))
    cells = collector.cells()
    np.testing.assert_allclose(cells.wrench, np.tile([[2.0], [7.0]], (1, 6)))
    np.testing.assert_allclose(cells.force, [[1.0, 2.0, 2.0], [1.0, 2.0, 7.0]])
    np.testing.assert_allclose(cells.speed, 3.0 * np.sqrt(30 / 5))
    assert collector.share == pytest.approx(0.5 / DURATION_S)
    assert collector.add(START + round(DURATION_S * SECOND), [0.0] * 6, (1.0, 2.0, 3.0), 0.0)


def test_a_time_that_begins_anew_is_a_minute_that_begins_anew():
    collector = MotionCollector()
    for first in (START, START - 1000 * SECOND):
        for k in range(3):
            assert not collector.add(first + k * SECOND // 4, [float(k)] * 6, (1.0, 2.0, 3.0), 0.0)
        assert collector.cells().wrench[:, 0].tolist() == [0.0, 1.0]
        assert collector.share == pytest.approx(0.5 / DURATION_S)


ANGLES = np.linspace(-30, 30, 60)
LEVEL = ForceFrame()


@pytest.mark.parametrize(
    ('cells', 'sentence'),
    [
        (still(np.tile([0.0, 0.0, 1.0], (60, 1))), 'gravity moved by 0.00, 0.00, 0.00 .* tilt'),
        (
            still(tilted(np.column_stack((ANGLES / 4, 0 * ANGLES)))),
            'gravity moved by 0.75, 0.03, 0.00 .* for it to move along x, too',
        ),
        (
            still(tilted(np.column_stack((0 * ANGLES, ANGLES / 4))), frame=LEVEL),
            'gravity moved by 0.75, 0.03, 0.00 .* for it to move along y, too',
        ),
        (
            still(tilted(np.column_stack((ANGLES, ANGLES[::-1])))[:39]),
            'slower than 0.5 rad/s for 10 s only; at least 10 s',
        ),
        (
            still(np.random.default_rng(3).normal(size=(99, 3)), Payload(0.001, np.zeros(3))),
            'nothing weighs on the sensor',
        ),
        (still(np.random.default_rng(3).normal(size=(99, 3)), sign=-1.0), 'is mirrored'),
    ],
)
def test_motion_that_does_not_tell_is_refused_with_what_is_missing(cells, sentence):
    with pytest.raises(CalibrationRefusedError, match=sentence):
        identify(cells, ForceFrame())


def test_more_contact_than_motion_is_refused(everywhere):
    pushed = np.random.default_rng(5).normal(0, 20, (100, 6)) * (np.arange(100) < 70)[:, None]
    with pytest.raises(CalibrationRefusedError, match=r'the wrench did not follow|no rigid body'):
        identify(everywhere._replace(wrench=everywhere.wrench + pushed), ForceFrame())
