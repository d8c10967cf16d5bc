"""What a calibration takes from recordings at work: drift, payloads, and what to doubt of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.payload.doubts import doubts
from wrist_ft_comp.payload.learnt import LearntPayloads
from wrist_ft_comp.payload.rigid_body import RigidBodies
from wrist_ft_comp.payload.separation import separate, separate_again, Separation
from wrist_ft_comp.signals import Recording
from wrist_ft_comp.stream.offline import simulate_drift


@dataclass(frozen=True, eq=False)
class AtWork:
    """What recordings at work say."""

    #: All recordings, with the weight as their reference; zero where no specific force is.
    drift: list[Recording]
    #: Of those that hold specific force; None where none does.
    separation: Separation | None
    #: By number; None where none can be told.
    payloads: LearntPayloads | None
    #: What to doubt, in sentences.
    warnings: tuple[str, ...]


def learn_at_work(
    recordings: Sequence[Recording], first: tuple[AtWork, DriftModel] | None = None
) -> AtWork:
    """
    Learn payloads and what is drift; CalibrationRefusedError where neither can be.

    What was learnt ``first`` from the same recordings, and a model of its drift, help to tell
    weight, contacts and drift apart: that drift is taken off.
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
    sentences, certain = doubts(separation, bodies)
    separated = iter(separation.drift)
    return AtWork(
        [_constant(r) if r.specific_force is None else next(separated) for r in recordings],
        separation,
        payloads_of(separation, bodies) if bodies and certain else None,
        (*warnings, *sentences),
    )


def payloads_of(separation: Separation, bodies: RigidBodies) -> LearntPayloads:
    """Give the payloads that were mounted numbers, lightest first."""
    states = np.concatenate(separation.states)
    shares = [float(np.mean(states[states >= 0] == k)) for k in range(len(bodies.mass_kg))]
    mounted = bodies.tangible & (np.array(shares) > 0)
    order = [int(k) for k in np.argsort(bodies.mass_kg) if mounted[k]]
    frame = replace(separation.accelerometer.frame, rotation=bodies.rotation)
    numbered = {str(n): bodies.payload(k, shares[k]) for n, k in enumerate(order, 1)}
    return LearntPayloads(frame, numbered)


def _constant(recording: Recording) -> Recording:
    """Count a load that is constant as none: it goes into the recording's offset."""
    return replace(recording, reference=np.zeros_like(recording.reference))
