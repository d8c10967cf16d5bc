"""
The drift of all six axes: the model that runs, and the functions that run it.

    r_i = (1 + s_i) w_i + o_i           measurement: s sensitivity drift, o zero drift
    ŵ_i = (r_i - o_i - tare_i) / (1 + s_i)

Each axis has dynamic filters, features, and behind them the outer and the inner model:

    T'(k) = H_1(T), …, H_K(T)     (K·J,)  dynamic filter before the outer model (eq. 11)
    x(k)  = features of T'        (F,)
    y(k)  = ARX-PLS of x          (M,)    eq. 15, y = (o, s) or o alone
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from wrist_ft_comp.channels import AXES, SENSOR_FACTS, SensorNames
from wrist_ft_comp.drift.arx_pls import Arx, ArxPls, static_gain
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.errors import check_part, SettingsError
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.series import FloatArray, NANOSECONDS

#: A static gain is 1 as far as files round it.
_UNIT_GAIN_TOLERANCE = 1e-6
#: Smallest calibrated range of a thermometer that counts: one that hardly moved during the
#: calibration is not outside its range for a hundredth of a degree, K.
LEAST_RANGE_K = 1.0


@dataclass(frozen=True, eq=False)
class AxisModel:
    """What runs for one axis."""

    #: From J temperatures, or with filters K·J filtered ones (filter by filter), to F features.
    features: Features
    #: From F features to one output (zero drift) or two (zero drift, sensitivity drift).
    dynamics: ArxPls
    #: H_k, of static gain 1, each applied to every thermometer; empty passes them as they are.
    filters: tuple[Arx, ...] = ()

    def __post_init__(self) -> None:
        check_part(self.features.width == len(self.dynamics.input_mean), 'number of features')
        check_part(self.outputs in (1, 2), 'number of outputs')
        remainder = self.features.thermometers % max(len(self.filters), 1)
        check_part(remainder == 0, 'number of filters')
        for dynamics in self.filters:
            check_part(abs(dynamics.gain - 1.0) <= _UNIT_GAIN_TOLERANCE, 'gain of a filter')
        _ = self._filter_bank  # refuses unstable filters now, not in the first step

    @property
    def thermometers(self) -> int:
        """Number of thermometers J."""
        return self.features.thermometers // max(len(self.filters), 1)

    @property
    def reference_c(self) -> FloatArray:
        """T_ref of each thermometer, °C, shape (J,)."""
        return self.features.reference_c[: self.thermometers]

    @property
    def outputs(self) -> int:
        """Number of outputs M: 1 is zero drift, 2 is zero and sensitivity drift."""
        return len(self.dynamics.output_mean)

    def anchored(self, at_rest: Sequence[float]) -> 'AxisModel':
        """Shift the constants so that soaked at T_ref it gives these outputs, (M,)."""
        soaked_c = self.reference_c
        resting = self.run(self.start(soaked_c), soaked_c[np.newaxis])[1][0]
        mean = self.dynamics.output_mean - resting + np.array(at_rest)
        return replace(self, dynamics=replace(self.dynamics, output_mean=mean))

    @property
    def poles(self) -> FloatArray:
        """Poles of all filters and latents, complex, shape (poles,)."""
        parts = (*self.filters, *self.dynamics.latents)
        return np.concatenate([part.poles for part in parts])

    @cached_property
    def _filter_bank(self) -> ArxPls:
        """Write the filters, or else a gain of 1, as latents whose loadings only copy."""
        thermometers, filtered = self.thermometers, self.features.thermometers
        filters = self.filters or (static_gain(),)
        return ArxPls(
            input_mean=np.zeros(thermometers), input_weight=np.ones(thermometers),
            rotations=np.tile(np.eye(thermometers), len(filters)),  # (J, K·J)
            latents=tuple(dynamics for dynamics in filters for _ in range(thermometers)),
            output_loadings=np.eye(filtered), output_weight=np.ones(filtered),
            output_mean=np.zeros(filtered))  # fmt: skip

    def start(self, temperature_c: FloatArray) -> FloatArray:
        """State of a soaked sensor, shape (S,): that of the filters, then that of the latents."""
        clamped = self.features.clamp(temperature_c)
        x = self.features.expand(np.tile(clamped, max(len(self.filters), 1)))
        states = self._filter_bank.start(clamped), self.dynamics.start(x)
        return np.concatenate([state.ravel() for state in states])

    def run(self, state: FloatArray, temperature_c: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Advance by N cells, temperatures (N, J), drift (N, M)."""
        before, behind = self._split(state)
        # Temperatures are clamped before a filter remembers them.
        before, filtered = self._filter_bank.run(before, self.features.clamp(temperature_c))
        behind, outputs = self.dynamics.run(behind, self.features.expand(filtered))
        return np.concatenate((before.ravel(), behind.ravel())), outputs

    def skip(self, state: FloatArray, temperature_c: FloatArray, cells: int = 1) -> FloatArray:
        """Advance by N temperatures, (N, J), each for some cells; the state alone, quickly."""
        before, behind = self._split(state)
        if before.size and behind.size:  # the latents need every cell of the filters
            return self.run(state, np.repeat(temperature_c, cells, axis=0))[0]
        clamped = self.features.clamp(temperature_c)
        before = self._filter_bank.skip(before, clamped, cells)
        if behind.size:
            behind = self.dynamics.skip(behind, self.features.expand(clamped), cells)
        return np.concatenate((before.ravel(), behind.ravel()))

    def _split(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Split a state into those of the filters and of the latents, (R, L) each."""
        shape = self._filter_bank.state_shape
        size = math.prod(shape)
        return state[:size].reshape(shape), state[size:].reshape(self.dynamics.state_shape)

    @property
    def range_c(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest calibrated temperature of each thermometer, °C, (J,)."""
        features, count = self.features, self.thermometers
        return features.lower_c[:count], features.upper_c[:count]

    def beyond_range(self, temperature_c: FloatArray) -> FloatArray:
        """Distance of each thermometer from its calibrated range, in ranges, (..., J)."""
        low_c, high_c = self.range_c
        excess_k = temperature_c - np.clip(temperature_c, low_c, high_c)
        return np.asarray(np.abs(excess_k) / np.maximum(high_c - low_c, LEAST_RANGE_K))


#: While a start is averaged, the temperature of metal changes by less than this, K.
_NEAR_K = 5.0
#: Filter state of each modelled axis, by name: what the last cell left.
DriftState = Mapping[str, FloatArray]


@dataclass(frozen=True, eq=False)
class ThermometerPrediction:
    """
    Predicts J thermometers from each other behind K relaxations; says what healthy ones do.

        T̂_j(k) = c_j + Σ_τ Σ_i g_jτi (H_τ T_i)(k),     g_jτj = 0

    H_τ is a relaxation with the time constant τ, stepped once per thermal cell.
    """

    #: τ of the relaxations, s, shape (K,); 0 has no memory.
    time_constants_s: FloatArray
    #: g, without unit, shape (J, K, J).
    gains: FloatArray
    #: c, °C, shape (J,).
    constant_c: FloatArray
    #: The prediction of a healthy one moves by less while it is silent or reads the same, K, (J,).
    still_k: FloatArray
    #: A healthy one is silent for less, s, (J,).
    silence_s: FloatArray
    #: One that was replaced agrees where it is nearer to its prediction, K, (J,).
    agree_k: FloatArray

    def __post_init__(self) -> None:
        count, thermometers = len(self.time_constants_s), len(self.constant_c)
        for name, shape in (
            ('time_constants_s', (count,)),
            ('gains', (thermometers, count, thermometers)),
            ('still_k', (thermometers,)),
            ('silence_s', (thermometers,)),
            ('agree_k', (thermometers,)),
        ):
            values = getattr(self, name)
            check_part(values.shape == shape, f'shape of {name}')
            check_part(name == 'gains' or bool((values >= 0).all()), name)

    def relax(self, relaxed_c: FloatArray, temperature_c: FloatArray, time_s: float) -> FloatArray:
        """Let relaxed temperatures, (K, J), follow constant ones, °C, (J,), for some time, s."""
        # One of 0 s has forgotten everything.
        slowness = np.maximum(self.time_constants_s, np.finfo(float).eps)[:, np.newaxis]
        return np.asarray(temperature_c + np.exp(-time_s / slowness) * (relaxed_c - temperature_c))

    def predict(self, relaxed_c: FloatArray) -> FloatArray:
        """Predict all thermometers, °C, (J,), from relaxed temperatures, (K, J)."""
        gains = self.gains.reshape(len(self.constant_c), -1)
        return np.asarray(self.constant_c + gains @ relaxed_c.ravel())


@dataclass(frozen=True, eq=False)
class DriftModel:
    """Drift of a sensor."""

    #: Thermal period h, ns.
    period_ns: int
    #: J.
    thermometers: int
    #: By axis name; an axis that is missing has no drift ("none").
    axes: Mapping[str, AxisModel]
    #: By axis name, also of axes without drift: standard deviation of what the model leaves of the
    #: drift, from held-out data, N or N m.
    deviation: Mapping[str, float] = field(default_factory=dict)
    #: By axis name: the error that an axis stays below on 9 of 10 days, N or N m, in means over
    #: 10 s, tared, within the calibrated temperatures; empty where it is not known.
    day_limits: Mapping[str, float] = field(default_factory=dict)
    #: A sensor that starts has soaked at the mean temperatures of this time, s; where it is 0, at
    #: those of the first cell.
    start_s: float = 0.0
    #: What each thermometer should read by the others; None with one, or where it is not known.
    prediction: ThermometerPrediction | None = None
    #: For how long each thermometer read the same at most, s; None where that is not known.
    stands_s: Sequence[float | None] = ()

    def __post_init__(self) -> None:
        predicted = len(self.prediction.constant_c) if self.prediction else self.thermometers
        counts = [predicted, *(axis.thermometers for axis in self.axes.values())]
        check_part(
            self.thermometers > 0 and set(counts) == {self.thermometers}, 'number of thermometers'
        )
        for name in (*self.axes, *self.deviation):
            check_part(name in AXES, f'the axis {name}')

    @property
    def start_cells(self) -> int:
        """Number of cells whose mean temperatures a start takes."""
        return max(round(self.start_s / self.period_ns * NANOSECONDS), 1)

    def outside(self, temperature_c: FloatArray) -> list[int]:
        """List the thermometers, counted from 0, that read outside an axis's calibrated range."""
        beyond = np.array([axis.beyond_range(temperature_c) for axis in self.axes.values()])
        return [int(j) for j in np.flatnonzero((beyond > 0).any(axis=0))]

    def uncertainty(self, temperature_c: FloatArray) -> FloatArray:
        """
        Estimate how far the zero drift that is subtracted may be from the true one.

        It is a standard deviation, N and N m, shape (..., 6), from temperatures, °C, shape
        (..., J); NaN for axes that were not calibrated. It grows by √(1 + d²) at d thirds of the
        calibrated range beyond it: nobody saw how the drift goes on there.
        """
        deviations = np.full((*temperature_c.shape[:-1], len(AXES)), np.nan)
        for name, deviation in self.deviation.items():
            axis = self.axes.get(name)
            beyond = 0.0 if axis is None else axis.beyond_range(temperature_c).max(axis=-1)
            deviations[..., AXES.index(name)] = deviation * np.hypot(1.0, 3 * beyond)
        return deviations


@dataclass(frozen=True, eq=False)
class StoredModel:
    """A model as it lies on disk."""

    path: Path
    #: Of the file's bytes.
    sha256: str
    #: Ready to run.
    model: DriftModel
    #: Everything in the file, as plain values.
    document: dict[str, Any]

    @property
    def sensor(self) -> SensorNames:
        """Names of the sensor that the model was learnt from; people may have edited them."""
        sensor = {}
        for fact in SENSOR_FACTS:
            names = self.document['provenance'].get(fact)
            names = [names] if isinstance(names, str) and names else names
            if names and isinstance(names, list):
                sensor[fact] = [str(name) for name in names]
        return sensor

    @property
    def topics(self) -> Topics:
        """Topics that the model was learnt from; the usual ones where its file names none."""
        wrench = self.sensor.get('wrench_topic', [Topics.wrench])[0]
        return Topics(wrench, tuple(self.sensor.get('temperature_topics', Topics.temperatures)))

    @property
    def reference(self) -> str:
        """What the true wrench was where the model was learnt; people may have edited it."""
        settings = self.document['provenance'].get('settings')
        return str(settings.get('reference', '')) if isinstance(settings, dict) else ''


def check_fits(model: DriftModel, thermometers: int, name: object = 'The model') -> None:
    """Refuse a model of other thermometers than a node has, by SettingsError."""
    if model.thermometers != thermometers:
        raise SettingsError(
            f'{name} expects {model.thermometers} thermometers, the node has {thermometers} '
            "(temperature_topics). Calibrate with these, or list the model's topics."
        )


def check_sensor(stored: StoredModel, sensor: SensorNames, where: str = 'here') -> tuple[str, ...]:
    """Warn of a model of another sensor; SettingsError where thermometers are in another order."""
    name = stored.path.name
    if problem := order_problem(stored.sensor, sensor):
        raise SettingsError(f'{name} cannot run beside the thermometers {where}: {problem}')
    found = differences({f'in {name}': stored.sensor, where: sensor})
    warning = (
        f'The model may be of another sensor: {found}. Calibrate this one; or, if only names were '
        f'changed, write the new ones below provenance in {name}, and tare again afterwards.'
    )
    return (warning,) if found else ()


def order_problem(expected: SensorNames, sensor: SensorNames) -> str:
    """Say what to do where the expected thermometers are in another order; else nothing."""
    both = expected, sensor
    order, other = (_alike(names.get('temperature_topics', ())) for names in both)
    # Of two arms, either may have the other's sensor as its second thermometer.
    wrenches = {_alike(names.get('wrench_topic', ())) for names in both} - {()}
    if order == other or set(order) != set(other) or len(wrenches) > 1:
        return ''
    return (
        f'the order is {", ".join(sensor["temperature_topics"])}; expected '
        f'{", ".join(expected["temperature_topics"])}. Name them in that order '
        '(temperature_topics, --temperature-topic); in a CSV file, exchange the names of the '
        'columns and remove the column recorded_from.'
    )


def differences(sensors: Mapping[str, SensorNames]) -> str:
    """List the facts in which sensors, by where they are, differ; empty where none does."""
    found = []
    for fact in SENSOR_FACTS:
        distinct = {
            _alike(sensor[fact]): f'{", ".join(sensor[fact])} {where}'
            for where, sensor in sensors.items()
            if fact in sensor
        }
        if len(distinct) > 1:
            found.append(f'{fact} {", ".join(distinct.values())}')
    return '; '.join(found)


def _alike(names: Sequence[str]) -> tuple[str, ...]:
    """Normalise names of topics, so that two spellings of one topic are equal."""
    plain = (name.strip('/').replace('[', '.').replace(']', '') for name in names)
    return tuple(name.removesuffix(':C').removesuffix(':temperature') for name in plain)


class Drift(NamedTuple):
    """Zero and sensitivity drift, shape (..., 6), axis order AXES."""

    #: o, N and N m.
    zero: FloatArray
    #: s, without unit.
    sensitivity: FloatArray


def no_drift(cells: int | None = None) -> Drift:
    """Make a drift of zeros, shape (6,) or (cells, 6)."""
    shape = (len(AXES),) if cells is None else (cells, len(AXES))
    return Drift(np.zeros(shape), np.zeros(shape))


def start(model: DriftModel, temperature_c: FloatArray) -> DriftState:
    """State of a sensor that has soaked at temperatures, °C, shape (J,)."""
    return {name: axis.start(temperature_c) for name, axis in model.axes.items()}


def at_rest(model: DriftModel, temperature_c: FloatArray) -> DriftState:
    """State of a sensor that had soaked before its first N cells, temperatures (N, J)."""
    temperature_c = temperature_c[: model.start_cells]
    # Cells that are near most others are averaged: a first reading may lie.
    middle_c = np.sort(temperature_c, axis=0)[(len(temperature_c) - 1) // 2]
    near = np.abs(temperature_c - middle_c) < _NEAR_K
    return start(model, np.mean(temperature_c, axis=0, where=near))


def run_from_rest(model: DriftModel, temperature_c: FloatArray) -> tuple[DriftState, Drift]:
    """
    Run a soaked sensor through its first N cells, temperatures (N, J), drift (N, 6).

    A start takes the mean of ``start_cells``, and during these the mean of those that have come:
    one noisy temperature must not be remembered for an hour.
    """
    cells = min(model.start_cells, len(temperature_c))
    parts = []
    for end in [*range(1, cells), len(temperature_c)]:
        state, drift = run(model, at_rest(model, temperature_c[:end]), temperature_c[:end])
        parts.append(Drift(*(part[min(end, cells) - 1 :] for part in drift)))
    return state, Drift(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def step(
    model: DriftModel, state: DriftState, temperature_c: FloatArray
) -> tuple[DriftState, Drift]:
    """Advance by one cell of mean temperatures, °C, (J,); the state is not modified."""
    after, drift = run(model, state, temperature_c[np.newaxis])
    return after, Drift(drift.zero[0], drift.sensitivity[0])


def run(
    model: DriftModel, state: DriftState, temperature_c: FloatArray
) -> tuple[DriftState, Drift]:
    """Advance by N cells, temperatures (N, J), drift (N, 6)."""
    after: dict[str, FloatArray] = {}
    drift = no_drift(len(temperature_c))
    for name, axis in model.axes.items():
        after[name], outputs = axis.run(state[name], temperature_c)
        for part, values in zip(drift, outputs.T, strict=False):
            part[:, AXES.index(name)] = values
    return after, drift


def skip(
    model: DriftModel, state: DriftState, temperature_c: FloatArray, cells: int = 1
) -> DriftState:
    """Advance by N temperatures, (N, J), each for some cells; the state alone, quickly."""
    if not len(temperature_c):
        return state
    return {
        name: axis.skip(state[name], temperature_c, cells) for name, axis in model.axes.items()
    }


def run_to_end(
    model: DriftModel, state: DriftState, temperature_c: FloatArray
) -> tuple[DriftState, Drift]:
    """Advance by N cells, temperatures (N, J), quickly; the drift is that of the last one."""
    return step(model, skip(model, state, temperature_c[:-1]), temperature_c[-1])


def correct(raw: FloatArray, drift: Drift, tare: FloatArray | float = 0.0) -> FloatArray:
    """Remove drift and tare from raw wrenches, shapes (..., 6), N and N m."""
    return np.asarray((raw - drift.zero - tare) / (1.0 + drift.sensitivity))
