import numpy as np
from scipy.spatial.transform import Rotation

from wrist_ft_comp.channels import GRAVITY
from wrist_ft_comp.simulation.work import (
    Accelerometer,
    draw_work,
    lever,
    move,
    read_imu,
    WorkSettings,
)


def program(**chosen):
    return draw_work(WorkSettings(**chosen), *map(np.random.default_rng, (5, 6)))


def a_cycle(work, count=40_000):
    return (np.arange(count) + 0.5) / count * work.begins_s[-1]


def test_speeds_and_specific_force_are_those_of_the_path():
    """Differences of the pose, and of a point's path, twice, in the world's frame."""
    work, step = program(), 1e-3
    times = np.random.default_rng(0).uniform(0, work.begins_s[-1], 500)
    before, now, after = (move(work, times + k * step) for k in (-1, 0, 1))
    turned = (before.pose.inv() * after.pose).as_rotvec() / (2 * step)
    np.testing.assert_allclose(turned, now.omega, atol=2e-3)
    np.testing.assert_allclose((after.omega - before.omega) / (2 * step), now.alpha, atol=2e-2)
    at_m = np.array([0.1, -0.2, 0.3])
    path = [motion.pose.apply(at_m) for motion in (before, now, after)]
    swung = (path[0] - 2 * path[1] + path[2]) / step**2
    felt = now.pose.inv().apply(swung)
    np.testing.assert_allclose(felt, lever(now.omega, now.alpha, at_m), atol=2e-2)


def test_at_rest_the_imu_measures_gravity_and_the_payload_weighs_its_mass():
    work = program(contacts=0.0, tool_kg=1.5, part_kg=0.7)
    motion = move(work, a_cycle(work))
    rest = np.linalg.norm(motion.omega, axis=1) == 0
    assert 0.4 < rest.mean() < 0.9
    np.testing.assert_allclose(np.linalg.norm(motion.force[rest], axis=1), GRAVITY, rtol=1e-9)
    weighed = np.linalg.norm(motion.weight[rest, :3], axis=1) / GRAVITY
    assert sorted(set(weighed.round(9))) == [1.5, 2.2]
    assert not motion.contact.any()


def test_speed_contacts_and_reach_are_about_their_settings():
    work = program(contacts=0.3, speed_rad_s=0.8)
    motion = move(work, a_cycle(work))
    assert np.linalg.norm(motion.omega, axis=1).max() <= 0.8
    touched = np.abs(motion.contact).sum(axis=1) > 0
    assert 0.2 < touched.mean() < 0.4
    assert not (touched & (np.linalg.norm(motion.omega, axis=1) > 0)).any()
    again = move(work, a_cycle(work) + work.begins_s[-1])
    np.testing.assert_allclose(again.weight, motion.weight, atol=1e-6)


def test_the_accelerometer_is_crooked_biased_scaled_and_drifts():
    work = program()
    motion = move(work, np.arange(0.0, 100.0))
    turned = Rotation.from_rotvec([0.0, 0.0, np.pi / 2])
    imu = Accelerometer(
        turned,
        np.array([0.1, 0, 0]),
        np.array([1.0, 1.1, 1.0]),
        np.array([0, 0, 0.01]),
        (0.0, 0.0),
    )
    still = motion._replace(omega=0 * motion.omega, alpha=0 * motion.alpha)
    read = read_imu(imu, still, np.full(100, 20.0), np.random.default_rng(0))
    x, y, z = motion.force.T
    np.testing.assert_allclose(read[:, :3], np.column_stack((y + 0.1, -1.1 * x, z + 0.2)))
