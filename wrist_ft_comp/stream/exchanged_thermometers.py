"""
Pairs of thermometers that are exchanged: where their plugs, topics or columns are.

They read what is expected of each other, or jumped at once, one up as far as the other down, or
read after a gap what the other read before it. No tare mends that.
"""

from collections.abc import Collection, Sequence
from itertools import combinations

import numpy as np

from wrist_ft_comp.drift.drift_model import ThermometerPrediction
from wrist_ft_comp.series import FloatArray, NANOSECONDS
from wrist_ft_comp.stream.failed_thermometers import AGREED_S, ThermometerState
from wrist_ft_comp.stream.temperature_jumps import JUMP_K, SpikeFilter

#: Two may be exchanged where both are farther from their predictions than this many times what a
#: healthy one is.
_EXCHANGED = 2.0
#: Or where they jumped within this time, s, by the same to this share, one up and one down.
_AT_ONCE_S, _ALIKE_SHARE = 60.0, 0.25


def exchanged_by_jumps(spikes: Sequence[SpikeFilter]) -> list[tuple[int, int]]:
    """Find pairs that jumped at once, one up as far as the other down, which no tare mends."""
    pairs = []
    for (i, one), (j, other) in combinations(enumerate(spikes), 2):
        apart_ns = (one.jump.at_ns or 0) - (other.jump.at_ns or 0)
        at_once = abs(apart_ns) <= _AT_ONCE_S * NANOSECONDS
        if at_once and _are_opposite(one.jump.by_k, other.jump.by_k):
            pairs.append((i, j))
    return pairs


def _are_opposite(up_k: float, down_k: float) -> bool:
    """Whether one jumped up as far as the other down."""
    return bool(up_k and down_k and abs(up_k + down_k) < _ALIKE_SHARE * abs(up_k - down_k))


def note_exchange(
    spikes: Sequence[SpikeFilter],
    before: tuple[int, FloatArray], after: tuple[int, FloatArray],
) -> None:  # fmt: skip
    """
    Take as a jump where each of a pair reads, after a gap, what the other read before it.

    Takes when the gap began and ended, ns, and what was read then, °C, (J,). Metal had the time.
    """
    (begin_ns, before_c), (end_ns, after_c) = before, after
    for i, j in combinations(range(len(spikes)), 2):
        apart_k = abs(before_c[j] - before_c[i])
        crossed_k = np.abs(after_c[[i, j]] - before_c[[j, i]])
        if apart_k > JUMP_K and crossed_k.max() < _ALIKE_SHARE * apart_k:
            for k in (i, j):
                if (spikes[k].jump.at_ns or 0) < begin_ns:
                    spikes[k].note_jump(end_ns, float(after_c[k] - before_c[k]))


def exchanged(
    prediction: ThermometerPrediction,
    state: ThermometerState,
    known: Collection[tuple[int, int]] = (),
) -> dict[tuple[int, int], str]:
    """
    Say which pairs of thermometers read what is expected of each other, or are ``known`` to.

    Both are far from what the others predict of them, and near it if they are taken for each
    other, as where plugs were exchanged. Known ones are until it is the other way round: where
    both are near in either order, nobody can tell.
    """
    off_k, said = np.abs(state.reading_c - state.predicted_c), {}
    for i, j in combinations(range(len(off_k)), 2):
        agree_k, own_k = prediction.agree_k[[i, j]], off_k[[i, j]]
        exchanged_k = _off_exchanged(prediction, state, i, j)[[i, j]]
        is_found = (exchanged_k <= agree_k).all() and (own_k > _EXCHANGED * agree_k).all()
        is_mended = (own_k <= agree_k).all() and (exchanged_k > agree_k).all()
        if is_found or ((i, j) in known and not is_mended):
            said[i, j] = (
                f'thermometers {i + 1} and {j + 1} read what is expected of each other; are their '
                'plugs, topics or columns exchanged? The drift is wrong until that is mended'
            )
    return said


def end_exchange(
    spikes: Sequence[SpikeFilter], prediction: ThermometerPrediction | None,
    state: ThermometerState | None, now_ns: int,
) -> None:  # fmt: skip
    """
    End the jumps of a pair that was put back.

    It jumped a second time, by what they differ by then, or it reads what is expected of it, and
    would not if it were exchanged.
    """
    for i, j in exchanged_by_jumps(spikes):
        one, other = spikes[i].jump, spikes[j].jump
        steps_k = one.by_k - one.off_k, other.by_k - other.off_k
        if _are_opposite(one.off_k, other.off_k) and _are_opposite(*steps_k):
            spikes[i].jump, spikes[j].jump = one._replace(by_k=0.0), other._replace(by_k=0.0)
        elif prediction is not None and state is not None:
            near = np.abs(state.reading_c - state.predicted_c) <= prediction.agree_k
            wrong = _off_exchanged(prediction, state, i, j) > _EXCHANGED * prediction.agree_k
            lasted_ns = now_ns - (one.at_ns or 0)
            if (near & wrong)[[i, j]].all() and lasted_ns > AGREED_S * NANOSECONDS:
                spikes[i].end_jump(now_ns)
                spikes[j].end_jump(now_ns)


def _off_exchanged(
    prediction: ThermometerPrediction, state: ThermometerState, i: int, j: int
) -> FloatArray:
    """Give how far all would be from what is expected if two were exchanged, K, (J,)."""
    order = np.arange(len(state.reading_c))
    order[[i, j]] = j, i
    expected_c = prediction.predict(state.relaxed_c[:, order])
    return np.asarray(np.abs(state.reading_c[order] - expected_c))
