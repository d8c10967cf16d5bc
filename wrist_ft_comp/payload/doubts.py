"""Doubts about recordings at work, in sentences with numbers, so that nothing fails in silence."""

from collections.abc import Iterator, Sequence

import numpy as np

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.payload.accelerometer import calibrated_by_norm, FROZEN_S, known_force
from wrist_ft_comp.payload.gains import (
    axes_of,
    contrast,
    COUNTS,
    cut,
    fitted_levels,
    solve,
    unexplained_contrast,
)
from wrist_ft_comp.payload.mass_and_center import CONTRAST, LIGHTEST_KG, RigidBodies
from wrist_ft_comp.payload.separation import Separation
from wrist_ft_comp.signals import FloatArray, Recording, Reference

#: Largest difference between two clocks that is searched for, cells.
_MOST_LAG_CELLS = 20
#: More contact than this share of the time is doubted.
_MOST_CONTACT = 0.5
#: A longer time without specific force than this share is doubted.
_MOST_MISSING = 0.1
#: Above this share of changes between poses that do not turn with the specific force, no payload
#: is identified ...
_MOST_UNEXPLAINED = 0.2
#: ... and above this share nothing is learnt at all.
_NOTHING_LEARNT = 0.6
#: A wrench follows gravity where this share of its changes turns with the specific force.
_FOLLOWS_GRAVITY = 0.5


def doubts(separation: Separation, bodies: RigidBodies | None) -> tuple[list[str], bool]:
    """
    List all doubts, and say whether payloads can be identified.

    CalibrationRefusedError when nothing can be learnt, because most of the wrench does not turn
    with the specific force.
    """
    recordings = separation.recordings
    lag = list(_lag(recordings))
    sentences = [*_missing(recordings), *_contact(separation), *lag, *_tool_change(separation)]
    no_axes = ['A payload is identified only where all six axes were recorded.']
    objections = [*_unexplained(separation, lag), *(bodies.doubts() if bodies else no_axes)]
    return sentences + objections, not objections


def _missing(recordings: Sequence[Recording]) -> Iterator[str]:
    """Doubt where there is no specific force for much of the time."""
    force = np.concatenate([known_force(recording) for recording in recordings])
    missing = ~np.isfinite(force).all(axis=1)
    if missing.mean() > _MOST_MISSING:
        yield (
            f'In {missing.mean():.0%} of the time the specific force is missing, or stands still '
            f'for {FROZEN_S} s and more. Nothing was learnt from that time.'
        )


def _contact(separation: Separation) -> Iterator[str]:
    """Doubt where the robot was in contact for most of the time."""
    usable = separation.cells.usable
    share = float(np.mean(separation.fit.weights[usable] < COUNTS))
    if share > _MOST_CONTACT:
        yield (
            f'In {share:.0%} of the time something else than a payload pushed, or the specific '
            "force is not the sensor's: contacts may be taken for drift. Let the robot move "
            'freely for more of the time.'
        )


def _unexplained(separation: Separation, lag: Sequence[str]) -> Iterator[str]:
    """Doubt or refuse where the wrench does not turn with the specific force."""
    cells, fit = separation.cells, separation.fit
    share = unexplained_contrast(cells, fit)
    if contrast(cells, fit.weights) < CONTRAST or share <= _MOST_UNEXPLAINED:
        return
    what = (
        f'{share:.0%} of what changes between poses does not turn with the specific force; at '
        f'most {_MOST_UNEXPLAINED:.0%} are allowed. The specific force is of another frame or '
        'another time, or a cable pulls.'
    )
    if share > _NOTHING_LEARNT:
        remedy = 'Record the specific force of a frame fixed to the sensor, by its clock.'
        nothing = f'{what} Neither payload nor drift can be learnt.'
        raise CalibrationRefusedError(' '.join((nothing, *lag, remedy)))
    yield f'{what} No payload was identified.'


def _lag(recordings: Sequence[Recording]) -> Iterator[str]:
    """Doubt clocks where the wrench changes before or after the specific force."""
    most = _MOST_LAG_CELLS
    correlation = np.zeros(2 * most + 1)
    axes = axes_of(recordings)[:3]
    for recording in recordings:
        if len(recording) < 4 * most:
            continue
        moved, pushed = _changes(known_force(recording)), _changes(recording.wrench[:, axes])
        inner, last = pushed[most:-most], len(moved) - most
        correlation += [moved[most - k : last - k] @ inner for k in range(-most, most + 1)]
    lag, peak = int(correlation.argmax()) - most, correlation.max()
    # Where no peak stands out, wrench and specific force do not belong together at all. The peak
    # of a lag is on one side; presses while a robot rests follow one motion and precede another.
    one_sided = min(correlation[:most].max(), correlation[most + 1 :].max()) < 0.7 * peak
    if lag and one_sided and peak > 5 * np.median(np.abs(correlation)):
        yield (
            f'The wrench lags the specific force by {lag * recordings[0].period_s:g} s: their '
            'clocks differ. Record both by one clock.'
        )


def _changes(values: FloatArray) -> FloatArray:
    """Compute how far neighbours differ, without outliers (the largest 5 %) and the mean."""
    sizes = np.nan_to_num(np.linalg.norm(np.diff(values, axis=0), axis=1))
    sizes = np.minimum(sizes, np.quantile(sizes, 0.95))
    return np.asarray(sizes - sizes.mean())


def _tool_change(separation: Separation) -> Iterator[str]:
    """Report the time before which other payloads were mounted than after it."""
    states = np.concatenate(separation.states)
    ends = [np.flatnonzero(states == k)[[0, -1]] for k in np.unique(states[states >= 0])]
    later = [first for first, _ in ends if first > min(end for _, end in ends)]
    if later:
        hours = later[0] * separation.recordings[0].period_s / 3600
        yield (
            f'The tool was changed after {hours:.1f} h: payloads before are not seen again. '
            'If it was not, the sensor or its mounting has changed.'
        )


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
