"""Outer and inner model together, and the model that the paper publishes."""

from dataclasses import replace
import platform

import numpy as np
import pytest
from scipy import signal

from wrist_ft_comp.drift.arx_filter import Arx, free_run, relaxation, static_gain
from wrist_ft_comp.drift.arx_pls import ArxPls, from_gains
from wrist_ft_comp.errors import ModelFileError

# The paper's section 4.2.
PAPER_P = np.array(
    [
        [-0.0311, -0.2423, 0.9985, -0.1724],
        [-0.1953, 0.5380, 0.0277, -0.8360],
        [0.9545, 0.1054, 0.0463, -0.0732],
        [0.2231, -0.8004, -0.0025, -0.5157],
    ]
)
PAPER_Q = np.array([[0.5941, 0.9614, 0.5974, 0.9452], [0.8044, -0.2750, -0.8019, 0.3265]])
PAPER_W_X = np.array([0.2868, 0.2710, 0.2446, 0.2936])
PAPER_W_Y = np.array([0.2572, 0.2694])
#: Numerator in z, denominator in z, and whether z^-1 follows.
PAPER_H = [
    ([0.0651, -0.0688], [1.0, -1.1980, 0.3112], True),
    ([0.0024, 0.0489], [1.0, -1.4087, 0.4835], True),
    ([0.0100, 0.0131], [1.0, -1.2449, 0.4061], False),
    ([0.0015, 0.0148], [1.0, -1.2194, 0.3806], True),
]


@pytest.fixture(scope='module')
def paper():
    # (b0 z + b1) / (z² + a1 z + a2) is b0 z^-1 + b1 z^-2 over …; a factor z^-1 delays by one more.
    latents = [
        Arx(np.array(below[1:]), np.array(above), first_lag=2 if delayed else 1)
        for above, below, delayed in PAPER_H
    ]
    # Without W: with as many latents as inputs, X = T Pᵀ alone determines the scores, T = X P⁻ᵀ.
    return ArxPls(
        input_mean=np.zeros(4),
        input_weight=PAPER_W_X,
        rotations=np.linalg.inv(PAPER_P).T,
        latents=tuple(latents),
        output_loadings=PAPER_Q,
        output_weight=PAPER_W_Y,
        output_mean=np.zeros(2),
    )


@pytest.fixture(scope='module')
def general():
    """Three inputs, four latents of different orders, two outputs, and means."""
    rng = np.random.default_rng(2)
    return ArxPls(
        input_mean=rng.standard_normal(3),
        input_weight=rng.uniform(0.5, 2, 3),
        rotations=rng.standard_normal((3, 4)),
        latents=(
            relaxation(30.0, 1.0),
            static_gain(0.5),
            Arx(np.array([-1.2, 0.5]), np.array([0.1, 0.2]), first_lag=1),
            Arx(np.zeros(0), np.array([0.3, 0.2, 0.1]), first_lag=2),
        ),
        output_loadings=rng.standard_normal((2, 4)),
        output_weight=np.array([0.5, 3.0]),
        output_mean=np.array([10.0, -1.0]),
    )


def test_the_papers_model_runs_as_scipy_assembles_it(paper):
    x = np.random.default_rng(0).standard_normal((200, 4))
    x[0] = 0.0
    _, y = paper.run(paper.start(x[0]), x)
    scores = np.linalg.solve(PAPER_P, (x * PAPER_W_X).T).T  # X W_x = T Pᵀ
    expected = np.zeros((200, 2))
    for r, (above, below, delayed) in enumerate(PAPER_H):
        transfer = signal.dlti(above, [*below, 0.0] if delayed else below, dt=1.0)
        _, u = signal.dlsim(transfer, scores[:, r])
        expected += u * PAPER_Q[:, r]
    np.testing.assert_allclose(y, expected / PAPER_W_Y, rtol=0, atol=1e-12)
    assert np.abs(y).max() > 0.1


def single(latent):
    """One latent, and nothing around it."""
    one = np.ones(1)
    return ArxPls(0 * one, one, np.eye(1), (latent,), np.eye(1), one, 0 * one)


