"""ARX-PLS as the paper identifies it: eq. 3 to 22 written out."""

import numpy as np
import pytest
from scipy import signal

from wrist_ft_comp.fit.arx_pls import fit_arx_pls
from wrist_ft_comp.fit.pls import scale_block
from wrist_ft_comp.fit.settings import Orders


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
        rows = range(longest, len(t))
        past = [[u[k - i] for i in range(1, of_latent.n + 1)] for k in rows]
        late = [[t[k - first - i] for i in range(of_latent.m)] for k in rows]
        phi = np.hstack((past, late))  # eq. 20
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


@pytest.mark.parametrize('orders', [
    (Orders(2, 2, 1), Orders(1, 2, 0, direct=True)),
    (Orders(0, 1, 0, direct=True), Orders(1, 3, 2)), (Orders(3, 2, 0),),
])  # fmt: skip
def test_the_model_is_that_of_the_textbook(orders):
    rng = np.random.default_rng(4)
    x = np.cumsum(rng.standard_normal((500, 3)), axis=0) @ rng.standard_normal((3, 3)) + 25.0
    late = signal.lfilter([0.05], [1.0, -0.95], x - x[0], axis=0)
    y = late @ rng.standard_normal((3, 2)) + 0.3 * rng.standard_normal((500, 2))
    model, notes = fit_arx_pls(scale_block([x], [y]), orders)
    j, expected = textbook(x, y, orders)
    _, run = model.run(model.start(x[0]), x)
    run, expected = run - run.mean(axis=0), expected - expected.mean(axis=0)
    size = np.abs(expected).max()
    assert size > 1
    np.testing.assert_allclose(run, expected, rtol=0, atol=1e-10 * size)
    for r, note in enumerate(notes, 1):
        assert note == f'latent {r}: {orders[r - 1]}; J_{r} = {j[r - 1]:.4g} (eq. 19)'
