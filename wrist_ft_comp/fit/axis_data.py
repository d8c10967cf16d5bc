"""
What is fitted for one axis: drift observations of all recordings, ready for any method.

With the reference wrench w, r - w = o + s w + constant: what is left when the load is taken off.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.chamber_test import find_plateaus, MOST_PLATEAUS
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.recording import Recording, Reference
from wrist_ft_comp.series import differ, FloatArray, IntArray, noise_level

#: Candidates are fitted to sums over bins of this length, and errors are judged and stated as
#: means over it: drift hardly changes within it, s.
BIN_S = 10.0
#: In a short recording bins are shorter, so that a fold still has this many.
BINS_PER_FOLD = 8
#: Stretches that a single recording is divided into, to be held out in turn. A fit to the
#: others interpolates a short one, which says little of another day: with four instead of three,
#: 1.1 times as much drift was left there, and with two as well.
FOLDS = 3
#: Fewer cells with a wrench than this cannot be divided into folds worth holding out.
MIN_SAMPLES = FOLDS * BINS_PER_FOLD
#: The load of an axis varies enough where its deviation is this many times the noise.
MIN_LOAD_TO_NOISE = 10.0


@dataclass(frozen=True, eq=False)
class AxisData:
    """One axis over several recordings: the tuples hold an array for every recording."""

    axis: str
    #: Cell length h, s.
    period_s: float
    #: Held temperatures, °C, shape (N_i, J).
    temperature_c: tuple[FloatArray, ...]
    #: r - w, shape (N_i,); NaN where there is no sample, or where it is held out.
    residual: tuple[FloatArray, ...]
    #: w, shape (N_i,); None when sensitivity drift is not to be learnt.
    load: tuple[FloatArray, ...] | None
    #: Number of the cross-validation fold of each cell, shape (N_i,).
    folds: tuple[IntArray, ...]
    #: Cells from which on a recording has a new constant, because it may have been tared there.
    steps: tuple[tuple[int, ...], ...]
    #: Cells per bin in which candidates are fitted and judged.
    bin_cells: int
    #: Why sensitivity drift is not learnt; empty when it is.
    no_sensitivity: str = ''
    #: Whether a held-out fold has its own constant, because taring removes it. Plateaus of a
    #: chamber test keep the constant of the others: their difference is the drift.
    tared: bool = True

    @property
    def longest_s(self) -> float:
        """Duration of the longest recording, s."""
        return max(len(residual) for residual in self.residual) * self.period_s

    @property
    def bin_s(self) -> float:
        """Length of a bin, s."""
        return self.bin_cells * self.period_s

    @property
    def folds_by_recording(self) -> list[tuple[int, int]]:
        """All recordings and folds that hold samples, in order; a fold lies in one recording."""
        return [
            (i, int(number))
            for i, (folds, residual) in enumerate(zip(self.folds, self.residual, strict=True))
            for number in np.unique(folds[np.isfinite(residual)])
        ]

    @property
    def recordings(self) -> int:
        """Number of recordings with a sample."""
        return len({i for i, _ in self.folds_by_recording})

    @property
    def holds_out_days(self) -> bool:
        """Whether whole recordings are held out, and not stretches of them."""
        return len(self.folds_by_recording) == self.recordings > 1

    @property
    def samples(self) -> int:
        """Number of cells with a sample."""
        return sum(int(np.isfinite(residual).sum()) for residual in self.residual)

    def without(self, fold: int) -> 'AxisData':
        """Hold a fold out: its samples become NaN, its temperatures stay for the dynamics."""
        pairs = zip(self.folds, self.residual, strict=True)
        residual = tuple(np.where(folds == fold, np.nan, values) for folds, values in pairs)
        return replace(self, residual=residual)


def build_axis_data(
    recordings: Sequence[Recording], axis: str, reference: Reference, folds: Sequence[IntArray]
) -> AxisData:
    """
    Take the reference off one axis, which not all recordings need to have.

    The result has the reference as load where it varied enough to show sensitivity drift. Folds,
    (N_i,), are those of ``assign_folds``.
    """
    column = AXES.index(axis)
    residual = tuple(recording.wrench[:, column] for recording in recordings)
    load: tuple[FloatArray, ...] | None = None
    no_sensitivity = f'the reference was declared {reference}'
    if reference in {'recorded', 'payload'}:
        load = tuple(recording.reference[:, column] for recording in recordings)
        residual = tuple(raw - true for raw, true in zip(residual, load, strict=True))
        no_sensitivity = _why_no_sensitivity(residual, load)
    # Samples that are left out of a working day leave gaps, but no plateaus.
    return AxisData(
        axis=axis, period_s=recordings[0].period_s,
        temperature_c=tuple(recording.temperature_c for recording in recordings),
        residual=residual, load=None if no_sensitivity else load,
        folds=tuple(folds), no_sensitivity=no_sensitivity,
        steps=tuple(recording.steps for recording in recordings),
        bin_cells=bin_cells(max(map(len, residual)), recordings[0].period_s),
        tared=reference == 'payload' or find_plateaus(recordings) is None)  # fmt: skip


def _why_no_sensitivity(residual: Sequence[FloatArray], load: Sequence[FloatArray]) -> str:
    """Say why the load does not determine sensitivity drift, or nothing when it does."""
    loads = np.concatenate([w[np.isfinite(w)] for w in load])
    if not len(loads):
        return 'no reference wrench was recorded for this axis'
    # A constant gain error is taken out, so that a moving load is not mistaken for noise.
    remainders = []
    for values, of_recording in zip(residual, load, strict=True):
        both = np.isfinite(values) & np.isfinite(of_recording)
        r, w = values[both], of_recording[both]
        centred = w - w.mean() if len(w) else w
        power = float(centred @ centred)
        remainders.append(r - (float(centred @ r) / power) * w if power > 0 else r)
    deviation, noise = float(np.std(loads)), noise_level(remainders)
    rounding = 1e-9 * float(np.abs(loads).max())
    if rounding < deviation >= MIN_LOAD_TO_NOISE * noise:
        return ''
    return (
        f'its load varied by {deviation:.3g} (standard deviation), less than '
        f'{MIN_LOAD_TO_NOISE:g} times the noise of {noise:.3g}'
    )


def bin_cells(longest: int, period_s: float) -> int:
    """Count the cells of a bin, by those of the longest recording."""
    return max(min(round(BIN_S / period_s), longest // MIN_SAMPLES), 1)


def build_features(
    temperature_c: Sequence[FloatArray],
    settings: IdentificationSettings,
    residual: Sequence[FloatArray] = (),
) -> Features:
    """
    Choose reference, range and knots of features from temperatures, °C, shapes (N_i, J).

    Knots of hats stand where r - w, (N_i,), was observed, if that is given. The features are those
    of the temperatures behind one relaxation.
    """
    everything = np.concatenate(list(temperature_c))
    knots = list[FloatArray]()
    if settings.features == 'hats':
        present = np.isfinite(np.concatenate(residual)) if residual else slice(None)
        for column in everything[present].T:
            plateaus = np.unique(column)
            plateaus = plateaus[np.append(True, differ(plateaus[1:], plateaus[:-1]))]
            if len(plateaus) == 1:
                plateaus = plateaus[0] + np.array([0.0, 1.0])  # a constant needs a hat, too
            elif len(plateaus) > MOST_PLATEAUS:
                plateaus = np.linspace(plateaus[0], plateaus[-1], MOST_PLATEAUS // 2)
            knots.append(plateaus)
    return Features(
        kind=settings.features, reference_c=everything.mean(axis=0),
        lower_c=everything.min(axis=0), upper_c=everything.max(axis=0),
        degree=settings.highest_degree if settings.features == 'powers' else 1,
        knots_c=tuple(knots))  # fmt: skip
