"""
A combination of many fits instead of the best of them: from days to the drift of another.

All candidates are linear in one pool of columns: powers of every temperature behind relaxations on
a grid of time constants, for zero drift and, times the load, for gain drift. So each is a vector
of gains, and so is every average of them: what comes out is one model with a parallel bank.

1. Candidates: polynomials, three banks in ridge of three strengths (ten times as strong for every
   further degree), and one or two free time constants, which are found between the grid's by
   interpolation and are the same for all axes (one body). Each is fitted twice, with and without
   a transient at the start of every day.
2. Each is fitted to all days but one and judged on that day; all errors come from quadratic forms
   of the gains, so that nothing is run twice.
3. Weights fall with a power of the held-out error, half of it this axis' own and half of it the
   mean of all axes; the power grows with the number of days.
4. What the average leaves of the held-out days decides how much of it is used: an axis, or a body,
   that is hardly helped gets less.

What is claimed to be left is the mean over held-out days, tared in their first minute, and grows
with the distance from the calibrated range.

Residuals wander: a random walk in cosines is eliminated beside every day's constant, so that slow
errors are not taken for many independent witnesses.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import lfilter
from world_peers import axes_of, Day, tared

from wrist_ft_comp.model.signals import BoolArray, FloatArray, IntArray

RATIO, SHORTEST_S, DEGREES = 1.6, 20.0, 3
GRID_S: FloatArray = np.array([0.0, *(SHORTEST_S * RATIO**k for k in range(13))])
LOGS = np.log(GRID_S[1:])
#: Parts of a single day that are held out in turn.
PARTS = 5
#: Beyond the calibrated range squares go on for this share of it, and then all as straight lines.
CURVED_SHARE = 0.33
#: Start transients, s, and their variance over that of the noise; cosines of a random walk.
TRANSIENTS_S, TRANSIENT_VARIANCE, COSINES = (300.0, 1000.0, 3000.0), 30.0, 16
POOLED, GATE, DEGREE_PENALTY = 0.5, 16.0, 10.0
TINY = 1e-300


def near(*taus_s: float) -> tuple[int, ...]:
    """Find the positions on the grid nearest to time constants."""
    return tuple(
        int(np.argmin(np.abs(np.log((GRID_S + 1.0) / (tau_s + 1.0))))) for tau_s in taus_s
    )


BANKS = (near(0, 30, 100, 300, 1000, 3000), near(0, 20, 60), near(0, 100, 600))


class Candidate(NamedTuple):
    """A bank on the grid in ridge, or free time constants; powers up to the degree."""

    degree: int
    strengths: tuple[float, ...]
    bank: tuple[int, ...] = ()
    free: int = 0
    transient: bool = False


def candidates() -> list[Candidate]:
    """List them."""
    result = []
    for transient in (False, True):
        for degree in (1, 2, 3):
            result.append(Candidate(degree, (1e-6,), near(0), transient=transient))
            result += [
                Candidate(degree, (1e-2, 1e-4, 1e-6), b, transient=transient) for b in BANKS
            ]
            result.append(Candidate(degree, (1e-7,), free=1, transient=transient))
    return [*result, *(Candidate(degree, (1e-7,), free=2, transient=True) for degree in (1, 2))]


def relaxed(temperature_c: FloatArray, period_s: float) -> FloatArray:
    """Means over periods of every temperature behind every relaxation, (M, K, J), from rest."""
    columns = [temperature_c]
    for tau_s in GRID_S[1:]:
        pole = np.exp(-period_s / tau_s)
        state = lfilter([0, 1 - pole], [1, -pole], temperature_c, axis=0, zi=temperature_c[:1])[0]
        columns.append(temperature_c + (state - temperature_c) * (tau_s / period_s) * (1 - pole))
    return np.stack(columns, axis=1)


@dataclass(frozen=True, eq=False)
class Scale:
    """Middle and half width of all temperatures that were learnt from, °C, (J,)."""

    middle_c: FloatArray
    width_c: FloatArray

    def columns(
        self, relaxed_c: FloatArray, lower_c: FloatArray, upper_c: FloatArray
    ) -> FloatArray:
        """
        Raise temperatures to powers within a range, and carry them on beyond it, (M, K·D·J).

        Beyond, a square keeps its curvature for CURVED_SHARE of the range; else tangents go on.
        """
        theta, low, high = (
            (each - self.middle_c) / self.width_c for each in (relaxed_c, lower_c, upper_c)
        )
        inside = np.clip(theta, low, high)
        beyond = theta - inside
        near_edge = np.clip(beyond, -CURVED_SHARE * (high - low), CURVED_SHARE * (high - low))
        powers = [inside**d + d * inside ** (d - 1) * beyond for d in range(1, DEGREES + 1)]
        powers[1] += near_edge**2 + 2 * near_edge * (beyond - near_edge)
        return np.stack(powers, axis=2).reshape(len(theta), -1)


class Moments(NamedTuple):
    """Products of [columns | y], of these with the nuisances, and of the nuisances."""

    products: FloatArray
    crossed: FloatArray
    nuisances: FloatArray

    def without_nuisances(self, *, transient: bool) -> FloatArray:
        """Eliminate a constant, a random walk and, if asked for, a start transient."""
        walk = np.arange(COSINES + 1) ** 2.0
        start = np.full(len(TRANSIENTS_S), 1 / TRANSIENT_VARIANCE if transient else 1e12)
        strength = self.nuisances[0, 0] * np.concatenate((walk + 1e-12, start))
        solved = np.linalg.solve(self.nuisances + np.diag(strength), self.crossed)
        return np.asarray(self.products - self.crossed.T @ solved)


def design(columns: FloatArray, day: Day, axis: int) -> FloatArray:
    """Draw [ x | w x | w | y ], or without load [ x | y ]."""
    load, drift = day.load[:, axis : axis + 1], day.drift[:, axis : axis + 1]
    if not np.nanstd(load) > 0:
        return np.concatenate((columns, drift), axis=1)
    return np.concatenate((columns, load * columns, load, drift), axis=1)


class Problem:
    """Moments of every day, or part of one, and quadratic forms of what is held out."""

    def __init__(self, days: Sequence[Day]) -> None:
        self.days, self.axes = days, axes_of(days)
        every_c = np.concatenate([day.temperature_c for day in days])
        self.lower_c, self.upper_c = every_c.min(axis=0), every_c.max(axis=0)
        width_c = np.maximum((self.upper_c - self.lower_c) / 2, 1e-9)
        self.scale = Scale(every_c.mean(axis=0), width_c)
        self.thermometers = every_c.shape[1]
        self.folds: list[IntArray] = [np.full(len(day.drift), i) for i, day in enumerate(days)]
        if len(days) == 1:
            rows = len(days[0].drift)
            self.folds = [np.arange(rows) * PARTS // rows]
        self.numbers = np.unique(np.concatenate(self.folds))
        self.loaded = bool(np.nanstd(days[0].load[:, self.axes]) > 0)
        self.moments: dict[tuple[int, int, int], Moments] = {}
        self.judged: dict[tuple[int, int], FloatArray] = {}
        self.cleaned: dict[tuple[int, int], FloatArray] = {}
        relaxed_c = [relaxed(day.temperature_c, day.period_s) for day in days]
        for i, (day, folds) in enumerate(zip(days, self.folds, strict=True)):
            columns = self.scale.columns(relaxed_c[i], self.lower_c, self.upper_c)
            time_s = (np.arange(len(folds)) + 0.5) * day.period_s
            walk = np.cos(np.pi * np.outer(time_s / time_s[-1], np.arange(COSINES + 1)))
            nuisances = np.concatenate((walk, transients(time_s)), axis=1)
            for fold in np.unique(folds):
                others = [
                    d.temperature_c[f != fold] for d, f in zip(days, self.folds, strict=True)
                ]
                kept_c = np.concatenate(others)
                unseen = self.scale.columns(relaxed_c[i], kept_c.min(axis=0), kept_c.max(axis=0))
                for axis in self.axes:
                    rows = (folds == fold) & np.isfinite(day.drift[:, axis])
                    z, phi = design(columns, day, axis)[rows], nuisances[rows]
                    self.moments[fold, i, axis] = Moments(z.T @ z, phi.T @ z, phi.T @ phi)
                    held_out = design(unseen, day, axis)
                    self.judged[fold, axis] = tared_form(held_out, rows, day.period_s)
                    self.cleaned[fold, axis] = cleaned_form(held_out, rows, day.period_s)

    def spans_beyond(self, day: Day) -> float:
        """Tell how far outside the calibrated range a day goes, in ranges."""
        temperature_c = day.temperature_c
        below = self.lower_c - temperature_c.min(axis=0)
        above = temperature_c.max(axis=0) - self.upper_c
        return float(np.max(np.maximum(np.maximum(below, above), 0) / (2 * self.scale.width_c)))

    def normal(self, axis: int, skip: int | None, *, transient: bool) -> FloatArray:
        """Sum the products over days, of which a fold may be left out."""
        size = len(self.judged[self.numbers[0], axis])
        total = np.zeros((size, size))
        for i in range(len(self.days)):
            kept = [
                m for (f, d, a), m in self.moments.items() if d == i and a == axis and f != skip
            ]
            if kept:
                summed = Moments(*(np.sum(part, axis=0) for part in zip(*kept, strict=True)))
                total += summed.without_nuisances(transient=transient)
        return total

    def places(self, bank: Sequence[int], degree: int) -> tuple[IntArray, IntArray]:
        """Place a bank: all powers for zero drift, the first for gain drift; and which power."""
        pool = len(GRID_S) * DEGREES * self.thermometers
        grid = np.arange(pool).reshape(len(GRID_S), DEGREES, self.thermometers)[list(bank)]
        zero = grid[:, :degree]
        powers = np.broadcast_to(np.arange(1, degree + 1)[:, np.newaxis], zero.shape).ravel()
        if not self.loaded:
            return zero.ravel(), powers
        gain = np.append(pool + grid[:, 0].ravel(), 2 * pool)
        return np.concatenate((zero.ravel(), gain)), np.append(powers, np.ones_like(gain))


def transients(time_s: NDArray[np.floating[Any]]) -> FloatArray:
    """Draw what a body that did not start at rest forgets."""
    return np.stack([np.exp(-time_s / tau_s) for tau_s in TRANSIENTS_S], axis=1)


def tared_form(z: FloatArray, rows: BoolArray, period_s: float) -> FloatArray:
    """Mean square after a tare in the first minute, as a quadratic form of the gains."""
    error = tared(z[rows], period_s)
    return np.asarray(error.T @ error / len(error))


def cleaned_form(z: FloatArray, rows: BoolArray, period_s: float) -> FloatArray:
    """Mean square around a constant and a start transient, as a quadratic form of the gains."""
    inside = z[rows]
    time_s = np.arange(len(inside)) * period_s
    phi = np.concatenate((np.ones((len(inside), 1)), transients(time_s)), axis=1)
    strength = len(inside) * np.array([1e-9] + [1 / TRANSIENT_VARIANCE] * len(TRANSIENTS_S))
    crossed = phi.T @ inside
    solved = np.linalg.solve(phi.T @ phi + np.diag(strength), crossed)
    return np.asarray((inside.T @ inside - crossed.T @ solved) / len(inside))


def ridge(
    normal: FloatArray, places: IntArray, powers: IntArray, strengths: Sequence[float]
) -> FloatArray:
    """Fit columns at some strengths, relative to the diagonal: gains and -1 for y, (S, P + 1)."""
    diagonal = np.diag(normal)
    size = 1 / np.sqrt(np.where(diagonal > 1e-12 * diagonal.max(), diagonal, np.inf))[places]
    size = size * DEGREE_PENALTY ** (-(powers - 1) / 2)
    values, vectors = np.linalg.eigh(normal[np.ix_(places, places)] * np.outer(size, size))
    right = vectors.T @ (normal[places, -1] * size)
    gains = np.zeros((len(strengths), len(normal)))
    damped = right / (np.maximum(values, 0) + np.array(strengths)[:, np.newaxis])
    gains[:, places] = (damped @ vectors.T) * size
    gains[:, -1] = -1.0
    return gains


def interpolated(log_tau: float) -> tuple[FloatArray, FloatArray]:
    """Weights (K,) of the grid's relaxations for one between them, and their derivative."""
    step = np.log(RATIO)
    position = (log_tau - LOGS[0]) / step
    first = int(np.clip(np.floor(position) - 1, 0, len(LOGS) - 4))
    weights, slopes = np.zeros(len(GRID_S)), np.zeros(len(GRID_S))
    for node in range(4):
        others = [other for other in range(4) if other != node]
        below = np.prod([float(node - other) for other in others])
        away = {other: position - first - other for other in others}
        weights[1 + first + node] = np.prod(list(away.values())) / below
        pairs = [np.prod([away[o] for o in others if o != left_out]) for left_out in others]
        slopes[1 + first + node] = sum(pairs) / below / step
    return weights, slopes


