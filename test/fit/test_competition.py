"""Candidates of one axis compete: which one wins."""

import pytest

from wrist_ft_comp.fit.competition import simplest_good


@pytest.mark.parametrize(
    ('squares', 'chosen'),
    [((9.0, 4.0, 1.0), 2), ((1.0, 0.86), 0), ((1.0, 0.84), 1), ((2.0, 1.0, 1.01), 1)],
)
def test_the_simplest_wins_within_15_percent_of_the_best(squares, chosen):
    """What it wins by, and the gain error at T_ref, are in ``test_identification``."""
    assert simplest_good(squares) == chosen
