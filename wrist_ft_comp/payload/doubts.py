"""Doubts about recordings at work, in sentences with numbers, so that nothing fails in silence."""

from collections.abc import Iterator, Sequence

import numpy as np

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.payload.accelerometer import calibrated_by_norm
from wrist_ft_comp.payload.mass_and_center import CONTRAST, LIGHTEST_KG, RigidBodies
from wrist_ft_comp.payload.separation import Separation
from wrist_ft_comp.payload.weight_gains import (
    axes_of,
    contrast,
    cut,
    fitted_levels,
    solve,
    unexplained_contrast,
)
from wrist_ft_comp.recording import Recording, Reference

#: Above this share of changes between poses that do not turn with the specific force, no payload
#: is identified ...
_MOST_UNEXPLAINED = 0.2
#: ... and above this share nothing is learnt at all.
_NOTHING_LEARNT = 0.6
#: A wrench follows gravity where this share of its changes turns with the specific force.
_FOLLOWS_GRAVITY = 0.5


def doubts(separation: Separation, bodies: RigidBodies | None) -> list[str]:
    """
    List the reasons why no payload can be identified; empty where payloads can.

    CalibrationRefusedError when nothing can be learnt, because most of the wrench does not turn
    with the specific force.
    """
    if bodies:
        objections = bodies.doubts()
    else:
        objections = ['A payload is identified only where all six axes were recorded.']
    share = unexplained_contrast(separation.cells, separation.fit)
    if contrast(separation.cells, separation.fit.weights) < CONTRAST or share <= _MOST_UNEXPLAINED:
        return objections
    what = (
        f'{share:.0%} of what changes between poses does not turn with the specific force; at '
        f'most {_MOST_UNEXPLAINED:.0%} are allowed. The specific force is of another frame, or of '
        'another clock than the wrench, or a cable pulls.'
    )
    if share > _NOTHING_LEARNT:
        raise CalibrationRefusedError(
            f'{what} Neither payload nor drift can be learnt. Record the specific force of a '
            'frame fixed to the sensor, by its clock.'
        )
    return [f'{what} No payload was identified.', *objections]


def follows_gravity(recordings: Sequence[Recording], reference: Reference) -> Iterator[str]:
    """Doubt a wrench that was declared unloaded or constant, but turns with the specific force."""
    for recording in recordings:
        axes = axes_of([recording])
        if recording.specific_force is None or not axes:
            continue
        cells = cut([recording], calibrated_by_norm([recording]).forces)
        weights, states = cells.usable.astype(float), np.zeros(cells.usable.shape, dtype=np.int64)
        (gains,) = solve(cells, states, weights, 1)
        parts = (cells.wrench, cells.wrench - cells.force @ gains)
        before, after = (
            np.einsum('nb,nbi->', weights, (part - fitted_levels(part, weights)) ** 2)
            for part in parts
        )
        share = 1 - after / before if before > 0 else 0.0
        mass_kg = float(np.linalg.norm(gains) / np.sqrt(3))
        if share > _FOLLOWS_GRAVITY and mass_kg > LIGHTEST_KG:
            yield (
                f'The wrench of {recording.name} follows gravity: {share:.0%} of what changes '
                f'within minutes turns with the specific force, as about {mass_kg:.2g} kg would, '
                f'but the reference is {reference}. Use the reference payload (--reference '
                'payload; calibration.reference of a node).'
            )
