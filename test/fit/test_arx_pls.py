"""ARX-PLS as the paper identifies it: eq. 15 to 22 written out, and a known system recovered."""

import numpy as np
import pytest
from scipy import signal

from wrist_ft_comp.drift.arx import Arx
from wrist_ft_comp.fit.arx_pls import fit_arx_pls, regressors
from wrist_ft_comp.fit.pls import XyBlock
from wrist_ft_comp.fit.settings import Orders

CELLS = 960
#: Of two latents: different delays and orders, and a direct term, as the paper's H(z) have them.
ORDERS = Orders(2, 2, 1), Orders(1, 2, 0, direct=True)
H = (
    Arx(np.array([-1.2, 0.36]), np.array([0.1, 0.06]), 2),
    Arx(np.array([-0.8]), np.array([0.5, -0.2])),
)
#: Pᵀ and Qᵀ: by 45°, so that all inputs are scaled alike, and all outputs.
TURN = np.array([[1.0, 1.0], [-1.0, 1.0]]) / np.sqrt(2.0)


def two_latents(noise=0.0, seed=0):
    """
    Scores t, outputs u of the latents, and X = T Pᵀ, Y = H_1(t_1) q_1ᵀ + H_2(t_2) q_2ᵀ.

    Scores are sums of harmonics, other ones for each latent, over a whole period and in steady
    state: so they stay orthogonal behind any filter. Noise enters in the equation of u.
    """
    rng = np.random.default_rng(seed)
    k = np.arange(3 * CELLS)
    t = np.zeros((3 * CELLS, 2))
    for latent, harmonics in enumerate((range(2, 80, 4), range(4, 80, 4))):
        for harmonic in harmonics:
            t[:, latent] += np.cos(2 * np.pi * harmonic * k / CELLS + rng.uniform(0, 2 * np.pi))
    t[:, 0] *= 4.0
    u = np.empty_like(t)
    for r, arx in enumerate(H):
        above, below = arx.polynomials(arx.longest_lag)
        disturbance = signal.lfilter([1.0], below, noise * rng.standard_normal(len(t)))
        u[:, r] = signal.lfilter(above, below, t[:, r]) + disturbance
    t, u = t[2 * CELLS :], u[2 * CELLS :]
    return t, u, t @ TURN, u @ TURN


def textbook(x, y, orders):
    """J_r and the free run of Σ H_r(t_r) q_rᵀ: eq. 3 to 10, and eq. 20 to 22 for every latent."""
    e = (x - x.mean(axis=0)) / x.std(axis=0)
    f = (y - y.mean(axis=0)) / y.std(axis=0)
    j, run = [], np.zeros_like(f)
    for of_latent in orders:
        w, q = (side[0] if i else side[:, 0] for i, side in enumerate(np.linalg.svd(e.T @ f)[::2]))
        t = e @ w
        p = e.T @ t / (t @ t)
        u = f @ q
        b = u @ t / (t @ t)  # eq. 9
        first = of_latent.d + (0 if of_latent.direct else 1)
        longest = max(of_latent.n, first + of_latent.m - 1)
        phi = np.array(
            [
                [u[k - i] for i in range(1, of_latent.n + 1)]
                + [t[k - first - i] for i in range(of_latent.m)]
                for k in range(longest, len(t))
            ]
        )  # eq. 20
        phi, target = phi - phi.mean(axis=0), u[longest:] - u[longest:].mean()
        theta = np.linalg.inv(phi.T @ phi) @ phi.T @ target  # eq. 22
        j.append(0.5 * np.sum((target - phi @ theta) ** 2))  # eq. 21
        a, gains = -theta[: of_latent.n], theta[of_latent.n :]
        rest = t[0] * gains.sum() / (1 + a.sum())
        free = np.zeros(len(t))
        for k in range(len(t)):
            past = [free[k - i] if k >= i else rest for i in range(1, of_latent.n + 1)]
            late = [t[max(k - first - i, 0)] for i in range(of_latent.m)]
            free[k] = gains @ late - a @ np.array(past)
        run += np.outer(free, q)  # eq. 15
        e = e - np.outer(t, p)  # eq. 3
        f = f - b * np.outer(t, q)  # eq. 5 with eq. 10
    return j, run * y.std(axis=0)


@pytest.mark.parametrize(
    'orders',
    [ORDERS, ORDERS[::-1], (Orders(0, 1, 0, direct=True), Orders(1, 3, 2)), (Orders(3, 2, 0),)],
)
def test_the_model_is_that_of_the_textbook(orders):
    rng = np.random.default_rng(4)
    x = np.cumsum(rng.standard_normal((500, 3)), axis=0) @ rng.standard_normal((3, 3)) + 25.0
    late = signal.lfilter([0.05], [1.0, -0.95], x - x[0], axis=0)
    y = late @ rng.standard_normal((3, 2)) + 0.3 * rng.standard_normal((500, 2))
    model, notes = fit_arx_pls(XyBlock((x,), (y,)), orders)
    j, expected = textbook(x, y, orders)
    _, run = model.run(model.start(x[0]), x)
    run, expected = run - run.mean(axis=0), expected - expected.mean(axis=0)
    size = np.abs(expected).max()
    assert size > 1
    np.testing.assert_allclose(run, expected, rtol=0, atol=1e-10 * size)
    for r, note in enumerate(notes, 1):
        assert note == f'latent {r}: {orders[r - 1]}; J_{r} = {j[r - 1]:.4g} (eq. 19)'


def z_scores(noise, seed=0):
    """Errors of all coefficients by their standard errors, and without noise the errors."""
    t, u, x, y = two_latents(noise, seed)
    block = XyBlock((x,), (y,))
    model, _ = fit_arx_pls(block, ORDERS)
    scores = []
    for r, (latent, truth, orders) in enumerate(zip(model.latents, H, ORDERS, strict=True)):
        # In which sign and unit PLS has t_r and u_r.
        found_t, found_u = block.x @ model.rotations[:, r], block.y @ model.output_loadings[:, r]
        unit_t, unit_u = (
            (found @ true) / (true @ true)
            for found, true in ((found_t, t[:, r]), (found_u, u[:, r]))
        )
        errors = np.concatenate((latent.a - truth.a, latent.b * unit_t / unit_u - truth.b))
        phi, _ = regressors(t[:, r], u[:, r], orders)
        standard = (noise or 1.0) * np.sqrt(np.diagonal(np.linalg.inv(phi.T @ phi)))
        scores.append(errors / standard)
        assert latent.first_lag == truth.first_lag
    return np.concatenate(scores)


def test_a_known_system_is_recovered_exactly_without_noise():
    np.testing.assert_allclose(z_scores(noise=0.0), 0, atol=1e-9)


def test_a_known_system_is_recovered_within_its_standard_errors():
    scores = [z_scores(0.05, seed) for seed in range(40)]
    spread = np.sqrt(np.mean(np.square(scores), axis=0))
    assert spread.min() > 0.6, spread
    assert spread.max() < 1.5, spread
