"""What a calibration learns from recordings at work: drift, payloads, and doubts about them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.payload.doubts import doubts
from wrist_ft_comp.payload.learnt_payloads import LearntPayloads
from wrist_ft_comp.payload.mass_and_center import RigidBodies
from wrist_ft_comp.payload.separation import separate, separate_again, Separation
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.stream.offline import simulate_drift


@dataclass(frozen=True, eq=False)
class AtWork:
    """What was learnt from recordings at work."""

    #: All recordings, with the weight as the reference; zero without specific force.
    drift: list[Recording]
    #: Of the recordings that hold specific force; None where none does.
    separation: Separation | None
    #: Named by numbers; None where none can be identified.
    payloads: LearntPayloads | None
    #: Doubts, in sentences.
    warnings: tuple[str, ...]


def learn_at_work(
    recordings: Sequence[Recording], first: tuple[AtWork, DriftModel] | None = None
) -> AtWork:
    """
    Separate payloads and drift; CalibrationRefusedError where neither can be learnt.

    The second time, ``first`` is the result for the same recordings and the drift model that was
    fitted to it. That drift is taken off, so that weight and contacts are separated better.
    """
    warnings = [
        f'{recording.name} holds no specific force; its load counts as constant.'
        for recording in recordings
        if recording.specific_force is None
    ]
    moved = [recording for recording in recordings if recording.specific_force is not None]
    if not moved:
        return AtWork(list(map(_constant, recordings)), None, None, tuple(warnings))
    before = first[0].separation if first else None
    if first and before:
        drift = [simulate_drift(first[1], recording).zero for recording in moved]
        separation = separate_again(before, drift)
    else:
        separation = separate(moved)
    bodies = separation.bodies()
    objections = doubts(separation, bodies)
    separated = iter(separation.drift)
    return AtWork(
        [_constant(r) if r.specific_force is None else next(separated) for r in recordings],
        separation,
        payloads_of(separation, bodies) if bodies and not objections else None,
        (*warnings, *objections),
    )


def payloads_of(separation: Separation, bodies: RigidBodies) -> LearntPayloads:
    """Name the payloads that were mounted by numbers, the lightest first."""
    states = np.concatenate(separation.states)
    shares = [float(np.mean(states[states >= 0] == k)) for k in range(len(bodies.mass_kg))]
    mounted = bodies.tangible & (np.array(shares) > 0)
    order = [int(k) for k in np.argsort(bodies.mass_kg) if mounted[k]]
    frame = replace(separation.accelerometer.frame, rotation=bodies.rotation)
    numbered = {str(n): bodies.payload(k, shares[k]) for n, k in enumerate(order, 1)}
    return LearntPayloads(frame, numbered)


def _constant(recording: Recording) -> Recording:
    """Take a constant load for zero: it becomes part of the recording's offset."""
    return replace(recording, reference=np.zeros_like(recording.reference))
