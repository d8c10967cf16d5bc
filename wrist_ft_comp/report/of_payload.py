"""What a report says of a robot at work: payloads, directions of gravity, and what counted."""

import numpy as np
from scipy.spatial.transform import Rotation

from wrist_ft_comp.calibration.payload.cells import joined
from wrist_ft_comp.calibration.payload.gains import COUNTS
from wrist_ft_comp.calibration.payload.separation import Separation
from wrist_ft_comp.calibration.result import Calibration
from wrist_ft_comp.model.signals import FloatArray, IntArray
from wrist_ft_comp.report.view import recording_starts_h, WorkView

#: Shares are of so long, h.
_BIN_H = 1 / 12


def work_view(calibration: Calibration) -> WorkView | None:
    """Collect what there is; None where nothing was learnt at work."""
    separation, learnt = calibration.separation, calibration.payloads
    if separation is None:
        return None
    weights = joined(separation.recordings, separation.fit.weights)
    forces = np.concatenate(separation.accelerometer.forces)[np.concatenate(weights) > COUNTS]
    turned = None
    if learnt is not None:
        turned = Rotation.from_matrix(learnt.frame.rotation).as_euler('xyz', degrees=True)
    directions = forces / np.linalg.norm(forces, axis=1, keepdims=True)
    payloads, steps = learnt.payloads if learnt else {}, sum(map(len, separation.steps))
    return WorkView(payloads, turned, directions, *_shares(separation), steps)


def _shares(separation: Separation) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """Find what counted and what was taken for contact, bin by bin."""
    recordings = separation.recordings
    weights = joined(recordings, separation.fit.weights)
    usable = joined(recordings, separation.cells.usable)
    rows = []
    for i, start_h in enumerate(recording_starts_h(recordings)):
        counted = weights[i] > COUNTS
        bins = (recordings[i].elapsed_s / 3600 // _BIN_H).astype(np.int64)
        cells = np.maximum(np.bincount(bins), 1)
        used, pushed = (
            np.bincount(bins, each) / cells for each in (counted, usable[i] & ~counted)
        )
        middles = start_h + (np.arange(len(cells)) + 0.5) * _BIN_H
        rows.append(np.stack((middles, np.full(len(cells), float(i)), used, pushed)))
    hours, part, used, pushed = np.concatenate(rows, axis=1)
    return hours, part.astype(np.int64), used, pushed
