"""One evaluation of several recordings."""

from collections.abc import Sequence

import numpy as np

from wrist_ft_comp.core.evaluation import AxisEvaluation
from wrist_ft_comp.core.recording import AXES


def pool(
    results: Sequence[dict[str, AxisEvaluation]], cells: Sequence[int]
) -> dict[str, AxisEvaluation]:
    """
    Pool the evaluations of several recordings: mean squares by length, largest of the largest.

    Parameters
    ----------
    results : sequence of dict of str to AxisEvaluation
        One per recording.
    cells : sequence of int
        Length of each.

    Returns
    -------
    dict of str to AxisEvaluation
        By axis, those that any recording has.

    """
    pooled = {}
    for axis in AXES:
        of_axis = [result.get(axis) for result in results]
        found = [(e, n) for e, n in zip(of_axis, cells, strict=True) if e is not None]
        if found:
            weights = [n for _, n in found]
            pooled[axis] = AxisEvaluation(
                _root_mean_square([e.rms_before for e, _ in found], weights),
                _root_mean_square([e.rms_after for e, _ in found], weights),
                max(e.max_before for e, _ in found),
                max(e.max_after for e, _ in found),
            )
    return pooled


def _root_mean_square(values: Sequence[float], weights: Sequence[int]) -> float:
    """Pool root mean squares."""
    return float(np.sqrt(np.average(np.square(values), weights=weights)))
