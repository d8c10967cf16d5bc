"""
Method ``auto``: an average of many fits, weighted by what they leave of recordings held out.

All are vectors of gains on one pool of columns (``fit/column_pool.py``), and so is their
average: one model with a bank of relaxations. docs/algorithm.md says why each piece is there.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift.arx_filter import free_run
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.fit.column_pool import (
    FreeTimeConstants,
    GRID_S,
    near,
    RidgeBank,
    time_constant_errors,
)
from wrist_ft_comp.fit.cross_validation import (
    bin_means,
    day_over_blocks,
    DAY_S,
    keep_errors,
    tare,
)
from wrist_ft_comp.fit.model_building import (
    anchored,
    build_axis_model,
    build_features,
    by_relaxation,
)
from wrist_ft_comp.fit.moments import (
    accumulate,
    bin_axis_data,
    BinnedData,
    Moments,
    start_transients,
    TRANSIENT_VARIANCE,
)
from wrist_ft_comp.fit.result import AxisFit, Candidate, HeldOut, left_of_a_day
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.signals import BoolArray, FloatArray, Progress

COMBINATION = 'combination'
#: How steeply the share of a correction that is used falls as it leaves more of the drift.
_GATE = 16.0
#: An average that lowers what is left of held-out recordings by less than this share is not run.
_WORTH_RUNNING = 0.02
#: How steeply a candidate's weight falls with the logarithm of what it leaves, per fold.
_SHARPNESS = 2.0
#: Share of an axis' own errors in the evidence for its weights; the rest is that of all axes.
_OWN_SHARE = 0.75
#: What n recordings leave, by what n - 1 of them leave, is taken as 1 - 1/n to this power. So the
#: median of 1270 axes that were learnt from two to six drawn days kept 0.86 of what was expected.
_LEARNING_EXPONENT = 1 / 3
#: Below every square, so that logarithms exist.
_TINY = 1e-300
#: Errors of an axis that never changes are rounding, up to this share of its readings.
_ROUNDING = 1e-14
#: Ridge of the banks, relative to the diagonal.
_STRENGTHS = (1e-2, 1e-4, 1e-6)
_BANKS = {
    'bank to 3000 s': near(0, 30, 100, 300, 1000, 3000),
    'bank to 60 s': near(0, 20, 60),
    'bank to 600 s': near(0, 100, 600),
}
#: Candidates are compared by means over this time, or all look alike where a robot moves, s …
_COMPARED_S = 120.0
#: … but a fold has at least this many means.
_FEWEST_COMPARED = 8


class Kind(NamedTuple):
    """A kind of candidate: a name, whether every start was soaked, and how it is fitted."""

    name: str
    soaked: bool
    fit: RidgeBank | FreeTimeConstants

    @property
    def fits(self) -> int:
        """Number of fits that it gives."""
        return len(self.fit.strengths) if isinstance(self.fit, RidgeBank) else 1


def _kinds(highest: int, thermometers: int) -> list[Kind]:
    """List the kinds of candidates, with names for people."""
    kinds = []
    for degree in range(1, highest + 1):
        shape, inputs = (degree, thermometers), (degree * thermometers, thermometers)
        fits: dict[str, RidgeBank | FreeTimeConstants] = {
            'static': RidgeBank(*shape, near(0), (1e-6,)),
            '1 time constant': FreeTimeConstants(*inputs, 1),
            **{name: RidgeBank(*shape, bank, _STRENGTHS) for name, bank in _BANKS.items()},
        }
        both = [(name, soaked) for name in fits for soaked in (True, False)]
        if degree < 3:
            fits['2 time constants'] = FreeTimeConstants(*inputs, 2)
            both.append(('2 time constants', False))
        kinds += [Kind(f'{name}, degree {degree}', soaked, fits[name]) for name, soaked in both]
    return kinds


class FoldForms(NamedTuple):
    """What no compensation and C - 1 candidates, fitted to the other folds, leave of a fold."""

    recording: int
    fold: int
    #: Middle of every bin that has a sample, in cells of the recording, (n,).
    cells: FloatArray
    #: Tared, (n, C).
    left: FloatArray
    #: Mean square as a quadratic form of the candidates' weights, start set aside, (C, C).
    cleaned: FloatArray
    #: The same, tared.
    tared: FloatArray


class Axis(NamedTuple):
    """An axis of the body: its data, its bins and its moments."""

    data: AxisData
    binned: BinnedData
    moments: Moments


class Body:
    """All axes of a sensor, which share temperatures and time constants, and their candidates."""

    def __init__(self, axes: Sequence[AxisData], settings: IdentificationSettings) -> None:
        binned = [bin_axis_data(data, data.bin_cells[0]) for data in axes]
        self.bins = binned[0]
        self.features = build_features(self.bins.temperature_c, settings, beyond='tangents')
        self.kinds = _kinds(settings.highest_degree, self.features.thermometers)
        relaxations = [self.bins.relaxation(float(tau)) for tau in GRID_S]
        #: Temperatures of each recording behind every relaxation, (n_i, K, J).
        self.relaxed_c = [
            np.stack([free_run(lag, temperature_c) for lag in relaxations], axis=1)
            for temperature_c in self.bins.temperature_c
        ]
        self.inputs = [_columns(self.features, relaxed_c) for relaxed_c in self.relaxed_c]
        self.axes = [
            Axis(data, bins, accumulate(bins, self.inputs, len(GRID_S)))
            for data, bins in zip(axes, binned, strict=True)
        ]
        self.folds = np.unique(np.concatenate(self.bins.folds)).tolist()

    def errors(self, fold: int, gains: Sequence[FloatArray]) -> Iterator[FoldForms | None]:
        """
        Compute what gains of the pool, (C, P + 1) of every axis, leave of a fold.

        The features are those that a fit to the other folds would run with: their range is what
        the others saw. None where an axis has no sample.
        """
        #   [ x_f(H_τ T) … | w x_f(H_τ T) … | w | r - w ]     with load
        i = next(i for i, folds in enumerate(self.bins.folds) if (folds == fold).any())
        pairs = zip(self.bins.temperature_c, self.bins.folds, strict=True)
        others_c = np.concatenate([values_c[folds != fold] for values_c, folds in pairs])
        lower_c, upper_c = others_c.min(axis=0), others_c.max(axis=0)
        features = replace(self.features, lower_c=lower_c, upper_c=upper_c)
        inside = self.bins.folds[i] == fold
        of_fold = _columns(features, self.relaxed_c[i][inside])
        for axis, of_axis in zip(self.axes, gains, strict=True):
            sums = axis.binned.sums[i]
            rows = inside & (sums.count > 0)
            if not rows.any():
                yield None
                continue
            count = sums.count[rows, np.newaxis]
            w, y = sums.load[rows, np.newaxis] / count, sums.residual[rows, np.newaxis] / count
            x = of_fold[rows[inside]]
            load = (w * x, w) if axis.binned.loaded else ()
            left = np.concatenate((x, *load, y), axis=1) @ of_axis.T
            tared = tare(left, self.bins.period_s)
            middle = (np.flatnonzero(rows) + 0.5) * self.bins.cells - 0.5
            yield FoldForms(
                i, fold, np.minimum(middle, len(axis.data.residual[i]) - 1), tared,
                _cleaned_form(left, self.bins.period_s), _form(tared))  # fmt: skip

    def fit(
        self, skip: int | None, starts: Mapping[Kind, FloatArray]
    ) -> tuple[list[FloatArray], dict[Kind, FloatArray]]:
        """
        Fit all candidates to all folds but one: gains of the pool for every axis.

        Gains have shape (C, P + 1), -1 for r - w; the first row is no compensation. With them come
        the free ln τ by kind; their searches begin at ``starts``, or else on the grid.
        """
        moments = [axis.moments for axis in self.axes]
        normals = {}
        for soaked in (True, False):
            precision = self.bins.nuisance_precision(soaked=soaked)
            normals[soaked] = [
                replace(sums, precision=precision).centred(sums.fold != skip) for sums in moments
            ]
        gains = [[np.append(np.zeros(len(n) - 1), -1.0)[np.newaxis]] for n in normals[True]]
        logs = {}
        for kind in self.kinds:
            pairs = list(zip(moments, normals[kind.soaked], strict=True))
            if isinstance(kind.fit, RidgeBank):
                fits = [kind.fit.fit(*pair) for pair in pairs]
            else:
                both = moments, normals[kind.soaked]
                start = starts[kind] if kind in starts else kind.fit.first_guess(*both)
                logs[kind] = kind.fit.search(*both, start)
                fits = [kind.fit.fit(*pair, logs[kind]) for pair in pairs]
            for of_axis, fit in zip(gains, fits, strict=True):
                of_axis.append(fit)
        return [np.concatenate(of_axis) for of_axis in gains], logs


def _columns(features: Features, relaxed_c: FloatArray) -> FloatArray:
    """Compute the pool's columns, without load, of relaxed temperatures (n, K, J): (n, K·F)."""
    return features.expand(relaxed_c).reshape(len(relaxed_c), -1)


