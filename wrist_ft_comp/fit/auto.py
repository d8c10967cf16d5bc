"""
Method ``auto``: an average of many fits, weighted by what they leave of recordings held out.

All are vectors of gains on one pool of columns (``fit/pool.py``), and so is their
average: one model with a bank of relaxations. docs/algorithm.md says why each piece is there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.fit.bins import tare
from wrist_ft_comp.fit.candidate_fits import Axis, Body, HeldOutForms, Kind
from wrist_ft_comp.fit.cross_validation import day_over_blocks, keep_errors
from wrist_ft_comp.fit.gains import anchored, build_axis_model, by_relaxation
from wrist_ft_comp.fit.pool import GRID_S
from wrist_ft_comp.fit.result import AxisFit, Candidate, HeldOut, left_of_a_day
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.signals import BoolArray, FloatArray, Progress

_GATE = 16.0
#: An average that lowers what is left of held-out recordings by less than this share is not run.
_WORTH_RUNNING = 0.02
#: A relaxation that is a mixture of the pool's has its time constant up to this share.
_MIXED = 0.005
_TINY = 1e-300
#: What is told of an axis that never changes is rounding, up to this share of its readings.
_ROUNDING = 1e-14
COMBINATION = 'combination'


def identify_together(
    axes: Sequence[AxisData], settings: IdentificationSettings, progress: Progress = lambda _: None
) -> list[AxisFit]:
    """Learn the drift of all axes of a sensor from many fits, each as far as it holds unseen."""
    body = Body(axes, settings)
    gains, logs = body.fit(None, {})
    held_out: dict[int, list[FloatArray]] = {}
    held_out_logs = []
    for number, fold in enumerate(body.folds, 1):
        held_out[fold], found = body.fit(fold, logs)
        held_out_logs.append(found)
        progress(number / len(body.folds))
    errors = [_candidate_errors(axis, n, held_out) for n, axis in enumerate(body.axes)]
    days = len(body.relaxed_c)
    weights = [
        _if_worthwhile(own, each.tared)
        for own, each in zip(_weigh([each.cleaned for each in errors], days), errors, strict=True)
    ]
    after = _held_out_errors(body, weights, held_out)
    lags = _Lags(logs, held_out_logs)
    return [
        replace(
            _axis_fit(body, axis, weights[n], errors[n].tared, lags),
            model=_model(body, axis, weights[n] @ gains[n]) if weights[n][0] < 1 else None,
            held_out=after[n],
        )
        for n, axis in enumerate(body.axes)
    ]


def _candidate_errors(
    axis: Axis, number: int, held_out: Mapping[int, Sequence[FloatArray]]
) -> HeldOutForms:
    """Turn the forms of an axis into those of weights of candidates, (folds, C, C)."""
    parts = [
        [held_out[fold][number] @ form @ held_out[fold][number].T for form in forms]
        for fold, forms in axis.forms.items()
    ]
    return HeldOutForms(*(np.stack(part) for part in zip(*parts, strict=True)))


def _root_mean_squares(weights: FloatArray, forms: FloatArray) -> FloatArray:
    """Sum up what a weighted average, (C,), leaves of every fold, (folds,)."""
    squares = np.einsum('i,fij,j->f', weights, forms, weights)
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def _weigh(errors: Sequence[FloatArray], days: int) -> list[FloatArray]:
    """Weigh none and all candidates by their held-out forms of every axis, (folds, C, C)."""
    # Weights are common to all axes, as their body is; how much is used is not. A logarithm's mean
    # over folds and axes is a geometric mean of errors: no day and no axis outvotes the others.
    logs = np.array(
        [np.log(np.maximum(np.einsum('fii->fi', each), _TINY)).mean(axis=0) / 2 for each in errors]
    )
    left = (logs - logs[:, :1]).mean(axis=0)
    folds = max(len(each) for each in errors)
    common = np.exp(-(2 * folds if days > 1 else folds) * (left - left[1:].min()))
    common[0] = 0.0
    common /= common.sum()
    none: FloatArray = np.eye(len(common))[0]
    after, before = (
        [np.maximum(_root_mean_squares(weights, each), np.sqrt(_TINY)) for each in errors]
        for weights in (common, none)
    )
    gained = np.array([np.mean(np.log(a / b)) for a, b in zip(after, before, strict=True)])
    use = _gate(gained) * _gate(gained.mean())
    return [share * common + (1 - share) * none for share in use]


def _if_worthwhile(weights: FloatArray, tared: FloatArray) -> FloatArray:
    """Use nothing of what leaves hardly less than no compensation in the mean over folds."""
    none: FloatArray = np.eye(len(weights))[0]
    after, before = (_root_mean_squares(each, tared).mean() for each in (weights, none))
    return weights if after < (1 - _WORTH_RUNNING) * before else none


def _gate(gained: FloatArray) -> FloatArray:
    """Share of a correction that is used: half where it leaves what none leaves, all far below."""
    return np.asarray(1 / (1 + np.exp(np.clip(_GATE * gained, -500, 500))))


def _held_out_errors(
    body: Body, weights: Sequence[FloatArray], held_out: Mapping[int, Sequence[FloatArray]]
) -> list[HeldOut]:
    """Keep every axis' errors on every fold, without compensation and of the average."""
    parts: list[list[FloatArray]] = [[] for _ in body.axes]
    cells = body.bins.cells
    for fold in body.folds:
        i = body.recording_of(fold)
        for n, (design, axis) in enumerate(body.designs(fold)):
            if not len(design):
                continue
            bins = np.flatnonzero((axis.binned.folds[i] == fold) & (axis.binned.sums[i].count > 0))
            middle = np.minimum((bins + 0.5) * cells - 0.5, len(axis.data.residual[i]) - 1)
            tared = tare(design, body.bins.period_s)
            remaining = -tared @ (weights[n] @ held_out[fold][n])
            same = np.ones(len(bins))
            parts[n].append(np.stack((i * same, fold * same, middle, tared[:, -1], remaining)))
    return [
        keep_errors(np.concatenate(own, axis=1), body.bins.period_s, tared=True) for own in parts
    ]


