"""What is left of the force shows whether a tare was of the payload that is taken off."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrist_ft_comp.payload.weight_check import TareCheck


@pytest.mark.parametrize('heavier', [0.0, 0.03])
@pytest.mark.parametrize('weight_n', [15.0, 98.0])
@pytest.mark.parametrize('tared_on', [False, True])
def test_a_heavy_tool_that_is_named_by_3_percent_too_heavy_hides_no_wrong_tare(
    weight_n, heavier, tared_on
):
    check, rng, said = TareCheck(), np.random.default_rng(0), []
    weights = weight_n * Rotation.random(40, random_state=0).apply([0, 0, 1])
    named = (1.0 + heavier) * weights
    tare = (weights[0] if tared_on else 0.0) - named[0]
    for weight, name in zip(weights, named, strict=True):
        force = weight - tare + rng.normal(0, 0.1, 3)
        said.append(check.off_n(0.0, force - name, name))
    assert any(said) == (not tared_on)
    assert said[-1] == pytest.approx(0.0 if tared_on else weight_n, rel=0.05)


@pytest.mark.parametrize('moved_n', [0.0, 5.0])
def test_a_zero_that_moved_is_said_after_ten_minutes_in_which_a_tool_may_press(moved_n):
    check, rng, said = TareCheck(), np.random.default_rng(0), []
    for k, weight in enumerate(15.0 * Rotation.random(300, random_state=0).apply([0, 0, 1])):
        off_n = (k > 50) * np.array([0.0, 0.0, moved_n]) + rng.normal(0, 0.1, 3)
        said.append(check.off_n(5.0 * k, off_n, weight))
    assert not any(said[:165])
    assert said[-1] == pytest.approx(moved_n, abs=0.3)
