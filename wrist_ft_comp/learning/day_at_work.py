"""A day at work, separated into payload, contacts and drift; what models leave of the drift."""

from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.drift.drift_model import Drift, no_drift
from wrist_ft_comp.fit.folds import averaged_cells, tared_means
from wrist_ft_comp.learning.diary import DayEntry, NONE
from wrist_ft_comp.payload import separation as work
from wrist_ft_comp.payload.mass_and_center import CONTRAST
from wrist_ft_comp.payload.mounted_payloads import COUNTS, unexplained_contrast
from wrist_ft_comp.payload.weight import LearntPayloads
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.zero_steps import Step

#: Temperatures are the same coarse temperature within this interval, K.
_COARSE_K = 4.0


@dataclass(frozen=True, eq=False)
class Day:
    """A day that was separated."""

    recording: Recording
    #: The same with the payload's weight as the reference, without contacts and steps.
    drift: Recording
    steps: list[Step]
    #: Share of the time in contact.
    contact: float
    #: Share of the changes between poses that no payload explains.
    unexplained: float
    #: Standard deviation of a cell, N and N m, shape (6,).
    noise: FloatArray
    #: None where no payload can be identified.
    payloads: LearntPayloads | None
    #: Why no payload can be identified; empty where the robot only did not move enough.
    doubt: str
    #: The day before where this one goes on with it: the model was not at rest then.
    before: Recording | None = None


def look_at(recording: Recording, before: Recording | None = None) -> Day:
    """Separate drift from weight and contacts; CalibrationRefusedError where that fails."""
    separation = work.separate([recording])
    if recording.duration_s > work.SLOW_S:  # else a press of over a minute looks like drift
        separation = work.separate_again(separation, work.slow_drift(separation))
    cells, fit, bodies = separation.cells, separation.fit, separation.bodies()
    doubts = bodies.doubts()
    # Gravity has to move enough in the sensor's frame to tell weight from drift.
    moved = bodies.contrast[0] >= CONTRAST
    return Day(
        recording=separation.recordings[0],
        drift=separation.drift[0],
        steps=separation.steps[0],
        contact=float(np.mean(fit.weights[cells.usable] < COUNTS)),
        unexplained=unexplained_contrast(cells, fit) if moved else 0.0,
        noise=fit.noise,
        payloads=None if doubts else separation.payloads_of(bodies),
        doubt=doubts[-1] if doubts and bodies.contrast[1] >= CONTRAST else '',
        before=before,
    )


def describe(day: Day) -> DayEntry:
    """Make a day's diary entry: temperatures, payloads, noise, and the drift without a model."""
    recording, learnt = day.recording, day.payloads
    low, high = recording.temperature_c.min(axis=0), recording.temperature_c.max(axis=0)
    payloads = learnt.payloads.values() if learnt else ()
    coarse_c = recording.temperature_c - recording.temperature_c[:, :1]
    coarse_c[:, 0] = recording.temperature_c[:, 0]
    known = np.floor(coarse_c / _COARSE_K).astype(int)
    return DayEntry(
        name=recording.name,
        first_ns=recording.first_cell * recording.period_ns,
        hours=recording.duration_s / 3600,
        temperature_c=tuple(zip(low.tolist(), high.tolist(), strict=True)),
        known=tuple(map(tuple, np.unique(known, axis=0).tolist())),
        left={NONE: left(no_drift(len(recording)), day)},
        payloads=tuple((payload.mass_kg, *payload.center_m.tolist()) for payload in payloads),
        rotation=tuple(learnt.frame.rotation.ravel().tolist()) if learnt else (),
        noise=tuple(day.noise.tolist()),
    )


def left(simulated: Drift, day: Day) -> tuple[float, ...]:
    """Compute the RMS of what a model leaves of a day's drift, tared in its first minute, (6,)."""
    drift = day.drift
    residual = drift.wrench - simulated.zero - (1 + simulated.sensitivity) * drift.reference
    cells = averaged_cells(drift.period_s)
    errors = [tared_means(values, cells, drift.period_s) for values in residual.T]
    return tuple(float(np.sqrt(np.mean(e**2))) if len(e) else np.nan for e in errors)
