"""What a report says of a robot at work: payloads, directions of gravity, and what counted."""

import numpy as np

from wrist_ft_comp.calibration.payload.cells import joined
from wrist_ft_comp.calibration.payload.gains import COUNTS
from wrist_ft_comp.calibration.result import Calibration
from wrist_ft_comp.report.view import recording_starts_h, WorkView

#: Shares are of so long, h.
_BIN_H = 1 / 12


def work_view(calibration: Calibration) -> WorkView | None:
    """Collect what there is; None where nothing was learnt at work."""
    separation = calibration.separation
    if separation is None:
        return None
    recordings, counts = separation.recordings, separation.fit.weights > COUNTS
    counted = joined(recordings, counts)
    pushed = joined(recordings, separation.cells.usable & ~counts)
    rows = []
    for i, start_h in enumerate(recording_starts_h(recordings)):
        bins = (recordings[i].elapsed_s / 3600 // _BIN_H).astype(np.int64)
        cells = np.maximum(np.bincount(bins), 1)
        shares = [np.bincount(bins, each[i]) / cells for each in (counted, pushed)]
        middles = start_h + (np.arange(len(cells)) + 0.5) * _BIN_H
        rows.append(np.stack((middles, np.full(len(cells), float(i)), *shares)))
    hours, part, used, contact = np.concatenate(rows, axis=1)
    forces = np.concatenate(separation.accelerometer.forces)[np.concatenate(counted)]
    directions = forces / np.linalg.norm(forces, axis=1, keepdims=True)
    return WorkView(
        calibration.payloads, directions, hours, part.astype(np.int64), used, contact,
        sum(map(len, separation.steps)),
    )  # fmt: skip
