"""Rigid bodies from gains: exact recovery, whatever the frame, and what cannot be found."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrist_ft_comp.payload.mass_and_center import rigid_bodies

BODIES = [(1.3, np.array([0.01, -0.02, 0.09])), (2.1, np.array([0.02, -0.01, 0.12]))]
#: Products of three directions seen equally, by two bodies for half of the time each.
NORMAL = 500.0 * np.eye(6)


def gains_of(rotation):
    """Columns of [-m R; -m [c]× R], as rows, one column at a time."""
    return np.array([[np.append(x, np.cross(c, x)) for x in -m * rotation.T] for m, c in BODIES])


@pytest.mark.parametrize('seen', [[1.0, 1.0, 1.0], [1.0, 0.5, 0.0], [0.0, 1.0, 0.1]])
def test_bodies_are_found_in_any_frame_and_a_direction_never_seen_does_not_count(seen):
    rotation = Rotation.from_rotvec([0.4, -1.0, 2.0]).as_matrix()
    gains = np.where(np.array(seen)[:, None] > 0, gains_of(rotation), 0.3)
    normal = 500.0 * np.kron(np.eye(2), np.diag(seen))
    found = rigid_bodies(gains, normal, np.full(6, 1e-4), 1000.0)
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-6)
    np.testing.assert_allclose(found.mass_kg, [m for m, _ in BODIES], rtol=1e-6)
    np.testing.assert_allclose(found.center_m, [c for _, c in BODIES], atol=1e-6)
    assert found.misfit < 1e-6
    np.testing.assert_allclose(found.contrast, np.sqrt(sorted(seen)[::-1]))


def test_errors_are_as_large_as_they_say():
    rng, spread = np.random.default_rng(0), np.array([0.04, 0.04, 0.04, 4e-4, 4e-4, 4e-4])
    off = []
    for _ in range(30):
        noise = np.sqrt(spread / 500.0) * rng.standard_normal((2, 3, 6))
        found = rigid_bodies(gains_of(np.eye(3)) + noise, NORMAL, spread, 1000.0)
        centers = found.center_m - [c for _, c in BODIES]
        off.append(centers / found.center_error_m)
    assert 0.6 < np.std(off) < 1.3


#: A press that comes again is no body, however rarely it comes; an empty gripper is no misfit.
GAINS, PRESS = gains_of(np.eye(3)), np.random.default_rng(0).normal(0, 2, (1, 3, 6))
RARELY = 500.0 * np.kron(np.diag([1.0, 1.0, 0.003]), np.eye(3))


@pytest.mark.parametrize(('gains', 'normal', 'said'), [
    (-GAINS, NORMAL, 'mirrored'), (gains_of(np.diag([1.0, 1.0, -1.0])), NORMAL, 'mirrored'),
    (GAINS * [1, 1, 1.8, 1, 1, 1], NORMAL, 'not that of a rigid body'),
    (np.concatenate((GAINS, PRESS)), RARELY, 'not that of a rigid body'),
    (np.concatenate((GAINS, 1e-3 * PRESS)), RARELY, None),
])  # fmt: skip
def test_reasons_against_a_payload_are_named(gains, normal, said):
    doubts = rigid_bodies(gains, normal, np.full(6, 1e-4), 1000.0).doubts()
    assert any(said in doubt for doubt in doubts) if said else not doubts
