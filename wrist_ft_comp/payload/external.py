"""What the environment does to the tool, offline: corrected wrenches less the payload's weight."""

import numpy as np

from wrist_ft_comp.drift.drift_model import correct, DriftModel
from wrist_ft_comp.payload.gains import axes_of
from wrist_ft_comp.payload.separation import Separation
from wrist_ft_comp.signals import (
    AXES,
    Correction,
    FloatArray,
    IntArray,
    NANOSECONDS,
    Recording,
)
from wrist_ft_comp.stream.offline import correct_many, simulate_drift, track_drift

#: Specific force says nothing of a wrench that is farther away in time, ns …
_TIMEOUT_NS = NANOSECONDS // 5
#: … and farther than so many usual distances between its samples.
_DISTANCES = 1.5


def external_correction(separation: Separation, model: DriftModel, fine: Recording) -> Correction:
    """
    Make what turns raw wrenches of one recording into external ones, zero in free motion.

    Its payload states and what they weigh come from the separation; specific force comes from
    ``fine``, the same recording on a finer grid. NaN where that is missing.
    """
    recording, axes = separation.recordings[0], axes_of(separation.recordings)
    gains = np.full((len(separation.fit.gains), 3, len(AXES)), np.nan)
    gains[:, :, axes] = separation.fit.gains
    force = np.full((len(fine), 3), np.nan) if fine.specific_force is None else fine.specific_force
    felt = np.flatnonzero(np.isfinite(force).all(axis=1))
    at_ns = (fine.first_cell + felt) * fine.period_ns + fine.period_ns // 2
    held = _held(separation.states[0])[_cells(recording, at_ns)]
    right = separation.accelerometer.frame.turn(force[felt])
    weight = np.einsum('ni,nia->na', right, gains[held])
    usual = float(np.median(np.diff(at_ns))) if len(at_ns) > 1 else 0.0
    farthest = max(_TIMEOUT_NS, _DISTANCES * usual)
    track, offset = track_drift(model, recording), _offset(separation, model)

    def external(stamps_ns: IntArray, raw: FloatArray) -> FloatArray:
        """Take drift, weight and offset off."""
        wanted_ns, felt_ns = stamps_ns - at_ns[0], at_ns - at_ns[0]
        nearest = np.rint(np.interp(wanted_ns, felt_ns, np.arange(len(at_ns)))).astype(np.int64)
        near = np.abs(wanted_ns - felt_ns[nearest]) <= farthest
        pushed = [np.interp(wanted_ns, felt_ns, axis) for axis in weight.T]
        rest = correct_many(track, stamps_ns, raw) - np.stack(pushed, axis=1)
        rest -= offset[_cells(recording, stamps_ns)]
        return np.where(near[:, None], rest, np.nan)

    return external


def _offset(separation: Separation, model: DriftModel) -> FloatArray:
    """Find what is left in free motion between tares of the driver, (N, 6); NaN where none is."""
    recording, drift = separation.recordings[0], separation.drift[0]
    rest = correct(recording.wrench, simulate_drift(model, recording), 0.0) - drift.reference
    free = np.asarray(np.isfinite(drift.wrench).any(axis=1))
    edges = sorted(step.cell for step in separation.steps[0])
    offset = np.full_like(rest, np.nan)
    for part in np.split(np.arange(len(rest)), edges):
        if free[part].any():
            offset[part] = np.median(rest[part[free[part]]], axis=0)
    return offset


def _held(states: IntArray) -> IntArray:
    """Hold the last state that counted, and the first one before it."""
    counted = np.flatnonzero(states >= 0)
    last = np.searchsorted(counted, np.arange(len(states)), side='right') - 1
    return np.asarray(states[counted[np.maximum(last, 0)]])


def _cells(recording: Recording, stamps_ns: IntArray) -> IntArray:
    """Find the cells of stamps; those beyond the ends are in the first or last cell."""
    numbers = stamps_ns // recording.period_ns - recording.first_cell
    return np.clip(numbers, 0, len(recording) - 1)
