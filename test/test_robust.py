import numpy as np

from wrist_ft_comp.robust import robust_cost, robust_weight


def test_the_weight_is_the_derivative_of_the_cost():
    square, step = np.array([0.0, 0.1, 1.0, 30.0]), 1e-6
    costs = [robust_cost(robust_weight(square + part)) for part in (step, 0.0)]
    np.testing.assert_allclose((costs[0] - costs[1]) / step, robust_weight(square), rtol=1e-3)
    assert robust_cost(robust_weight(np.array([0.0, np.inf]))).tolist() == [0.0, 1.0]
