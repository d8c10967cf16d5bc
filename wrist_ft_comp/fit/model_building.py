"""What a fit begins and ends with: features of the recorded temperatures, and what runs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrist_ft_comp.drift.arx import relaxation, static_gain
from wrist_ft_comp.drift.arx_pls import from_gains
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Beyond, Features
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.signals import FloatArray

#: More distinct temperatures than this are no plateaus; hats then get evenly spaced knots.
_MAX_PLATEAUS = 12
_EVEN_KNOTS = 6


def build_features(
    temperature_c: Sequence[FloatArray],
    settings: IdentificationSettings,
    observed: Sequence[FloatArray] | None = None,
    beyond: Beyond = 'clamped',
) -> Features:
    """
    Choose reference, range and knots of features from temperatures, °C, shapes (N_i, J).

    Knots of hats stand where samples were observed, (n_i, J), if that is given. The features are
    those of the temperatures behind one relaxation.
    """
    everything = np.concatenate(list(temperature_c))
    knots: tuple[FloatArray, ...] = ()
    if settings.features == 'hats':
        where = everything if observed is None else np.concatenate(list(observed))
        knots = tuple(_knots(column, settings) for column in where.T)
    return Features(
        kind=settings.features, reference_c=everything.mean(axis=0),
        lower_c=everything.min(axis=0), upper_c=everything.max(axis=0),
        degree=settings.highest_degree if settings.features == 'powers' else 1,
        knots_c=knots, beyond=beyond)  # fmt: skip


def _knots(temperature_c: FloatArray, settings: IdentificationSettings) -> FloatArray:
    """Choose the knots of one thermometer, °C."""
    if settings.hat_temperatures_c:
        return np.array(settings.hat_temperatures_c, dtype=float)
    plateaus = np.unique(temperature_c)
    if len(plateaus) == 1:
        return np.array([plateaus[0], plateaus[0] + 1.0])  # a constant needs a hat, too
    if len(plateaus) <= _MAX_PLATEAUS:
        return plateaus
    return np.linspace(plateaus[0], plateaus[-1], _EVEN_KNOTS)


def by_relaxation(values: FloatArray, count: int, inputs: int, *, loaded: bool) -> FloatArray:
    """Sort values of Moments.columns, (p,), by relaxation, (K, F, M), without the load's."""
    outputs = 2 if loaded else 1
    per_output = values[: outputs * count * inputs].reshape(outputs, count, inputs)
    return np.moveaxis(per_output, 0, 2)


def build_axis_model(
    features: Features,
    time_constants_s: FloatArray,
    gains: FloatArray,
    inputs: Sequence[FloatArray],
    period_s: float,
) -> AxisModel | None:
    """
    Write gains, (K, F, M), of the features of K relaxed temperatures in the form that runs.

    Relaxations become filters, and all filtered temperatures one set of features; ``inputs``,
    (n_i, K·F), of ``bank_inputs``, say how far they move. The constants of the outputs stay open
    (``anchored`` fixes them), and all gains zero give None.
    """
    count = len(time_constants_s)
    joined = replace(
        features, reference_c=np.tile(features.reference_c, count),
        lower_c=np.tile(features.lower_c, count), upper_c=np.tile(features.upper_c, count),
        knots_c=features.knots_c * count)  # fmt: skip
    everything = np.concatenate(inputs)
    mean, deviation = (
        _by_power(values.reshape(count, -1, 1), features)[:, 0]
        for values in (everything.mean(axis=0), everything.std(axis=0))
    )
    flat = _by_power(gains, features)
    weights = 1.0 / np.where(deviation > 0, deviation, 1.0), np.ones(flat.shape[1])
    dynamics = from_gains([static_gain()], flat[np.newaxis], mean, *weights)
    if dynamics is None:
        return None
    bank = tuple(relaxation(float(tau), period_s) for tau in time_constants_s)
    return AxisModel(joined, dynamics, bank if time_constants_s.any() else ())


def _by_power(values: FloatArray, features: Features) -> FloatArray:
    """Reorder (K, F, M) from relaxation, power, thermometer to power first; flat, (K·F, M)."""
    if features.kind == 'powers':
        shape = (len(values), features.degree, features.thermometers, values.shape[2])
        values = np.moveaxis(values.reshape(shape), 1, 0)
    return values.reshape(-1, values.shape[-1])


def anchored(model: AxisModel, at_rest: Sequence[float]) -> AxisModel:
    """Shift a model's constants so that soaked at T_ref it gives these outputs, (M,)."""
    resting = model.step(model.start(model.reference_c), model.reference_c)[1]
    mean = model.dynamics.output_mean - resting + np.array(at_rest)
    return replace(model, dynamics=replace(model.dynamics, output_mean=mean))
