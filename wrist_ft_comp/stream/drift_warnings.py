"""
What may be wrong with the drift that is subtracted: sentences for the statuses.

Only what is off by more than the model itself leaves is said.
"""

from collections.abc import Mapping

import numpy as np

from wrist_ft_comp.channels import AXES, axis_unit
from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray, NANOSECONDS
from wrist_ft_comp.stream import exchanged_thermometers
from wrist_ft_comp.stream.drift_limits import axis_limits
from wrist_ft_comp.stream.drift_tracker import DriftTracker
from wrist_ft_comp.stream.drift_uncertainty import doubt_start
from wrist_ft_comp.stream.failed_thermometers import too_still_s
from wrist_ft_comp.stream.gaps_and_restarts import longest_gap_s, OUTAGE_S

#: Drift that may be off by fewer standard deviations of the model than this is not doubted.
_CERTAIN = 3.0
#: A recording that stands still at first, and cools by this later, K, was warm by work, not by its
#: room: rooms vary by less.
_COOLS_K = 2.0


def gap_doubts(tracker: DriftTracker, now_ns: float = 0) -> list[str]:
    """Say how far the drift may be off at a stamp, because temperatures were missing."""
    if tracker.uncertainty is None:
        return []
    at_ns = tracker.end_ns + np.clip(now_ns - tracker.end_ns, 0, tracker.patience_s * NANOSECONDS)
    worst = _off(tracker.model, tracker.uncertainty.left(at_ns, tracker.memory_s))
    sentence = (
        'the thermal state is uncertain, because the robot was warm at the start, or temperatures '
        f'were missing or wrong, or a clock was set: {worst} off, and less and less from now on'
    )
    return [sentence] if worst else []


def start_doubts(model: DriftModel, recording: Recording) -> list[str]:
    """Say how far the drift of a recording may be off, because the robot was warm before."""
    memory_s, celsius = longest_gap_s(model), recording.temperature_c
    cools = (celsius.min(axis=0) < celsius[0] - _COOLS_K).any()
    soaked_k = None if cools else np.zeros(recording.thermometers)
    worst = _off(model, doubt_start(model, celsius, memory_s, soaked_k))
    sentence = (
        f'{recording.name} begins on a warm robot. Unless it had rested, {worst} off, less and '
        f'less over {memory_s / 60:.0f} min, and by a tare at the beginning to the end. Record '
        'from cold; leave a warm-up out by --exclude, not by --from: its temperatures count.'
    )
    return [sentence] if worst else []


def frozen_doubts(tracker: DriftTracker) -> list[str]:
    """Say which thermometers may be frozen, and how far the drift is off then."""
    state, model, period_ns = tracker.thermometers, tracker.model, tracker.grid.period_ns
    silent, sentences = tracker.grid.silent(tracker.end_ns // period_ns), list[str]()
    usual_s = (model and model.stands_s) or [None] * len(silent)

    def too_long_s(j: int) -> float:
        return too_still_s(tracker.history_c[:, j], period_ns / NANOSECONDS, usual_s[j])

    # Where all stand still, none is left that could predict another one.
    all_still = all(map(too_long_s, range(len(silent))))
    if all_still or state is None or model is None or model.prediction is None:
        for j in range(len(silent)):
            if not silent[j] and (still_s := too_long_s(j)):
                sentences.append(
                    f'thermometer {j + 1} has read the same for {still_s / 60:.0f} min, far '
                    'longer than before; is it frozen? The drift follows it'
                )
        return sentences
    one = np.eye(len(silent))
    for j in tracker.replaced:
        # Held-out predictions were off by a third of this at most.
        if worst := _off(model, tracker.effect(one[j] * model.prediction.agree_k / 3)):
            sentences.append(f'by what is predicted of thermometer {j + 1}, {worst} off')
    for j in np.flatnonzero(state.suspicious(model.prediction, 0.0)).tolist():
        # On a robot that hardly warms: the longer one stands, the less has to have moved.
        moved = state.moved_k[j] / model.prediction.still_k[j]
        stands = np.clip(state.still_s[j] / (usual_s[j] or np.inf), 1, 5)
        seems = moved * stands > 0.5 or (moved > 0.2 and too_long_s(j))
        if seems and (worst := _off(model, tracker.effect(one[j] * state.moved_k))):
            sentences.append(
                f'thermometer {j + 1} has read the same for {state.still_s[j]:.0f} s while '
                f'the others show that it moved by {state.moved_k[j]:.1f} K; is it frozen? '
                f'Then {worst} off'
            )
    return sentences


def seldom_doubts(tracker: DriftTracker, moves: Mapping[int, FloatArray]) -> list[str]:
    """
    Say whose seldom reports, or long cells, leave more of the drift than the model states.

    Takes how far the last report of each thermometer moved the drift, N and N m, (6,).
    """
    sentences = []
    for j, behind in moves.items():
        worst = _off(tracker.model, behind)
        spacing_s = tracker.grid.spacing(j) * tracker.grid.period_ns / NANOSECONDS
        if spacing_s > OUTAGE_S and worst:
            sentences.append(
                f'thermometer {j + 1} is followed every {spacing_s:.3g} s, so that {worst} '
                'behind; let it report each second, and calibrate from such reports'
            )
    return sentences


def _off(model: DriftModel | None, off: FloatArray) -> str:
    """Say how far the drift may be off, N and N m, (6,), beyond what the model states."""
    if model is None:
        return ''
    excess = off - [_CERTAIN * model.deviation.get(axis, 0.0) for axis in AXES]
    worst = int(np.argmax(excess / axis_limits(1.0)))
    if excess[worst] <= 0:
        return ''
    return f'the drift of {AXES[worst]} may be {off[worst]:.2g} {axis_unit(AXES[worst])}'


def jump_doubts(tracker: DriftTracker) -> list[str]:
    """Say what thermometers read since the last tare that moves the zero."""
    memory_s = 0.0 if tracker.model is None else tracker.memory_s
    pairs = exchanged_thermometers.exchanged_by_jumps(tracker.spikes)
    said = [
        f'thermometers {i + 1} and {j + 1} jumped at once, one up as far as the other down; are '
        'their plugs or topics exchanged? A tare does not help: put them back, or call '
        '~/reset_tare and ~/tare where it is to stay so'
        for i, j in pairs
    ]
    for j, spikes in enumerate(tracker.spikes):
        if any(j in pair for pair in pairs):
            continue
        if spikes.jump.by_k:  # it acts for as long as it lasts, whatever the model remembers
            said.append(
                f'thermometer {j + 1} jumped by {spikes.jump.by_k:.1f} K and stayed there; is it '
                'loose? Mend it, or tare where it is to stay so'
            )
        elif spikes.jump.off_k and spikes.remembered_s(tracker.end_ns, memory_s):
            said.append(
                f'thermometer {j + 1} was off by {spikes.jump.off_k:.1f} K until it came back; '
                f'the model remembers that for {memory_s / 60:.0f} min'
            )
    return said
