"""
The drift of a day before any model of it, by its slowness alone.

A running median passes slow and sudden drift, and leaves out presses of some minutes. Where it
jumps at what was taken for a step, a press that fills its window or a tare made that, and the jump
is taken out of it.
"""

import numpy as np

from wrist_ft_comp.payload.gains import axes_of
from wrist_ft_comp.payload.states import medians
from wrist_ft_comp.signals import BoolArray, FloatArray, Recording

#: Recordings that are shorter, s, do not tell what is slow in them.
SLOW_S = 7200.0
#: Length of a bin, s: drift hardly moves within one.
_BIN_S = 60.0
#: Bins of the running median on either side. In 21 minutes, with presses of up to 300 s in 15 % of
#: the time, a perfect model leaves what it leaves without presses.
_HALF_WINDOW = 10
#: Bins on either side of a step in which the median may jump by it.
_BINS_NEAR_STEP = 2
#: The median jumps where it moves by so many times what it usually does from bin to bin.
_JUMP = 6.0
#: Share of a cell's noise that is left in a median of a bin: it usually moves by at least this.
_NOISE_OF_MEDIAN = 0.3


def slow_drift(recording: Recording, separated: Recording, noise: FloatArray) -> FloatArray:
    """
    Estimate how a recording drifts, N and N m (N, 6), 0 on axes that it does not hold.

    Parameters
    ----------
    recording : Recording
        As it came.
    separated : Recording
        The same with the weight as its reference, NaN where something pushed, and the cells at
        which there may be steps.
    noise : ndarray, shape (A,)
        σ of a cell, on the axes that the recording holds, N and N m.

    """
    axes, cells = axes_of([recording]), len(recording)
    counts = np.isfinite(separated.wrench[:, axes])
    rest = np.where(counts, (recording.wrench - separated.reference)[:, axes], np.nan)
    length = max(1, round(_BIN_S / recording.period_s))
    rest = np.pad(rest, ((0, -cells % length), (0, 0)), constant_values=np.nan)
    bins = _running(rest.reshape(-1, length, len(axes)))
    moved = np.diff(bins, axis=0)
    usual = np.maximum(np.median(np.abs(moved), axis=0) / 0.67, _NOISE_OF_MEDIAN * noise)
    jumps: BoolArray = np.sqrt(np.mean((moved / usual) ** 2, axis=1)) > _JUMP
    apart = np.abs(np.arange(len(moved))[:, np.newaxis] + 1 - np.array(separated.steps) / length)
    moved[jumps & (apart <= _BINS_NEAR_STEP).any(axis=1)] = 0.0
    path = np.cumsum(np.concatenate((bins[:1], moved)), axis=0)
    middles = (np.arange(len(path)) + 0.5) * length
    drift = np.zeros_like(recording.wrench)
    for axis, values in zip(axes, path.T, strict=True):
        drift[:, axis] = np.interp(np.arange(cells) + 0.5, middles, values)
    return drift


def _running(values: FloatArray) -> FloatArray:
    """Median of the medians of bins (n, B, A) around each, (n, A); NaN does not count."""
    measured = np.isfinite(values[..., 0]).any(axis=1, keepdims=True)
    bins = np.where(measured, medians(values), np.nan)
    edges = (_HALF_WINDOW, _HALF_WINDOW), (0, 0)
    bins = np.pad(bins, edges, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(bins, 2 * _HALF_WINDOW + 1, axis=0)
    found = medians(windows.transpose(0, 2, 1))
    empty = ~np.isfinite(windows[:, 0]).any(axis=1)
    # A window without any reading says what the one before said.
    last = np.maximum.accumulate(np.where(empty, 0, np.arange(len(found))))
    return np.asarray(found[last])