@pytest.mark.parametrize('order', [1, 2, 3])
@pytest.mark.parametrize('inputs', [2, 4])
def test_a_run_filters_as_scipy_does_to_the_last_digit(order, inputs):
    """On machines whose compiler fuses multiply and add, scipy's own last digit differs."""
    rng = np.random.default_rng(order)
    latent = Arx(np.poly(rng.uniform(0.9, 0.999, order))[1:], rng.standard_normal(inputs))
    model = single(latent)
    t, state = rng.standard_normal((500, 1)), rng.standard_normal(model.state_shape)
    after, y = model.run(state, t)
    expected, end = signal.lfilter(*latent.polynomials(latent.longest_lag), t[:, 0], zi=state[0])
    exact = platform.machine() == 'x86_64'
    np.testing.assert_allclose(y[:, 0], expected, rtol=0 if exact else 1e-12)
    np.testing.assert_allclose(after[0], end, rtol=0 if exact else 1e-12)
    np.testing.assert_array_equal(model.run(state, t[:0])[0], state)


@pytest.mark.parametrize('pole', [-0.7, 0.0, 1e-9, 0.5, np.exp(-1 / 30), np.exp(-1 / 3000)])
@pytest.mark.parametrize('cells', [1, 31, 32, 33, 1024, 1025, 5000])
def test_a_relaxation_runs_as_the_plain_recursion(pole, cells):
    t = 1.0 + np.random.default_rng(cells).standard_normal(cells)
    u, last = np.empty(cells), -3.0
    for k in range(cells):
        u[k] = last = 0.3 * t[k] + pole * last
    after, y = single(Arx(np.array([-pole]), np.array([0.3]))).run(
        np.array([[pole * -3.0]]), t[:, np.newaxis]
    )
    size = np.abs(u).max()
    np.testing.assert_allclose(y[:, 0], u, rtol=1e-12, atol=1e-12 * size)
    np.testing.assert_allclose(after, [[pole * last]], rtol=1e-12, atol=1e-12 * size)


@pytest.mark.parametrize(
    ('part', 'value', 'name'),
    [
        ('input_weight', np.ones(2), 'input_weight'),
        ('rotations', np.ones((4, 3)), 'rotations'),
        ('output_loadings', np.ones((2, 3)), 'output_loadings'),
        ('output_weight', np.ones(3), 'output_weight'),
        ('latents', (static_gain(),), 'rotations'),
        ('output_mean', np.zeros(1), 'output_loadings'),
    ],
)
def test_parts_that_do_not_fit_are_refused(general, part, value, name):
    with pytest.raises(ModelFileError, match=rf'^{name} must have shape .* to fit 3 inputs, '):
        replace(general, **{part: value})


@pytest.mark.parametrize('weight', [[0.5, 0.0], [0.5, -1.0], [0.5, np.nan]])
def test_an_output_weight_that_is_not_positive_is_refused(general, weight):
    with pytest.raises(ModelFileError, match='output_weight must be positive'):
        replace(general, output_weight=np.array(weight))


@pytest.mark.parametrize('a', [[-1.0], [-1.5], [1.2], [-2.0, 1.01], [0.0, 1.0]])
def test_a_latent_that_would_grow_is_refused(general, a):
    unstable = (*general.latents[:3], Arx(np.array(a), np.ones(1)))
    with pytest.raises(ModelFileError, match=r'^Latent 4 has a pole of .* without bound\.$'):
        replace(general, latents=unstable)


@pytest.mark.parametrize('dead', [False, True], ids=['all inputs', 'one of weight 0'])
def test_a_sum_of_filtered_gains_is_written_exactly(*, dead):
    rng = np.random.default_rng(7)
    bank = [static_gain(), relaxation(5.0, 1.0), relaxation(50.0, 1.0)]
    gains, mean = rng.standard_normal((3, 4, 2)), rng.standard_normal(4)
    weight, output_weight = np.array([0.3, 2.0, 0.9, 8.0]), np.array([0.5, 20.0])
    gains[1], gains[2] = 0.0, np.outer(gains[2, :, 0], [1.0, -3.0])
    if dead:
        weight[3], gains[:, 3] = 0.0, 0.0
    model = from_gains(bank, gains, mean, weight, output_weight)
    assert model is not None
    assert len(model.latents) == 3, 'as many as the ranks of the gains'
    x = rng.standard_normal((40, 4))
    _, y = model.run(model.start(x[0]), x)
    parts = [free_run(h, x - mean) @ gain for h, gain in zip(bank, gains, strict=True)]
    np.testing.assert_allclose(y, sum(parts) / output_weight, atol=1e-10)
    tiny = from_gains(bank, 1e-13 * gains, mean, weight, output_weight)
    assert tiny is not None
    np.testing.assert_allclose(tiny.run(tiny.start(x[0]), x)[1] * 1e13, y, atol=1e-10)
    assert from_gains(bank, 0 * gains, mean, weight, output_weight) is None
    with pytest.raises(ValueError, match='longer'):
        from_gains(bank[:2], gains, mean, weight, output_weight)
