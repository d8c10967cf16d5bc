import math

import numpy as np
import pytest

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.errors import TareRefusedError
from wrist_ft_comp.stream.tare import TareCollector

SECOND = 1_000_000_000
#: Since 1970, and odd, so that rounding to floats would show.
START = 1_700_000_000 * SECOND + 1
WRENCH = np.array([1.0, -2.0, 30.0, 0.1, -0.2, 0.3])


def collect(wrenches, rate_hz=100, **limits):
    collector = TareCollector(**{'duration_s': 1.0, 'max_deviation_n': 1.0, **limits})
    for k, wrench in enumerate(wrenches):
        collector.add(START + k * SECOND // rate_hz, wrench.tolist())
    return collector


def noisy(samples=101):
    return WRENCH + np.random.default_rng(0).normal(0, 0.05, (samples, 6))


def test_the_tare_is_the_mean_and_the_middle_of_its_time():
    mean, stamp_ns = collect(noisy()).result()
    np.testing.assert_allclose(mean, noisy().sum(axis=0) / 101, rtol=1e-12)
    assert stamp_ns == START + SECOND // 2


@pytest.mark.parametrize(('step_ns', 'waiting'), [(SECOND // 100, 50), (SECOND, 10)])
def test_the_stretch_is_complete_after_its_duration_and_ten_steps(step_ns, waiting):
    collector = TareCollector(duration_s=0.5, max_deviation_n=1.0)
    done = [collector.add(START + k * step_ns, WRENCH.tolist()) for k in range(waiting + 2)]
    assert done == [False] * waiting + [True] * 2


@pytest.mark.parametrize(('force', 'torque', 'moved'), [
    (1.0, 0.09, ''), (1.0, 0.11, 'torque_z moved by 0.11 N m while taring; at most 0.1 N m'),
    (1.2, 0.09, 'force_x moved by 1.2 N while taring; at most 1 N'),
])  # fmt: skip
def test_the_axis_that_moved_most_for_its_limit_is_named(force, torque, moved):
    wrenches = np.zeros((50, 6))
    wrenches[:20, [0, 5]] = np.repeat([[force, torque], [-force, -torque]], 10, axis=0)
    if not moved:
        assert collect(wrenches, 49).result()[0] == pytest.approx(0.0)
        return
    with pytest.raises(TareRefusedError, match=moved):
        collect(wrenches, 49).result()


def test_a_clock_that_leaps_is_no_time():
    collector = TareCollector(duration_s=1.0, max_deviation_n=1.0)
    for k, stamp in enumerate([0, 10, 7200, -7200, *range(3600, 3690, 10)]):
        assert not collector.add(START + stamp * SECOND // 1000, noisy()[k].tolist())


@pytest.mark.parametrize('value', [math.nan, math.inf, 1e308])
def test_wrenches_that_are_not_finite_are_refused(value):
    wrenches = noisy()
    wrenches[50:, 5] = value
    with pytest.raises(TareRefusedError, match='finite wrenches'):
        collect(wrenches).result()


@pytest.mark.parametrize(
    ('stands', 'at', 'step', 'dead'),
    [
        ([2], 200.0, 0.0, ['force_z']), ([2], 0.0, 0.0, ['force_z']), ([1, 5], 0.0, 0.0, []),
        ([0, 1, 2], 0.0, 0.0, ['force_z']), ([3, 4, 5], math.nan, 0.0, []),
        ([2], 30.0, 0.5, []), (range(6), 1.0, 0.0, list(AXES)),
    ],
    ids=['saturated', 'not up', 'absent', 'two absent', 'no torques', 'coarse', 'frozen'],
)  # fmt: skip
def test_axes_that_do_not_live_are_found_where_the_others_do_or_a_model_knows_them(
    stands, at, step, dead
):
    wrenches = noisy()
    if step:
        wrenches = np.round(wrenches / step) * step
    wrenches[:, list(stands)] = at
    assert collect(wrenches).dead(['force_z']) == dead
