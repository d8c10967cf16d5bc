"""
Taring: a mean raw wrench over some time, refused while the load moves.

What a tare holds beside the load, because of the drift, is said here, too.
"""

from collections.abc import Collection, Iterator, Sequence
from itertools import compress
import math

import numpy as np

from wrist_ft_comp.channels import AXES, axis_unit
from wrist_ft_comp.drift.drift_model import Drift, DriftModel
from wrist_ft_comp.errors import RecordingError, TareRefusedError
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray, NANOSECONDS
from wrist_ft_comp.stream.drift_limits import axis_limits
from wrist_ft_comp.stream.drift_of_recordings import streamed_drift
from wrist_ft_comp.stream.drift_tracker import DriftTracker
from wrist_ft_comp.stream.wrench_faults import LIVELY_SHARE

#: Parts whose means are compared with the whole: noise averages out, motion does not.
_PARTS = 5
#: A step between two stamps counts for this share of the duration at most: a clock that leaps, or
#: a sensor that was silent, is no time of taring. A tare has at least as many steps as that takes.
_LONGEST_STEP_SHARE = 0.1
#: A tare holds what drifted between it and the first temperature; said from this time on, s.
_LATE_TEMPERATURE_S = 30.0


class TareCollector:
    """
    Collects raw wrenches over a stretch of stamps.

    The mean of any fifth of the samples, in the order in which they came, may be at most
    max_deviation_n off the whole mean, N; of a torque, a tenth of the number in N m.
    """

    def __init__(self, duration_s: float, max_deviation_n: float) -> None:
        self._duration_ns = round(duration_s * NANOSECONDS)
        self._longest_step_ns = math.ceil(_LONGEST_STEP_SHARE * self._duration_ns)
        #: How long the collected wrenches lasted, ns.
        self.lasted_ns = 0
        self._limits = axis_limits(max_deviation_n)
        self._stamps_ns: list[int] = []
        self._wrenches: list[Sequence[float]] = []

    def add(self, stamp_ns: int, raw: Sequence[float]) -> bool:
        """Add a raw wrench; True when the time is over."""
        if self._stamps_ns:
            step_ns = stamp_ns - self._stamps_ns[-1]
            self.lasted_ns += max(0, min(step_ns, self._longest_step_ns))
        self._stamps_ns.append(stamp_ns)
        self._wrenches.append(raw)
        return self.lasted_ns >= self._duration_ns

    def dead(self, known: Collection[str]) -> list[str]:
        """
        List the axes that read the same to the last bit, as those of a sensor that is not up do.

        Not those whose steps are coarse, as of the other forces, or torques, that live; nor those
        that read 0, as absent ones do, unless a model knows them (``known``).
        """
        wrenches = np.array(self._wrenches)
        changes = np.mean(np.nan_to_num(np.diff(wrenches, axis=0)) != 0, axis=0)
        stands = (changes == 0) & np.isfinite(wrenches[0])
        others_live = (changes > LIVELY_SHARE).reshape(2, 3).any(axis=1).repeat(3)
        is_odd = np.where(wrenches[0] == 0, np.isin(AXES, list(known)), others_live)
        return list(compress(AXES, stands & (is_odd | ~changes.any())))

    def result(self) -> tuple[FloatArray, int]:
        """
        Average what was collected: raw wrench, N and N m, (6,), and the stamp of its middle, ns.

        An axis that the sensor has not, NaN in every wrench, stays NaN.

        TareRefusedError when the time is not over, the wrenches are not finite, or the load moved.
        """
        if self.lasted_ns < self._duration_ns:
            raise TareRefusedError(
                f'The tare was to last {self._duration_ns / NANOSECONDS:g} s by the stamps of the '
                f'wrench (tare.duration); {len(self._wrenches)} wrenches came, of '
                f'{self.lasted_ns / NANOSECONDS:.3g} s. Look at the status input, and call '
                'again.'
            )
        wrenches = np.array(self._wrenches)
        with np.errstate(all='ignore'):
            mean: FloatArray = wrenches.mean(axis=0)
        absent = np.isnan(wrenches).all(axis=0)
        if absent.all() or not np.isfinite(mean[~absent]).all():
            raise TareRefusedError(
                'Taring needs finite wrenches; got NaN or infinity. Check the sensor.'
            )
        # Every other one, too: two sensors may come by turns.
        parts = *np.array_split(wrenches, _PARTS), wrenches[::2], wrenches[1::2]
        means = np.stack([part.mean(axis=0) for part in parts])
        deviation = np.nan_to_num(np.max(np.abs(means - mean), axis=0))
        worst = int(np.argmax(deviation / self._limits))
        if deviation[worst] > self._limits[worst]:
            unit = axis_unit(AXES[worst])
            raise TareRefusedError(
                f'{AXES[worst]} moved by {deviation[worst]:.3g} {unit} while taring; at most '
                f'{self._limits[worst]:.3g} {unit} are allowed (tare.max_deviation). '
                'Hold the robot still and call again.'
            )
        return mean, (self._stamps_ns[0] + self._stamps_ns[-1]) // 2


