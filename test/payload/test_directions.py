import numpy as np

from wrist_ft_comp.payload.accelerometer import fit_norm
from wrist_ft_comp.signals import GRAVITY

BIAS = np.array([0.1, -0.05, 0.08])


def test_bias_is_found_beside_samples_in_another_unit():
    rng = np.random.default_rng(0)
    felt = rng.standard_normal((2000, 3))
    force = GRAVITY * felt / np.linalg.norm(felt, axis=1, keepdims=True) + BIAS
    force[::10] *= 1000
    frame, drift, _ = fit_norm(force, np.zeros((len(force), 1)))
    np.testing.assert_allclose(frame.bias, BIAS, atol=0.02)
    np.testing.assert_allclose(frame.scale, 1.0, atol=0.01)
    np.testing.assert_allclose(drift, 0.0)


def test_nothing_felt_tells_nothing():
    for samples in (0, 5):
        frame, _, _ = fit_norm(np.zeros((samples, 3)), np.zeros((samples, 1)))
        np.testing.assert_allclose(frame.bias, 0.0)
