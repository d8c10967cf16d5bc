"""Frames that hang together, by transforms that come as they like, against scipy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrist_ft_comp.channels import GRAVITY
from wrist_ft_comp.cli.show import directions_of
from wrist_ft_comp.wire.gravity_by_tf import GravityByTf, Transforms

SECOND = 1_000_000_000
RNG = np.random.default_rng(3)
TURNS = {name: Rotation.random(random_state=k) for k, name in enumerate('abcd')}


def send(gravity, parent, child, seconds, turned, *, static=False):  # noqa: PLR0913
    stamps_ns = np.rint(np.atleast_1d(seconds) * SECOND).astype(np.int64)
    quaternions = np.broadcast_to(turned.as_quat(), (len(stamps_ns), 4))
    gravity.add(Transforms(parent, child, stamps_ns, quaternions), static=static)


def ask(gravity, *seconds):
    return gravity.read(np.rint(np.array(seconds) * SECOND).astype(np.int64))


def turning(seconds):
    return Rotation.from_rotvec(np.multiply.outer(seconds, [0, 0.8, 0]))


def test_the_frames_may_lie_on_two_branches():
    gravity = GravityByTf('table', '/sensor')
    send(gravity, 'map', 'table', 0, TURNS['a'], static=True)
    send(gravity, '/map', 'base', 0, TURNS['b'], static=True)
    seconds = np.arange(0, 2.01, 0.1)
    send(gravity, 'base', 'arm', seconds, turning(seconds))
    send(gravity, 'arm', 'sensor', 5, TURNS['c'], static=True)
    at = np.array([0.0, 0.03, 0.77, 2.0])
    force, speed = ask(gravity, *at)
    turned = TURNS['a'].inv() * TURNS['b'] * turning(at) * TURNS['c']
    np.testing.assert_allclose(force, turned.inv().apply([0, 0, GRAVITY]), atol=1e-3)
    assert np.isnan(speed[[0, 2, 3]]).all(), 'they are too far apart'
    np.testing.assert_allclose(speed[1], 0.8, rtol=1e-3)
    np.testing.assert_allclose(ask(gravity, 2.0)[0], force[-1:])
    assert gravity.settled_ns() == 2 * SECOND
    assert gravity.root() == 'map'


def test_of_static_transforms_alone_joints_are_missing():
    gravity = GravityByTf('table', 'sensor')
    send(gravity, 'table', 'sensor', 0, TURNS['a'], static=True)
    assert gravity.settled_ns() is None
    assert ': only static ones link them, as where no joint is published. The' in gravity.missing()
    send(gravity, 'map', 'table', [0, 9], TURNS['b'])
    gravity.upper = 'map'
    assert 'without a loop or a gap of half a second' in gravity.missing()


@pytest.mark.parametrize('parent', ['tool', 'flange'])
@pytest.mark.parametrize(('gap', 'turned'), [(0.1, 0.0), (5.0, 4.0)])
def test_what_turned_unseen_is_known(gap, turned, parent):
    gravity, seen = GravityByTf('world', 'ft'), min(turned, 2 * np.pi - turned)
    for child in ('ft', 'flange'):
        send(gravity, 'tool', child, 0, Rotation.identity(), static=True)
    for second in (1.0, 1.0 + gap):
        send(gravity, 'world', 'tool', [second, second + 0.02], turning([second, second + 0.02]))
        ask(gravity, second, second + 0.02)
    assert gravity.turned_unseen_rad == pytest.approx(seen, abs=0.05)
    send(gravity, parent, 'ft', 0, Rotation.from_euler('x', 1.0), static=True)
    send(gravity, 'world', 'tool', [1.04 + gap], turning([1.04 + gap]))
    ask(gravity, 1.04 + gap)
    assert gravity.turned_unseen_rad == pytest.approx(max(seen, 1.0), abs=0.05)


@pytest.mark.parametrize('gap', [0.5, 0.52])
def test_gaps_up_to_half_a_second_are_bridged(gap):
    gravity = GravityByTf('world', 'tool')
    send(gravity, 'world', 'tool', [1.0, 1.0 + gap], turning([1.0, 1.0 + gap]))
    force, _ = ask(gravity, 0.99, 1.0, 1.0 + gap / 2, 1.0 + gap, 1.01 + gap)
    finite = np.isfinite(force[:, 0]).tolist()
    assert finite == [False, True, gap == 0.5, True, False]
    np.testing.assert_allclose(force[1], turning(1.0).inv().apply([0, 0, GRAVITY]))


def test_transforms_may_come_late_twice_and_out_of_order():
    gravity = GravityByTf('world', 'tool')
    seconds = RNG.permutation(np.arange(0, 2, 0.05))
    send(gravity, 'world', 'tool', seconds, turning(seconds))
    send(gravity, 'world', 'tool', [0.5, 0.5], TURNS['a'])
    send(gravity, 'world', 'tool', [0.5], turning([0.5]))  # the newest counts
    at = np.arange(0, 1.9, 0.01)
    force, _ = ask(gravity, *at)
    np.testing.assert_allclose(force, turning(at).inv().apply([0, 0, GRAVITY]), atol=2e-3)


def test_the_tree_is_settled_up_to_its_slowest_frame_that_still_comes():
    gravity = GravityByTf('world', 'tool')
    send(gravity, 'world', 'arm', [0, 9.9], TURNS['a'])
    assert gravity.settled_ns() is None, 'the tool hangs nowhere'
    send(gravity, 'arm', 'wrist', [0, 8.5], TURNS['a'])
    send(gravity, 'wrist', 'tool', [0, 7.0], TURNS['a'])
    send(gravity, 'elsewhere', 'world', [0, 8.2], TURNS['a'])  # above both
    assert gravity.settled_ns() == 8.5 * SECOND


def test_static_transforms_hold_and_give_way_to_ones_that_move():
    gravity = GravityByTf('world', 'tool')
    send(gravity, 'world', 'tool', 2, TURNS['a'], static=True)
    send(gravity, 'world', 'tool', 4, TURNS['b'], static=True)
    force, _ = ask(gravity, 1, 3.9, 4, 99)
    expected = [TURNS[name].inv().apply([0, 0, GRAVITY]) for name in 'bbbb']
    np.testing.assert_allclose(force, expected)
    assert gravity.settled_ns() is None
    send(gravity, 'world', 'tool', 100, TURNS['c'])
    send(gravity, 'world', 'tool', 100, TURNS['d'], static=True)
    force, _ = ask(gravity, 99, 100)
    assert np.isnan(force[0]).all()
    np.testing.assert_allclose(force[1], TURNS['c'].inv().apply([0, 0, GRAVITY]))


def test_three_seconds_are_kept_and_a_clock_set_back_begins_anew():
    gravity = GravityByTf('world', 'tool')
    seconds = np.arange(0, 10.01, 0.1)
    send(gravity, 'world', 'tool', seconds, TURNS['a'])
    gravity.forget()
    assert np.isfinite(ask(gravity, 6.9, 7.0)[0][:, 0]).tolist() == [False, True]
    send(gravity, 'world', 'tool', 5.0, TURNS['b'])
    assert gravity.settled_ns() == 5 * SECOND
    assert np.isfinite(ask(gravity, 5.0, 9.0)[0][:, 0]).tolist() == [True, False]


def test_directions_count_where_gravity_moved():
    force = Rotation.from_rotvec(np.linspace([0, 0, 0], [1, 0, 0], 50)).apply([0, 0, 2 * GRAVITY])
    assert directions_of(force) == 2
    assert directions_of(force[:1]) == 0
