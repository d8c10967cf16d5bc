"""
A first estimate of a day's drift, before there is a model of it: what is slow is drift.

A running median follows slow and sudden drift, but no press of a few minutes. Steps that the
separation found are taken out before. Where the median still jumps, a step that contacts hid or a
press as long as the window made the jump, and the jump is taken out: heat has a tail.
"""

import numpy as np

from wrist_ft_comp.payload.gains import axes_of
from wrist_ft_comp.payload.states import medians
from wrist_ft_comp.signals import FloatArray, Recording

#: A shorter recording, s, does not show which changes are slow.
SLOW_S = 7200.0
#: Length of a bin, s; drift hardly moves within one.
_BIN_S = 60.0
#: Bins of the running median on either side. With this window of 21 minutes, presses of up to
#: 300 s in 15 % of the time do no harm: a perfect model leaves as much as without presses.
_HALF_WINDOW_BINS = 10
#: A bin counts where a larger share of its cells is free of contact: a few may be of a long press
#: that looks like drift.
_LEAST_FREE_SHARE = 0.2
#: The median jumps where it moves by more than this many times its usual change per bin, ...
_JUMP_RATIO = 6.0
#: ... and by more than this many times its change _TAIL_BINS earlier and later. At a ratio of 6, a
#: drift of 200 N lost 80 N.
_TAIL_RATIO = 12.0
#: Heat with a time constant of 100 s or more still moves the median after this many bins, and a
#: jump that a contact prolongs has ended.
_TAIL_BINS = 3
#: The usual change per bin is at least this share of a cell's noise, which a median leaves.
_NOISE_OF_MEDIAN = 0.3


def slow_drift(recording: Recording, separated: Recording, noise: FloatArray) -> FloatArray:
    """
    Estimate how a recording drifts, N and N m, (N, 6); 0 on axes that it does not hold.

    ``separated`` is the same recording with the weight as its reference, NaN in contact, without
    the steps that were found. ``noise``, (A,), is the standard deviation of a cell on the axes
    that the recording holds.
    """
    axes, cells = axes_of([recording]), len(recording)
    residual = (separated.wrench - separated.reference)[:, axes]
    length = max(1, round(_BIN_S / recording.period_s))
    residual = np.pad(residual, ((0, -cells % length), (0, 0)), constant_values=np.nan)
    bins = _running_medians(residual.reshape(-1, length, len(axes)))
    changes = np.diff(bins, axis=0)
    usual = np.maximum(np.median(np.abs(changes), axis=0) / 0.67, _NOISE_OF_MEDIAN * noise)
    size = np.sqrt(np.mean((changes / usual) ** 2, axis=1))
    beside = np.pad(size, _TAIL_BINS, mode='edge')
    tail = np.maximum(beside[: -2 * _TAIL_BINS], beside[2 * _TAIL_BINS :])
    changes[size > np.maximum(_TAIL_RATIO * tail, _JUMP_RATIO)] = 0.0
    path = np.cumsum(np.concatenate((bins[:1], changes)), axis=0)
    middles = (np.arange(len(path)) + 0.5) * length
    drift = np.zeros_like(recording.wrench)
    for axis, values in zip(axes, path.T, strict=True):
        drift[:, axis] = np.interp(np.arange(cells) + 0.5, middles, values)
    return drift


def _running_medians(values: FloatArray) -> FloatArray:
    """Compute medians over windows of the medians of bins, (n, B, A): (n, A), NaN left out."""
    measured = np.isfinite(values[..., 0]).mean(axis=1, keepdims=True) > _LEAST_FREE_SHARE
    bins = np.where(measured, medians(values), np.nan)
    edges = (_HALF_WINDOW_BINS, _HALF_WINDOW_BINS), (0, 0)
    bins = np.pad(bins, edges, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(bins, 2 * _HALF_WINDOW_BINS + 1, axis=0)
    running = medians(windows.transpose(0, 2, 1))
    empty = ~np.isfinite(windows[:, 0]).any(axis=1)
    # A window without any reading repeats the one before.
    last = np.maximum.accumulate(np.where(empty, 0, np.arange(len(running))))
    return np.asarray(running[last])