def initial_tare(model: DriftModel, recording: Recording, tare_s: float) -> FloatArray:
    """Tare on the first, unloaded seconds of each axis, N and N m, (6,); 0 s gives no tare."""
    if tare_s == 0:
        return np.zeros(len(AXES))
    return tare_at_start(recording, 0.0, streamed_drift(model, recording), tare_s)


def tare_at_start(
    recording: Recording, true: FloatArray | float, drift: Drift, tare_s: float
) -> FloatArray:
    """
    Tare as a robot does under the load w: r - o - (1 + s) w, shape (6,).

    It takes the first cell at least. RecordingError when the recording is shorter than the tare.
    """
    if tare_s > max(recording.duration_s, recording.period_s):
        raise RecordingError(
            f'{recording.name} lasts {recording.duration_s:.4g} s, which is shorter than the tare '
            f'of {tare_s:g} s. Give a shorter --tare, or a longer recording.'
        )
    offset = recording.wrench - drift.zero - (1.0 + drift.sensitivity) * true
    tare = np.zeros(len(AXES))
    for column, values in enumerate(offset.T):
        cells = np.flatnonzero(np.isfinite(values))
        if len(cells):
            tared = (cells - cells[0]) * recording.period_s < max(tare_s, recording.period_s)
            tare[column] = values[cells[tared]].mean()
    return tare


def usual_silences_ns(tracker: DriftTracker) -> list[int]:
    """Give how long a living thermometer may be silent, ns, for each."""
    grid, least_ns = tracker.grid, round(_LATE_TEMPERATURE_S * NANOSECONDS)
    # Of one that has reported few times only temperature_timeout is known.
    unknown = max(round(tracker.patience_s * NANOSECONDS / 2) // grid.period_ns, 1)
    spacings = (grid.spacing(j, unknown) for j in range(len(tracker.spikes)))
    return [max(least_ns, 2 * grid.period_ns * spacing) for spacing in spacings]


def tare_doubts(tracker: DriftTracker, *, has_drift: bool) -> Iterator[str]:
    """Say what a tare that is taken now will hold; without a drift it takes that up later."""
    grid, usual_ns = tracker.grid, usual_silences_ns(tracker)
    silent = grid.silent(tracker.end_ns // grid.period_ns) if has_drift else ()
    for j, cells in enumerate(silent):
        if cells * grid.period_ns > usual_ns[j] and j not in tracker.replaced:
            yield (
                f'the tare was taken while thermometer {j + 1} was silent, and holds what '
                'drifted since; call ~/tare when it reports'
            )
    memory_s = 0.0 if tracker.model is None else tracker.memory_s
    for j, spikes in enumerate(tracker.spikes, start=1):
        if wait_s := spikes.remembered_s(tracker.end_ns, memory_s):
            yield (
                f'the tare was taken while the model remembers that thermometer {j} jumped; '
                f'tare again in {wait_s / 60:.0f} min'
            )


def early_tare_doubts(since_ns: float, begun_ns: int, because: str) -> Iterator[str]:
    """Say that a tare, which keeps the output now that the drift begins, was taken before."""
    late_s = (begun_ns - since_ns) / NANOSECONDS
    if late_s > _LATE_TEMPERATURE_S:
        before = 'some time' if math.isinf(late_s) else f'{late_s:.0f} s'
        yield (
            f'the tare was taken {before} before the {because}, and holds what drifted since; '
            'call ~/tare'
        )