def _form(left: FloatArray) -> FloatArray:
    """Mean square of an average of errors, (n, C), as a quadratic form of its weights."""
    return np.asarray(left.T @ left / len(left))


def _cleaned_form(left: FloatArray, period_s: float) -> FloatArray:
    """Mean square around a constant and a start transient, of means that noise says little in."""
    time_s = np.arange(len(left)) * period_s
    phi = np.concatenate((np.ones((len(left), 1)), start_transients(time_s)), axis=1)
    precision = np.full(phi.shape[1], len(left) / TRANSIENT_VARIANCE)
    precision[0] = 0.0
    level = np.linalg.solve(phi.T @ phi + np.diag(precision), phi.T @ left)
    rest = left - phi @ level
    width = max(1, min(round(_COMPARED_S / period_s), len(rest) // _FEWEST_COMPARED))
    prior = level.T @ (precision[:, np.newaxis] * level) / len(left)
    return np.asarray(_form(bin_means(rest, np.arange(len(rest)), width)) + prior)


def identify_together(
    axes: Sequence[AxisData], settings: IdentificationSettings, progress: Progress = lambda _: None
) -> list[AxisFit]:
    """Learn the drift of all axes of a sensor from many fits, each as far as it holds unseen."""
    body = Body(axes, settings)
    gains, logs = body.fit(None, {})
    errors: list[list[FoldForms]] = [[] for _ in axes]
    held_out_logs = []
    for number, fold in enumerate(body.folds, 1):
        held_out, fold_logs = body.fit(fold, logs)
        held_out_logs.append(fold_logs)
        for of_axis, found in zip(errors, body.errors(fold, held_out), strict=True):
            if found is not None:
                of_axis.append(found)
        progress(number / len(body.folds))
    cleaned, tared = (
        [np.stack([getattr(of_fold, form) for of_fold in of_axis]) for of_axis in errors]
        for form in ('cleaned', 'tared')
    )
    weights = [_if_worthwhile(*pair) for pair in zip(_weigh(cleaned), tared, strict=True)]
    return [
        replace(
            _axis_fit(body, axis, weights[n], tared[n], (logs, *held_out_logs)),
            model=_model(body, axis, weights[n] @ gains[n]) if weights[n][0] < 1 else None,
            held_out=_held_out(errors[n], weights[n], body.bins.period_s),
        )
        for n, axis in enumerate(body.axes)
    ]


def _root_mean_squares(weights: FloatArray, forms: FloatArray) -> FloatArray:
    """Sum up what a weighted average, (C,), leaves of every fold, (folds,)."""
    squares = np.einsum('i,fij,j->f', weights, forms, weights)
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def _weigh(errors: Sequence[FloatArray]) -> list[FloatArray]:
    """
    Weigh no compensation and all candidates by their forms, (folds, C, C), of every axis: (C,).

    The evidence is in part that of all axes, as their body is one. The mean of a logarithm over
    folds and axes is a geometric mean of errors: no day and no axis outvotes the others.
    """
    logs = np.array(
        [np.log(np.maximum(np.einsum('fii->fi', form), _TINY)).mean(axis=0) / 2 for form in errors]
    )
    left = logs - logs[:, :1]
    left = _OWN_SHARE * left + (1 - _OWN_SHARE) * left.mean(axis=0)
    steps = _SHARPNESS * max(len(form) for form in errors)
    weights = np.exp(-steps * (left - left[:, 1:].min(axis=1, keepdims=True)))
    weights[:, 0] = 0.0
    weights /= weights.sum(axis=1, keepdims=True)
    after = [_root_mean_squares(*pair) for pair in zip(weights, errors, strict=True)]
    gained = [np.log(np.maximum(rms, np.sqrt(_TINY))).mean() for rms in after] - logs[:, 0]
    use = (_gate(gained) * _gate(gained.mean()))[:, np.newaxis]
    return list(use * weights + (1 - use) * np.eye(weights.shape[1])[0])


def _expected(weights: FloatArray, tared: FloatArray, recordings: int) -> float:
    """
    Root mean square that a weighted average, (C,), is expected to leave of another day.

    Half of the candidates' spread around the average is added, because what they disagree about is
    not known. Of several recordings each counts by how much it drifts uncompensated, because
    another day may be like the one that drifted most; and what is learnt from all of them leaves
    less than what each was held out from. Blocks of a single recording count alike.
    """
    average = _root_mean_squares(weights, tared) ** 2
    left = (average + np.einsum('i,fii->f', weights, tared)) / 2
    if recordings == 1:
        return float(np.sqrt(np.mean(left)))
    drift = tared[:, 0, 0] + _TINY
    learnt_more = (1 - 1 / len(left)) ** _LEARNING_EXPONENT
    return float(learnt_more * np.sqrt(np.average(left, weights=drift)))


def _if_worthwhile(weights: FloatArray, tared: FloatArray) -> FloatArray:
    """Run no average that leaves hardly less than no compensation in the mean over folds."""
    none: FloatArray = np.eye(len(weights))[0]
    after, before = (_root_mean_squares(used, tared).mean() for used in (weights, none))
    return weights if after < (1 - _WORTH_RUNNING) * before else none


def _gate(gained: FloatArray) -> FloatArray:
    """Share of a correction that is used: half where it gains nothing, all where it gains much."""
    return np.asarray(1 / (1 + np.exp(np.clip(_GATE * gained, -500, 500))))


def _held_out(errors: Sequence[FoldForms], weights: FloatArray, period_s: float) -> HeldOut:
    """Keep an axis' errors on every fold, without compensation and of the average."""
    parts = [
        np.stack(
            (
                np.full(len(of_fold.cells), of_fold.recording),
                np.full(len(of_fold.cells), of_fold.fold),
                of_fold.cells,
                -of_fold.left[:, 0],
                -of_fold.left @ weights,
            )
        )
        for of_fold in errors
    ]
    return keep_errors(np.concatenate(parts, axis=1), period_s, tared=True)


def _axis_fit(
    body: Body,
    axis: Axis,
    weights: FloatArray,
    tared: FloatArray,
    logs: Sequence[Mapping[Kind, FloatArray]],
) -> AxisFit:
    """Turn the weights of an axis into its evidence; ln τ of all folds, then without each."""
    data = axis.data
    owners = [kind for kind in body.kinds for _ in range(kind.fits)]

    def state(name: str, members: BoolArray) -> Candidate:
        """State what some candidates leave together, weighted as they run."""
        total = float(weights[members].sum())
        inside = np.where(members, weights if total > 0 else 1.0, 0.0)
        after = float(_root_mean_squares(inside / inside.sum(), tared).mean())
        rms = left_of_a_day(after, before, factor)
        return Candidate(name, rms if rms > rounding else 0.0, total)

    rounding = _ROUNDING * max(np.fmax.reduce(np.abs(r), initial=0.0) for r in data.residual)
    before = float(np.sqrt(tared[:, 0, 0]).mean())
    factor = day_over_blocks(axis.binned, before)
    positions = np.arange(len(weights))
    none = state('none', positions == 0)
    used = 1 - float(weights[0])
    after = state(COMBINATION, positions >= 0) if used else none
    names = np.array(['none', *(kind.name for kind in owners)])
    candidates = [state(name, names == name) for name in dict.fromkeys(names[1:].tolist())]
    shares = {candidate.name: candidate.weight for candidate in candidates}
    free = list(logs[0])
    tau_s, tau_errors_s = np.zeros((2, 0))
    if sum(shares[name] for name in {kind.name for kind in free}) > used / 2:
        heaviest_kind = max(free, key=lambda kind: shares[kind.name])
        tau_s, *held_out_s = (np.exp(np.sort(found[heaviest_kind])) for found in logs)
        tau_errors_s = time_constant_errors(tau_s, held_out_s)
    heaviest = sorted(candidates, key=lambda candidate: -candidate.weight)[:2]
    reason = (
        f'An average of {len(owners)} fits leaves {after.rms:.3g} {data.unit} RMS on held-out '
        f'data, no compensation {none.rms:.3g} {data.unit}; most weight have '
        + ' and '.join(f'{top.name} ({100 * top.weight / used:.0f} %)' for top in heaviest)
        + f', and {100 * used:.0f} % of the correction is used.'
        if used
        else f'Nothing that was tried holds on held-out data: no compensation leaves '
        f'{none.rms:.3g} {data.unit} RMS.'
    )
    return AxisFit(
        model=None, chosen=COMBINATION if used else 'none', candidates=(none, *candidates),
        rms_before=none.rms, rms_after=after.rms,
        notes=(f'zero drift only: {data.no_sensitivity}',) if data.no_sensitivity else (),
        reason=reason, time_constants_s=tuple(tau_s.tolist()),
        time_constant_errors_s=tuple(tau_errors_s.tolist()), unit=data.unit,
        expected_rms=day_over_blocks(axis.binned, before, DAY_S)
        * _expected(weights, tared, len(axis.binned.sums)) if after.rms else 0.0)  # fmt: skip


def _model(body: Body, axis: Axis, gains: FloatArray) -> AxisModel | None:
    """Write gains of the pool, (P + 1,), as a model whose zero drift is none at rest at T_ref."""
    shape, period_s = (len(GRID_S), axis.moments.inputs), body.bins.period_s / body.bins.cells
    by_tau = by_relaxation(gains[:-1], *shape, loaded=axis.binned.loaded)
    model = build_axis_model(body.features, GRID_S, by_tau, body.inputs, period_s)
    if model is None:
        return None
    at_rest = [0.0, float(gains[-2])] if axis.binned.loaded else [0.0]
    return anchored(model, at_rest)
