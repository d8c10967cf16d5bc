import numpy as np

from wrist_ft_comp.simulation.robot_at_work import draw_work, lever, move, WorkSettings


def test_speeds_and_specific_force_are_those_of_the_path():
    work, step = draw_work(WorkSettings(), np.random.default_rng(5)), 1e-3
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
