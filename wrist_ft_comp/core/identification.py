"""
Identification of one axis: candidates compete on blocks they did not see, the simplest good one wins.

Every method ends in the same type, so whatever was chosen runs by the same free run.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, get_args

import numpy as np

from wrist_ft_comp import SettingsError
from wrist_ft_comp.core import simulation_error as oe
from wrist_ft_comp.core.arx import relaxation
from wrist_ft_comp.core.arx_pls import ArxPls
from wrist_ft_comp.core.drift import AxisModel
from wrist_ft_comp.core.features import FeatureKind, Features
from wrist_ft_comp.core.outer_inner import Orders, OuterInnerMethod, from_gains, identify
from wrist_ft_comp.core.problem import AxisProblem, block_errors, unexplained
from wrist_ft_comp.core.recording import FloatArray

Method = Literal['pcr', 'pls', 'filtered_pls', 'arx_pls', 'arx_pls_oe', 'auto']
METHODS: tuple[Method, ...] = get_args(Method)

#: More distinct temperatures than this are no plateaus; hats then get evenly spaced knots.
_MAX_PLATEAUS = 12
_EVEN_KNOTS = 6
_MAX_LATENTS = 8
#: Drift that ranges this many times wider where no wrench was recorded has run away.
_RUNAWAY = 3.0
_GRID_POINTS = 13
#: A candidate has to lower the mean square error by this share to be worth its complexity.
_WORTHWHILE = 0.05
_SHORTEST_TAU_S = 20.0
_LONGEST_TAU_S = 7200.0


@dataclass(frozen=True)
class IdentificationSettings:
    """
    What a person chose about the model's structure.

    Attributes
    ----------
    method : str
        One of METHODS.
    features : {'powers', 'hats'}
        Kind of features.
    degree : int
        Highest power of temperature, 1 to 4; auto and arx_pls_oe also try the lower ones.
    hat_temperatures_c : tuple of float
        Knots of the hats, °C, for every thermometer; empty takes the plateaus that were seen.
    latents : int or None
        Number of latents of the two-step methods; None lets held-out blocks choose.
    orders : Orders
        Orders of the two-step methods.

    """

    method: Method = 'auto'
    features: FeatureKind = 'powers'
    degree: int = 2
    hat_temperatures_c: tuple[float, ...] = ()
    latents: int | None = None
    orders: Orders = field(default_factory=Orders)

    def __post_init__(self) -> None:
        """Check the ranges."""
        if self.method not in METHODS:
            raise SettingsError(
                f'Unknown method {self.method!r}; expected one of {", ".join(METHODS)}.'
            )
        if self.features not in get_args(FeatureKind):
            raise SettingsError(f'Unknown features {self.features!r}; expected powers or hats.')
        if not 1 <= self.degree <= 4:
            raise SettingsError(f'The degree must be between 1 and 4; got {self.degree}.')
        if self.latents is not None and self.latents < 1:
            raise SettingsError(f'At least 1 latent is needed; got {self.latents}.')


@dataclass(frozen=True)
class Candidate:
    """
    One competitor and how it did on held-out blocks.

    Attributes
    ----------
    name : str
        For people.
    rms : float
        Root mean square error of the free run on held-out blocks, N or N m.

    """

    name: str
    rms: float


@dataclass(frozen=True, eq=False)
class AxisFit:
    """
    What was found for one axis.

    Attributes
    ----------
    model : AxisModel or None
        None is "no compensation".
    chosen : str
        Name of the winning candidate.
    candidates : tuple of Candidate
        All that were tried, simplest first.
    rms_before, rms_after : float
        Held-out root mean square error without and with compensation, N or N m.
    time_constants_s : tuple of float
        Of the model's latents, increasing, s.
    notes : tuple of str
        What had to be mended, and what could not be learnt.

    """

    model: AxisModel | None
    chosen: str
    candidates: tuple[Candidate, ...]
    rms_before: float
    rms_after: float
    time_constants_s: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()


#: Fits a problem: features, dynamics (None for no compensation), and what had to be mended.
_Fit = Callable[[AxisProblem], tuple[Features, ArxPls | None, tuple[str, ...]]]


def build_features(
    temperature_c: Sequence[FloatArray],
    settings: IdentificationSettings,
    observed: Sequence[FloatArray] | None = None,
) -> Features:
    """
    Choose reference, range and knots of the features from the recorded temperatures.

    Parameters
    ----------
    temperature_c : sequence of ndarrays, shape (N_i, J)
        Temperatures of all recordings, °C.
    settings : IdentificationSettings
        Kind, degree, knots.
    observed : sequence of ndarrays, shape (n_i, J), optional
        The temperatures at which there are samples; knots are laid there. All by default.

    Returns
    -------
    Features
        T_ref is the mean temperature of each thermometer.

    """
    everything = np.concatenate(list(temperature_c))
    lower, upper = everything.min(axis=0), everything.max(axis=0)
    knots: tuple[FloatArray, ...] = ()
    if settings.features == 'hats':
        where = everything if observed is None else np.concatenate(list(observed))
        knots = tuple(_knots(column, settings) for column in where.T)
    return Features(
        kind=settings.features,
        reference_c=everything.mean(axis=0),
        lower_c=lower,
        upper_c=upper,
        degree=settings.degree if settings.features == 'powers' else 1,
        knots_c=knots,
    )


def _knots(temperature_c: FloatArray, settings: IdentificationSettings) -> FloatArray:
    """Knots of one thermometer, °C."""
    if settings.hat_temperatures_c:
        return np.array(settings.hat_temperatures_c, dtype=float)
    plateaus = np.unique(temperature_c)
    if len(plateaus) <= _MAX_PLATEAUS:
        return plateaus
    return np.linspace(plateaus[0], plateaus[-1], _EVEN_KNOTS)


def time_constant_grid(problem: AxisProblem) -> FloatArray:
    """
    Lay out the time constants that are tried: 0 (static), then evenly in their logarithm.

    Parameters
    ----------
    problem : AxisProblem
        Its longest recording limits what can be told apart from a trend.

    Returns
    -------
    ndarray, shape (K,)
        s, increasing.

    """
    longest = max(len(residual) for residual in problem.residual) * problem.period_s
    low = max(_SHORTEST_TAU_S, 2 * problem.period_s)
    high = max(min(_LONGEST_TAU_S, longest / 2), 2 * low)
    return np.concatenate(([0.0], np.geomspace(low, high, _GRID_POINTS)))


def identify_axis(problem: AxisProblem, settings: IdentificationSettings) -> AxisFit:
    """
    Identify one axis by the method that was chosen.

    Parameters
    ----------
    problem : AxisProblem
        Drift observations.
    settings : IdentificationSettings
        Method and structure.

    Returns
    -------
    AxisFit
        The winner, and everything that was tried.

    Raises
    ------
    TooShortError
        When an ARX does not find enough consecutive samples.

    """
    method = settings.method
    if method not in ('arx_pls_oe', 'auto'):
        return _identify_two_step(problem, settings, (method,))
    if method == 'auto' and settings.features == 'hats':
        # Knots follow the temperatures that are left when a block is held out, so moments that
        # were summed once cannot serve all candidates.
        return _identify_two_step(problem, settings, ('none', 'pls'))
    return _identify_simulation_error(problem, settings)


def _identify_two_step(
    problem: AxisProblem,
    settings: IdentificationSettings,
    methods: Sequence[OuterInnerMethod | Literal['none']],
) -> AxisFit:
    """Let held-out blocks choose among two-step methods and their numbers of latents."""
    candidates: dict[str, _Fit] = {'none': lambda part: (_features(part, settings), None, ())}
    for method in methods:
        if method != 'none':
            for r in _latents_to_try(settings, _features(problem, settings), method):
                name = f'{method}, {r} latent{"s" * (r > 1)}'
                candidates[name] = partial(_fit_two_step, settings, method, r)
    errors = {name: _held_out(problem, fit) for name, fit in candidates.items()}
    competing = [name for name in candidates if name != 'none' or 'none' in methods]
    chosen = competing[simplest_good([errors[name] for name in competing])]
    features, dynamics, notes = candidates[chosen](problem)
    return _finish(problem, features, dynamics, chosen, errors, notes)


def _features(problem: AxisProblem, settings: IdentificationSettings) -> Features:
    """Build the features of a problem, with knots only where there are samples."""
    observed = [
        temperature_c[np.isfinite(residual)]
        for temperature_c, residual in zip(problem.temperature_c, problem.residual, strict=True)
    ]
    return build_features(problem.temperature_c, settings, observed)


def _fit_two_step(
    settings: IdentificationSettings, method: OuterInnerMethod, latents: int, part: AxisProblem
) -> tuple[Features, ArxPls | None, tuple[str, ...]]:
    """Fit one candidate to what is not held out."""
    features = _features(part, settings)
    orders = replace(settings.orders, latents=latents)
    return features, *identify(method, part, features, orders)


def _latents_to_try(
    settings: IdentificationSettings, features: Features, method: OuterInnerMethod
) -> Sequence[int]:
    """List numbers of latents; hats take all, so that every knot keeps its own coefficients."""
    if settings.latents is not None:
        return [settings.latents]
    width = features.expand(features.reference_c).shape[0]
    if method == 'filtered_pls':
        # Hats behind a bank of filters are too many and too alike for each to keep its own.
        return range(1, min(width * len(settings.orders.time_constants_s), _MAX_LATENTS) + 1)
    return [width] if features.kind == 'hats' else range(1, min(width, _MAX_LATENTS) + 1)


def _held_out(problem: AxisProblem, fit: _Fit) -> FloatArray:
    """Fit without each block in turn and score it there: mean square errors, shape (blocks,)."""
    scores = []
    for block in problem.block_numbers:
        features, dynamics, _ = fit(problem.without(block))
        left = unexplained(problem, features, dynamics)
        total, count = block_errors(problem, left, block)
        scores.append(total / count)
    return np.array(scores)


def simplest_good(errors: Sequence[FloatArray]) -> int:
    """
    Choose the simplest candidate within one standard error of the best, or within 5 % of it.

    The standard error is that of the difference to the best, block by block: blocks differ in
    difficulty far more than candidates do.

    Parameters
    ----------
    errors : sequence of ndarrays, shape (blocks,)
        Mean square errors, simplest candidate first.

    Returns
    -------
    int
        Its position.

    """
    means = [float(error.mean()) for error in errors]
    best = int(np.argmin(means))
    for position, error in enumerate(errors):
        difference = error - errors[best]
        blocks = len(difference)
        deviation = float(difference.std(ddof=1)) / np.sqrt(blocks) if blocks > 1 else 0.0
        if difference.mean() <= max(deviation, _WORTHWHILE * means[position]):
            return position
    return best


def _identify_simulation_error(problem: AxisProblem, settings: IdentificationSettings) -> AxisFit:
    """Let none, static, free and banked relaxations compete, fitted on the simulation error."""
    features = build_features(problem.temperature_c, settings)
    grid = time_constant_grid(problem)
    banked = oe.bank_inputs(problem, features, grid)
    moments = oe.accumulate(problem, banked, grid)
    errors = {'none': oe.uncompensated_errors(moments)}
    structures: dict[str, tuple[oe.Structure, float]] = {}
    for structure in _structures(settings, features, grid):
        inputs = _inputs(structure, features)
        strengths = oe.RIDGE_STRENGTHS if structure.regularised else (0.0,)
        tried = [oe.held_out_errors(moments, structure, inputs, s) for s in strengths]
        best = int(np.argmin([error.mean() for error in tried]))
        errors[structure.name] = tried[best]
        structures[structure.name] = (structure, strengths[best])
    competing = list(errors) if settings.method == 'auto' else list(structures)
    notes: tuple[str, ...] = ()
    while True:
        chosen = competing[simplest_good([errors[name] for name in competing])]
        if chosen == 'none':
            return _finish(problem, features, None, chosen, errors, notes)
        inputs, dynamics = _fit_structure(problem, features, moments, *structures[chosen])
        if len(competing) == 1 or _stays_bounded(problem, inputs, dynamics):
            return _finish(problem, inputs, dynamics, chosen, errors, notes)
        competing.remove(chosen)
        notes = (*notes, f'{chosen}: left out, its drift runs away where no wrench was recorded')


def _fit_structure(
    problem: AxisProblem,
    features: Features,
    moments: oe.Moments,
    structure: oe.Structure,
    strength: float,
) -> tuple[Features, ArxPls | None]:
    """Fit the winner to all blocks, its time constants refined; return its features, too."""
    inputs = _inputs(structure, features)
    if features.kind == 'powers':
        features = replace(features, degree=structure.degree)
    taus = np.array(structure.bank_s or (0.0,))
    if structure.free_time_constants:
        everything = np.ones(len(moments.counts), dtype=bool)
        columns, _ = oe.fit_columns(moments, structure, everything, inputs, strength)
        half = len(moments.time_constants_s) * moments.inputs
        found = np.unique(columns[columns < half] // moments.inputs)
        taus = oe.refine_time_constants(problem, features, moments.time_constants_s[found])
    gains, _ = oe.fit_gains(problem, features, taus, max(strength, oe.TINY_RIDGE))
    return features, _to_dynamics(problem, features, taus, gains)


def _inputs(structure: oe.Structure, features: Features) -> int:
    """Count the features that take part in a structure: powers up to its degree, or all hats."""
    if features.kind == 'powers':
        return structure.degree * features.thermometers
    return sum(len(knots) for knots in features.knots_c)


def _stays_bounded(problem: AxisProblem, features: Features, dynamics: ArxPls | None) -> bool:
    """Tell whether the drift in cells without a wrench stays near that in cells with one."""
    if dynamics is None:
        return True
    for temperature_c, residual in zip(problem.temperature_c, problem.residual, strict=True):
        x = features.expand(temperature_c)
        drift = dynamics.run(dynamics.start(x[0]), x)[1]
        seen = np.isfinite(residual)
        if seen.any() and (np.ptp(drift, axis=0) > _RUNAWAY * np.ptp(drift[seen], axis=0)).any():
            return False
    return True


def _structures(
    settings: IdentificationSettings, features: Features, grid: FloatArray
) -> list[oe.Structure]:
    """List the candidates that compete, simplest first."""
    hats = features.kind == 'hats'
    degrees = [1] if hats else list(range(1, settings.degree + 1))
    what = {degree: 'hats' if hats else f'degree {degree}' for degree in degrees}
    found = []
    if settings.method == 'auto':
        found += [oe.Structure(f'static, {what[d]}', d) for d in degrees]
    found += [
        oe.Structure(f'{count} time constant{"s" * (count > 1)}, {what[d]}', d, count)
        for count in (1, 2, 3)
        for d in degrees
        if count < 3 or d == 1
    ]
    if settings.method == 'auto':
        bank = tuple(float(tau) for tau in grid[::2])
        found += [oe.Structure(f'bank of relaxations, {what[d]}', d, bank_s=bank) for d in degrees]
    return found


def _to_dynamics(
    problem: AxisProblem, features: Features, time_constants_s: FloatArray, gains: FloatArray
) -> ArxPls | None:
    """Write fitted gains as the model's ARX form."""
    inputs = np.concatenate([features.expand(t) for t in problem.temperature_c])
    deviation = inputs.std(axis=0)
    weight = 1.0 / np.where(deviation > 0, deviation, 1.0)
    bank = [relaxation(float(tau), problem.period_s) for tau in time_constants_s]
    return from_gains(bank, gains, inputs.mean(axis=0), weight, np.ones(gains.shape[2]))