class _Lags(NamedTuple):
    """Free ln τ by kind, of the fit to everything and of those without each fold."""

    everything: Mapping[Kind, FloatArray]
    held_out: Sequence[Mapping[Kind, FloatArray]]

    def stated(self, kind: Kind) -> tuple[FloatArray, FloatArray]:
        """Time constants, increasing, and their standard errors by the jackknife over folds, s."""
        others = np.exp([np.sort(each[kind]) for each in self.held_out])
        spread = np.sqrt((len(others) - 1) * np.var(others, axis=0))
        tau_s = np.exp(np.sort(self.everything[kind]))
        return tau_s, np.hypot(spread, _MIXED * tau_s)


def _axis_fit(
    body: Body, axis: Axis, weights: FloatArray, tared: FloatArray, lags: _Lags
) -> AxisFit:
    """Turn the weights of an axis into its evidence."""
    data = axis.data
    owners = [kind for kind in body.kinds for _ in range(kind.fits)]

    def state(name: str, members: BoolArray) -> Candidate:
        """Tell what some candidates leave together, weighted as they run."""
        total = float(weights[members].sum())
        inside = np.where(members, weights if total > 0 else 1.0, 0.0)
        after = float(_root_mean_squares(inside / inside.sum(), tared).mean())
        rms = left_of_a_day(after, before, factor)
        return Candidate(name, rms if rms > rounding else 0.0, total)

    rounding = _ROUNDING * max(np.fmax.reduce(np.abs(each), initial=0.0) for each in data.residual)
    before = float(np.sqrt(tared[:, 0, 0]).mean())
    factor = day_over_blocks(axis.binned, before)
    positions = np.arange(len(weights))
    none = state('none', positions == 0)
    used = 1 - float(weights[0])
    after = state(COMBINATION, positions >= 0) if used else none
    names = np.array(['none', *(kind.name for kind in owners)])
    candidates = [state(name, names == name) for name in dict.fromkeys(names[1:].tolist())]
    shares = {each.name: each.weight for each in candidates}
    free = list(lags.everything)
    tau_s, tau_errors_s = np.zeros((2, 0))
    if sum(shares[name] for name in {kind.name for kind in free}) > used / 2:
        tau_s, tau_errors_s = lags.stated(max(free, key=lambda kind: shares[kind.name]))
    heaviest = sorted(candidates, key=lambda each: -each.weight)[:2]
    reason = (
        f'An average of {len(owners)} fits leaves {after.rms:.3g} {data.unit} RMS on held-out '
        f'data, no compensation {none.rms:.3g} {data.unit}; most weight have '
        + ' and '.join(f'{each.name} ({100 * each.weight / used:.0f} %)' for each in heaviest)
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
        time_constant_errors_s=tuple(tau_errors_s.tolist()), unit=data.unit)  # fmt: skip


def _model(body: Body, axis: Axis, gains: FloatArray) -> AxisModel | None:
    """Write gains of the pool, (P + 1,), as a model whose zero drift is none at rest at T_ref."""
    shape, period_s = (len(GRID_S), axis.moments.inputs), body.bins.period_s / body.bins.cells
    by_tau = by_relaxation(gains[:-1], *shape, loaded=axis.binned.loaded)
    model = build_axis_model(body.features, GRID_S, by_tau, body.inputs, period_s)
    if model is None:
        return None
    at_rest = [0.0, float(gains[-2])] if axis.binned.loaded else [0.0]
    return anchored(model, at_rest)
