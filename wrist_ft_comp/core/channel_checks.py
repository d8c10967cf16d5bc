"""
Channels that do not measure: stuck, dead, silent, or saying what another one says.

A channel that normally changes from cell to cell and then keeps one value to the last bit has
stopped measuring: frozen, or at the end of its range. Coarse channels, which keep a value for long
by nature, cannot be judged so.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp import CalibrationRefusedError
from wrist_ft_comp.core.problem import has_plateaus
from wrist_ft_comp.core.recording import AXES, BoolArray, FloatArray, Recording

#: A channel is lively when so many of its neighbouring cells differ …
_LIVELY = 0.9
#: … and then stuck when it keeps a value for so many cells.
_STUCK_CELLS = 30
#: Stuck cells up to this share are left out; with more, the recording is refused.
_STUCK_SHARE = 0.05
#: Thermometers say the same when one leaves less than this share of another unexplained.
_SAME = 0.03


@dataclass(frozen=True)
class _Stuck:
    """Cells in which an axis of a recording keeps one value."""

    cells: BoolArray
    value: float
    extreme: bool


def drop_stuck_cells(
    recordings: Sequence[Recording], axes: Sequence[str]
) -> tuple[list[Recording], list[str]]:
    """
    Leave out cells in which the raw wrench is stuck.

    Parameters
    ----------
    recordings : sequence of Recording
        Those of one calibration.
    axes : sequence of str
        Axes that are calibrated.

    Returns
    -------
    tuple of list of Recording and list of str
        Recordings with NaN in such cells, and what was left out, in sentences.

    Raises
    ------
    CalibrationRefusedError
        When an axis is stuck for more than a twentieth of a recording, or all axes are dead.

    """
    sound = list(recordings)
    said: list[str] = []
    dead = [axis for axis in axes if _is_dead(recordings, AXES.index(axis))]
    if len(dead) == len(axes):
        names = ', '.join(recording.name for recording in recordings)
        raise CalibrationRefusedError(
            f'Every axis of {names} keeps one value throughout, which no sensor does that '
            'measures. Check that the sensor streams, and record again.'
        )
    for axis in axes:
        column = AXES.index(axis)
        if axis in dead:
            value = _present(recordings[0].wrench[:, column])[:1]
            said.append(
                f'{axis} reads {float(value[0]) if len(value) else 0.0:.6g} '
                f'{recordings[0].unit_of(axis)} throughout: the channel is dead, or not '
                'connected. It is left uncompensated.'
            )
            continue
        lively = any(_liveliness(each.wrench[:, column]) >= _LIVELY for each in recordings)
        for i, recording in enumerate(sound):
            stuck = _find_stuck(recording.wrench[:, column]) if lively else None
            if stuck is None:
                continue
            said.append(_describe_stuck(recording, axis, stuck))
            wrench = recording.wrench.copy()
            wrench[stuck.cells, column] = np.nan
            sound[i] = replace(recording, wrench=wrench)
    return sound, said


def _present(values: FloatArray) -> FloatArray:
    """Take the finite values."""
    finite: FloatArray = values[np.isfinite(values)]
    return finite


def _liveliness(values: FloatArray) -> float:
    """Share of neighbouring samples that differ; 0 with fewer than two."""
    steps = np.diff(_present(values))
    return float(np.mean(steps != 0)) if len(steps) else 0.0


def _is_dead(recordings: Sequence[Recording], column: int) -> bool:
    """Tell whether an axis never changes in any recording."""
    series = [_present(recording.wrench[:, column]) for recording in recordings]
    return all((values == values[0]).all() for values in series if len(values))


def _find_stuck(values: FloatArray) -> _Stuck | None:
    """Find the cells of all long runs of one value; None when there is none."""
    at = np.flatnonzero(np.isfinite(values))
    if len(at) < _STUCK_CELLS:
        return None
    kept = values[at]
    starts = np.flatnonzero(np.concatenate(([True], np.diff(kept) != 0)))
    lengths = np.diff(starts, append=len(kept))
    long = lengths >= _STUCK_CELLS
    if not long.any():
        return None
    cells = np.zeros(len(values), dtype=bool)
    cells[at[np.repeat(long, lengths)]] = True
    longest = float(kept[starts[int(np.argmax(lengths))]])
    return _Stuck(cells, longest, longest in {float(kept.min()), float(kept.max())})


def _describe_stuck(recording: Recording, axis: str, stuck: _Stuck) -> str:
    """Say what was left out, or refuse."""
    count = int(stuck.cells.sum())
    share = count / int(np.isfinite(recording.wrench[:, AXES.index(axis)]).sum())
    first_s = int(np.argmax(stuck.cells)) * recording.period_s
    what = (
        f'{axis} of {recording.name} {"saturates" if stuck.extreme else "freezes"} at '
        f'{stuck.value:.6g} {recording.unit_of(axis)}: {count * recording.period_s:.0f} s '
        f'({100 * share:.1f} %) without any change, first after {first_s:.0f} s'
    )
    if share > _STUCK_SHARE:
        raise CalibrationRefusedError(
            f'{what}; up to {100 * _STUCK_SHARE:.0f} % can be left out. Check the range and the '
            'driver of the sensor, and record again.'
        )
    return f'{what}; left out.'


def silent_stretches(recordings: Sequence[Recording], max_gap_s: float) -> list[str]:
    """
    Name thermometers and wrenches that are silent for long.

    Parameters
    ----------
    recordings : sequence of Recording
        Those of one calibration; a chamber test's plateaus are apart by nature.
    max_gap_s : float
        Longer silence is named, s.

    Returns
    -------
    list of str
        Sentences.

    """
    said = []
    for recording in recordings:
        for j in range(recording.thermometers):
            gap_s = _longest_gap(recording.measured[:, j]) * recording.period_s
            if gap_s > max_gap_s:
                said.append(
                    f'Thermometer {j + 1} of {recording.name} is silent for {gap_s:.0f} s; its '
                    'last value was held.'
                )
        gap_s = (
            _longest_gap(np.any(np.isfinite(recording.wrench), axis=1, keepdims=True)[:, 0])
            * recording.period_s
        )
        if gap_s > max_gap_s and not has_plateaus(recordings):
            said.append(
                f'The raw wrench of {recording.name} is missing for {gap_s:.0f} s; the drift of '
                'that time was not learnt.'
            )
    return said


def idle_thermometers(recordings: Sequence[Recording]) -> list[str]:
    """
    Name thermometers that tell the fit nothing of their own.

    Parameters
    ----------
    recordings : sequence of Recording
        Those of one calibration.

    Returns
    -------
    list of str
        Sentences.

    """
    centred = np.concatenate([r.temperature_c - r.temperature_c.mean(axis=0) for r in recordings])
    deviation = centred.std(axis=0)
    said = [
        f'Thermometer {j + 1} reads {recordings[0].temperature_c[0, j]:.1f} °C throughout; it '
        'tells nothing. Check its topic.'
        for j in np.flatnonzero(deviation == 0)
    ]
    moving = np.flatnonzero(deviation > 0)
    for n, j in enumerate(moving):
        for k in moving[:n]:
            slope = float(centred[:, k] @ centred[:, j] / (centred[:, k] @ centred[:, k]))
            apart_k = float(np.std(centred[:, j] - slope * centred[:, k]))
            if apart_k < _SAME * deviation[j]:
                said.append(
                    f'Thermometers {k + 1} and {j + 1} say the same: apart from a factor and a '
                    f'constant they differ by {apart_k:.2g} K, while they move by '
                    f'{deviation[j]:.2g} K (standard deviations). A second thermometer helps '
                    'where it sees another source of heat.'
                )
    return said


def _longest_gap(measured: BoolArray) -> int:
    """Longest run of False, in cells."""
    edges = np.flatnonzero(np.diff(np.concatenate(([True], measured, [True])).astype(int)))
    return int(np.max(edges[1::2] - edges[::2], initial=0))