def _finish(
    problem: AxisProblem,
    features: Features,
    dynamics: ArxPls | None,
    chosen: str,
    errors: dict[str, FloatArray],
    notes: tuple[str, ...],
) -> AxisFit:
    """Fix what the fit leaves open, and collect the scores."""
    if problem.no_sensitivity:
        notes = (*notes, f'zero drift only: {problem.no_sensitivity}')
    candidates = tuple(
        Candidate(name, float(np.sqrt(error.mean()))) for name, error in errors.items()
    )
    rms = {candidate.name: candidate.rms for candidate in candidates}
    if dynamics is None:
        return AxisFit(None, 'none', candidates, rms['none'], rms['none'], notes=notes)
    poles = np.concatenate([latent.poles for latent in dynamics.latents])
    lasting = poles.real[(np.abs(poles.imag) < 1e-9) & (poles.real > 0)]
    return AxisFit(
        model=AxisModel(features, anchor(problem, features, dynamics)),
        chosen=chosen,
        candidates=candidates,
        rms_before=rms['none'],
        rms_after=rms[chosen],
        time_constants_s=tuple(
            float(tau) for tau in np.unique(np.round(-problem.period_s / np.log(lasting), 6))
        ),
        notes=notes,
    )


def anchor(problem: AxisProblem, features: Features, dynamics: ArxPls) -> ArxPls:
    """
    Fix the constants: no zero drift when soaked at T_ref, and the gain error there, if loaded.

    Parameters
    ----------
    problem : AxisProblem
        The axis; with load, the constant of the sensitivity drift is its least-squares value.
    features : Features
        For T_ref.
    dynamics : ArxPls
        Fitted up to constants.

    Returns
    -------
    ArxPls
        With its output mean set.

    """
    x_ref = features.expand(features.reference_c)
    resting = dynamics.step(dynamics.start(x_ref), x_ref)[1] - dynamics.output_mean
    mean = -resting
    anchored = replace(dynamics, output_mean=mean)
    if problem.load is None:
        return anchored
    left = unexplained(problem, features, anchored)
    above, below, whole = 0.0, 0.0, 0.0
    for values, load in zip(left, problem.load, strict=True):
        rows = np.isfinite(values) & np.isfinite(load)
        if rows.any():
            w = load[rows] - load[rows].mean()
            above += float(w @ values[rows])
            below += float(w @ w)
            whole += float(load[rows] @ load[rows])
    # A load that is constant within each recording leaves the gain error at T_ref open.
    gain_error = above / below if below > 1e-12 * whole else 0.0
    return replace(anchored, output_mean=mean + np.array([0.0, gain_error]))
