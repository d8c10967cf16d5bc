"""A day at work, its weight and contacts apart from drift, and what models leave of that drift."""

from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.drift.drift_model import Drift, no_drift
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.cross_validation import bin_means, tare
from wrist_ft_comp.learning.entry import Cell, DayEntry, NONE
from wrist_ft_comp.payload.at_work import payloads_of
from wrist_ft_comp.payload.gains import contrast, COUNTS, unexplained_contrast
from wrist_ft_comp.payload.learnt import LearntPayloads
from wrist_ft_comp.payload.rigid_body import CONTRAST
from wrist_ft_comp.payload.separation import (
    separate,
    separate_again,
    Separation,
    Step,
)
from wrist_ft_comp.payload.slow_drift import slow_drift, SLOW_S
from wrist_ft_comp.signals import AXES, BoolArray, FloatArray, Recording

#: Errors are judged as means over so long, s.
_MEAN_S = 10.0
#: Temperatures count as known in steps of this, K, when a day was there for so long, s.
_STEP_K, _LONG_S = 4.0, 120.0


@dataclass(frozen=True, eq=False)
class Day:
    """What a day says."""

    recording: Recording
    #: The same with its weight as the reference, contacts and steps left out.
    drift: Recording
    steps: list[Step]
    #: Shares of the time in contact, and of changes between poses that no payload makes; noise of
    #: a cell, (A,).
    contact: float
    unexplained: float
    noise: FloatArray
    #: None where no payload can be told, and then why; no reason if the robot did not move enough.
    payloads: LearntPayloads | None
    doubt: str


def look_at(recording: Recording) -> Day:
    """Separate drift from weight and contacts; CalibrationRefusedError where that cannot be."""
    if recording.specific_force is None:
        raise CalibrationRefusedError(
            f'{recording.name} holds no specific force, which learning from days needs. Set '
            'gravity.source, so that it is recorded.'
        )
    found = separate([recording])
    if recording.duration_s > SLOW_S:  # presses of more than a minute looked like drift
        drift = slow_drift(recording, found.drift[0], found.fit.noise)
        found = separate_again(found, [drift])
    return tell(found)


def tell(separation: Separation) -> Day:
    """Take what counts from a day that was separated."""
    (recording,), (drift,), (steps,) = separation.recordings, separation.drift, separation.steps
    bodies, fit = separation.bodies(), separation.fit
    said = bodies.doubts() if bodies else ['']
    payloads = payloads_of(separation, bodies) if bodies and not said else None
    doubt = said[-1] if said and bodies and bodies.contrast[1] >= CONTRAST else ''
    moved = contrast(separation.cells, fit.weights) >= CONTRAST
    unexplained = unexplained_contrast(separation.cells, fit) if moved else 0.0
    contact = float(np.mean(fit.weights[separation.cells.usable] < COUNTS))
    return Day(recording, drift, steps, contact, unexplained, fit.noise, payloads, doubt)


def describe(day: Day) -> DayEntry:
    """Write down what a day saw, and how far it drifts by itself."""
    recording, learnt = day.recording, day.payloads
    low, high = recording.temperature_c.min(axis=0), recording.temperature_c.max(axis=0)
    found = learnt.payloads.values() if learnt else ()
    return DayEntry(
        name=recording.name,
        first_ns=recording.first_cell * recording.period_ns,
        hours=recording.duration_s / 3600,
        temperature_c=tuple(zip(low.tolist(), high.tolist(), strict=True)),
        still_s=tuple(
            float(np.sum(run) * recording.period_s) for run in longest_stills(recording)
        ),
        known=known_cells(recording),
        left={NONE: left(no_drift(len(recording)), day)},
        payloads=tuple((each.mass_kg, *each.center_m.tolist()) for each in found),
        rotation=tuple(learnt.frame.rotation.ravel().tolist()) if learnt else (),
        noise=tuple(day.noise.tolist()),
    )


def left(simulated: Drift, day: Day) -> tuple[float, ...]:
    """RMS of what a model leaves of a day's drift, tared in its first minute, (6,)."""
    drift = day.drift
    rest = drift.wrench - simulated.zero - (1 + simulated.sensitivity) * drift.reference
    cells = max(1, round(_MEAN_S / drift.period_s))
    figures = np.full(len(AXES), np.nan)
    for axis, values in enumerate(rest.T):
        rows = np.flatnonzero(np.isfinite(values))
        if len(rows):
            errors = tare(bin_means(values[rows], rows, cells), cells * drift.period_s)
            figures[axis] = np.sqrt(np.mean(errors**2))
    return tuple(figures.tolist())


def known_cells(recording: Recording) -> frozenset[Cell]:
    """List the coarse temperatures of a recording, in which others differ from the first."""
    apart_c = recording.temperature_c - recording.temperature_c[:, :1]
    apart_c[:, 0] = recording.temperature_c[:, 0]
    cells, counts = np.unique(np.floor(apart_c / _STEP_K).astype(int), axis=0, return_counts=True)
    return frozenset(tuple(c) for c in cells[counts * recording.period_s >= _LONG_S].tolist())


def longest_stills(recording: Recording) -> list[BoolArray]:
    """Mark the longest time in which each thermometer kept one value, or was silent, (N,)."""
    marks = []
    for values, measured in zip(recording.temperature_c.T, recording.measured.T, strict=True):
        changed = np.zeros(len(values), dtype=bool)
        at = np.flatnonzero(measured)
        changed[at[1:]] = np.diff(values[at]) != 0
        runs = np.cumsum(changed)
        marks.append(runs == np.bincount(runs).argmax())
    return marks


def share(entry: DayEntry, model: str) -> FloatArray:
    """Drift that a model left of a day by what was there, (6,); NaN where it is not known."""
    nothing = (np.nan,) * len(AXES)
    there = np.maximum(entry.left.get(NONE, nothing), 1e-12)
    return np.asarray(np.array(entry.left.get(model, nothing)) / there)