def free_columns(
    problem: Problem, logs: FloatArray, degree: int, size: int
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Write free time constants as mixtures of the pool, (size, C), slopes, and which of them."""
    pool, j = len(GRID_S) * DEGREES * problem.thermometers, problem.thermometers
    mixtures: list[FloatArray] = []
    slopes: list[FloatArray] = []
    owners = []
    for owner, log_tau in enumerate(logs):
        weights, derivative = interpolated(float(log_tau))
        places = [(0, d, t) for d, t in product(range(degree), range(j))]
        places += [(pool, 0, t) for t in range(j)] if problem.loaded else []
        for base, d, t in places:
            at = base + (np.arange(len(GRID_S)) * DEGREES + d) * j + t
            for target, values in ((mixtures, weights), (slopes, derivative)):
                column = np.zeros(size)
                column[at] = values
                target.append(column)
            owners.append(owner)
    if problem.loaded:
        column = np.zeros(size)
        column[2 * pool] = 1.0
        mixtures.append(column)
        slopes.append(np.zeros(size))
        owners.append(-1)
    return np.array(mixtures).T, np.array(slopes).T, np.array(owners)


def misfit(normal: FloatArray, mixtures: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Fit mixtures of the pool: their gains, the pool's, and the sum of squares that remains."""
    gram, right = normal[:-1, :-1], normal[:-1, -1]
    size = np.sqrt(np.maximum(np.einsum('pc,pc->c', mixtures, gram @ mixtures), TINY))
    inner = mixtures.T @ gram @ mixtures / np.outer(size, size)
    own = np.linalg.solve(inner + 1e-7 * np.eye(len(inner)), mixtures.T @ right / size) / size
    gains = mixtures @ own
    rest = normal[-1, -1] - 2 * gains @ right + gains @ gram @ gains
    return own, gains, max(float(rest), 1e-12 * float(normal[-1, -1]))


def search(
    problem: Problem, normals: Sequence[FloatArray], candidate: Candidate, start: FloatArray
) -> FloatArray:
    """Find the free time constants that all axes share: least sum of log squares."""
    size = len(normals[0]) - 1

    def cost(logs: FloatArray) -> tuple[float, FloatArray]:
        mixtures, slopes, owners = free_columns(problem, logs, candidate.degree, size)
        total, gradient = 0.0, np.zeros(len(logs))
        for normal in normals:
            own, gains, rest = misfit(normal, mixtures)
            total += np.log(rest)
            each = 2 * (slopes.T @ (normal[:-1, :-1] @ gains - normal[:-1, -1])) * own / rest
            gradient += [each[owners == owner].sum() for owner in range(len(logs))]
        return total, gradient

    bounds = [(LOGS[0], LOGS[-1])] * len(start)
    options = {'maxiter': 40}
    return np.asarray(minimize(cost, start, jac=True, bounds=bounds, options=options).x)


def first_guess(
    problem: Problem, normals: Sequence[FloatArray], candidate: Candidate
) -> FloatArray:
    """Try all combinations on the grid."""

    def total(bank: Sequence[int]) -> float:
        places, _ = problem.places(bank, candidate.degree)
        mixtures = np.eye(len(normals[0]) - 1)[:, places]
        return float(sum(np.log(misfit(normal, mixtures)[2]) for normal in normals))

    best = min(combinations(range(1, len(GRID_S)), candidate.free), key=total)
    return np.asarray(LOGS[np.array(best) - 1])


def fit_all(
    problem: Problem, skip: int | None, starts: dict[Candidate, FloatArray]
) -> list[FloatArray]:
    """Fit none and all candidates to what is not skipped: gains of each axis, (C, P + 1)."""
    normals = {
        transient: [problem.normal(a, skip, transient=transient) for a in problem.axes]
        for transient in (False, True)
    }
    size = len(normals[True][0])
    none = np.append(np.zeros(size - 1), -1.0)[np.newaxis]
    gains = [[none] for _ in problem.axes]
    for each in candidates():
        theirs = normals[each.transient]
        if each.free:
            if each not in starts:
                starts[each] = first_guess(problem, theirs, each)
            logs = search(problem, theirs, each, starts[each])
            if skip is None:
                starts[each] = logs
            mixtures, _, _ = free_columns(problem, logs, each.degree, size - 1)
            fits = [np.append(misfit(normal, mixtures)[1], -1.0)[np.newaxis] for normal in theirs]
        else:
            places, powers = problem.places(each.bank, each.degree)
            fits = [ridge(normal, places, powers, each.strengths) for normal in theirs]
        for target, fit in zip(gains, fits, strict=True):
            target.append(fit)
    return [np.concatenate(parts) for parts in gains]


def weigh(errors: Sequence[FloatArray], days: int) -> list[FloatArray]:
    """
    Weigh none and all candidates of every axis by their held-out quadratic forms, (F, C, C).

    A logarithm's mean over folds is a geometric mean of their errors: no day outvotes the others.
    """
    folds = len(errors[0])
    logs = np.array([np.log(np.einsum('fii->fi', e) + TINY).mean(axis=0) / 2 for e in errors])
    logs -= logs[:, :1]
    logs = (1 - POOLED) * logs + POOLED * logs.mean(axis=0)
    power = 2 * folds if days > 1 else folds
    weights = np.exp(-power * (logs - logs[:, 1:].min(axis=1, keepdims=True)))
    weights[:, 0] = 0.0
    weights /= weights.sum(axis=1, keepdims=True)
    gained = np.array(
        [
            np.mean(np.log((np.einsum('i,fij,j->f', w, e, w) + TINY) / (e[:, 0, 0] + TINY))) / 2
            for w, e in zip(weights, errors, strict=True)
        ]
    )
    use = gate(gained) * gate(float(gained.mean()))
    weights *= use[:, np.newaxis]
    weights[:, 0] = 1 - use
    return list(weights)


def gate(gained: FloatArray | float) -> FloatArray:
    """Share of a correction that is used: half where it leaves what none leaves, all far below."""
    return np.asarray(1 / (1 + np.exp(np.clip(GATE * np.asarray(gained), -500, 500))))


def combine(days: Sequence[Day], judged: Day) -> tuple[FloatArray, FloatArray]:
    """Predict another day's drift, (M, 6), and the RMS that will be left of it, (6,)."""
    problem = Problem(days)
    starts: dict[Candidate, FloatArray] = {}
    gains = fit_all(problem, None, starts)
    held_out = {fold: fit_all(problem, int(fold), dict(starts)) for fold in problem.numbers}
    forms = [
        [
            np.array([held_out[f][n] @ part[f, a] @ held_out[f][n].T for f in problem.numbers])
            for n, a in enumerate(problem.axes)
        ]
        for part in (problem.cleaned, problem.judged)
    ]
    weights = weigh(forms[0], len(days))
    columns = problem.scale.columns(
        relaxed(judged.temperature_c, judged.period_s), problem.lower_c, problem.upper_c
    )
    drift, claim = np.zeros_like(judged.drift), np.full(6, np.nan)
    for n, axis in enumerate(problem.axes):
        mixed = weights[n] @ gains[n]
        drift[:, axis] = design(columns, judged, axis)[:, :-1] @ mixed[:-1]
        drift[:, axis] = np.where(np.isfinite(drift[:, axis]), drift[:, axis], 0.0)
        left_out = np.einsum('i,fij,j->f', weights[n], forms[1][n], weights[n])
        claim[axis] = np.sqrt(left_out).mean() * np.hypot(1.0, problem.spans_beyond(judged))
    return drift, claim
