"""Filtered PLS: eq. 11 to 14 written out, PLS as its special case, filters that are found."""

import numpy as np
import pytest
from scipy import linalg, signal

from wrist_ft_comp.drift.arx_pls import relaxation
from wrist_ft_comp.fit.pls import fit_filtered_pls, scale_block

CELLS, PERIOD_S = 400, 10.0


def drawn_block(outputs):
    """Two recordings: correlated inputs wander, outputs follow them late and with noise."""
    rng = np.random.default_rng(0)
    x, y = [], []
    for _ in range(2):
        steps = rng.standard_normal((CELLS, 4)) @ rng.standard_normal((4, 4))
        x.append(np.cumsum(steps, axis=0) + 30.0)
        late = relax(x[-1], 200.0) @ rng.standard_normal((4, outputs))
        y.append(late + rng.standard_normal((CELLS, outputs)) + 50.0 * rng.standard_normal())
    return x, y


def relax(series, time_constant_s):
    """A relaxation from the rest of the first sample, by scipy."""
    pole = np.exp(-PERIOD_S / time_constant_s) if time_constant_s else 0.0
    start = pole * series[:1]
    return signal.lfilter([1 - pole], [1, -pole], series, axis=0, zi=start)[0]


def centred(parts):
    return np.concatenate([part - part.mean(axis=0) for part in parts])


def textbook(block, time_constants_s):
    """Eq. 11 to 14 as they are read, step by step; returns the sum of all b_r t_r q_rᵀ."""
    x, y = np.concatenate(block[0]), centred(block[1])
    e = [(part - x.mean(axis=0)) / x.std(axis=0) for part in block[0]]
    f = y / y.std(axis=0)
    explained = np.zeros_like(f)
    for tau_s in time_constants_s:
        filtered = [relax(part, tau_s) for part in e]  # eq. 11: Ẽ = H(E)
        h = centred(filtered)
        w = linalg.eigh(h.T @ f @ f.T @ h)[1][:, -1]  # eq. 12
        t = h @ w
        p = h.T @ t / (t @ t)
        q = f.T @ t / np.linalg.norm(f.T @ t)
        b = (f @ q) @ t / (t @ t)  # eq. 9
        explained += b * np.outer(t, q)
        f = f - b * np.outer(t, q)
        e = [part - np.outer(part @ w, p) for part in e]
        after = centred([relax(part, tau_s) for part in e])
        np.testing.assert_allclose(after, h - np.outer(t, p), atol=1e-9)  # the filtered block
        np.testing.assert_allclose(t @ after, 0, atol=1e-7)
    return explained * y.std(axis=0)


@pytest.mark.parametrize('constants', [(300.0,), (0.0, 200.0), (1000.0, 0.0, 50.0, 200.0)])
@pytest.mark.parametrize('outputs', [1, 2])
def test_the_model_is_that_of_the_textbook(constants, outputs):
    block = drawn_block(outputs)
    model, notes = fit_filtered_pls(scale_block(*block), constants, PERIOD_S)
    expected = textbook(block, constants)
    size = np.abs(expected).max()
    assert size > 1.0
    explained = centred([model.run(model.start(part[0]), part)[1] for part in block[0]])
    np.testing.assert_allclose(explained, expected, rtol=0, atol=1e-10 * size)
    assert len(notes) == np.count_nonzero(constants)
    for latent, tau_s in zip(model.latents, constants, strict=True):
        poles = relaxation(tau_s, PERIOD_S).poles
        np.testing.assert_array_equal(latent.poles, poles, 'h_r is of its own latent only')
