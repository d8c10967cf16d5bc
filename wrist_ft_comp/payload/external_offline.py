"""The external wrench, offline: corrected wrenches less the payload's weight."""

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.drift_model import correct, DriftModel
from wrist_ft_comp.payload.separation import Separation
from wrist_ft_comp.payload.weight_gains import axes_of
from wrist_ft_comp.recording import Correction, Recording
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.stream.offline import correct_many, simulate_drift, track_drift

#: A specific force is used for wrenches within this time, ns ...
_TIMEOUT_NS = NANOSECONDS // 5
#: ... or within this many median distances between its samples, if that is more.
_TIMEOUT_DISTANCES = 1.5


def external_correction(separation: Separation, model: DriftModel, fine: Recording) -> Correction:
    """
    Make the function that turns raw wrenches of a recording into external ones.

    They are zero in free motion, and NaN where specific force is missing. Payload states and gains
    are those of the separation; specific force is that of ``fine``, the same recording on a finer
    grid.
    """
    recording, axes = separation.recordings[0], axes_of(separation.recordings)
    gains = np.full((len(separation.fit.gains), 3, len(AXES)), np.nan)
    gains[:, :, axes] = separation.fit.gains
    force = np.full((len(fine), 3), np.nan) if fine.specific_force is None else fine.specific_force
    finite = np.flatnonzero(np.isfinite(force).all(axis=1))
    force_ns = (fine.first_cell + finite) * fine.period_ns + fine.period_ns // 2
    states = _held(separation.states[0])[_cells(recording, force_ns)]
    corrected = separation.accelerometer.frame.turn(force[finite])
    weight = np.einsum('ni,nia->na', corrected, gains[states])
    usual_ns = float(np.median(np.diff(force_ns))) if len(force_ns) > 1 else 0.0
    farthest_ns = max(_TIMEOUT_NS, _TIMEOUT_DISTANCES * usual_ns)
    track, offset = track_drift(model, recording), _offset(separation, model)

    def external(stamps_ns: IntArray, raw: FloatArray) -> FloatArray:
        """Subtract drift, weight and offset."""
        wanted_ns, known_ns = stamps_ns - force_ns[0], force_ns - force_ns[0]
        places = np.interp(wanted_ns, known_ns, np.arange(len(force_ns)))
        nearest = np.rint(places).astype(np.int64)
        near = np.abs(wanted_ns - known_ns[nearest]) <= farthest_ns
        weights = [np.interp(wanted_ns, known_ns, axis) for axis in weight.T]
        wrench = correct_many(track, stamps_ns, raw) - np.stack(weights, axis=1)
        wrench -= offset[_cells(recording, stamps_ns)]
        return np.where(near[:, None], wrench, np.nan)

    return external


def _offset(separation: Separation, model: DriftModel) -> FloatArray:
    """Find the offset between tares of the driver, (N, 6), from free motion; NaN without any."""
    recording, drift = separation.recordings[0], separation.drift[0]
    wrench = correct(recording.wrench, simulate_drift(model, recording), 0.0) - drift.reference
    free = np.asarray(np.isfinite(drift.wrench).any(axis=1))
    edges = sorted(step.cell for step in separation.steps[0])
    offset = np.full_like(wrench, np.nan)
    for part in np.split(np.arange(len(wrench)), edges):
        if free[part].any():
            offset[part] = np.median(wrench[part[free[part]]], axis=0)
    return offset


def _held(states: IntArray) -> IntArray:
    """Fill cells without a state, -1, with the last state before them, or else with the first."""
    counted = np.flatnonzero(states >= 0)
    last = np.searchsorted(counted, np.arange(len(states)), side='right') - 1
    return np.asarray(states[counted[np.maximum(last, 0)]])


def _cells(recording: Recording, stamps_ns: IntArray) -> IntArray:
    """Find the cells of stamps; a stamp outside the recording is in its first or last cell."""
    numbers = stamps_ns // recording.period_ns - recording.first_cell
    return np.clip(numbers, 0, len(recording) - 1)
