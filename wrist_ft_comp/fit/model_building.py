"""What a fit begins and ends with: features of the recorded temperatures, and what runs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrist_ft_comp.drift.arx import relaxation, static_gain
from wrist_ft_comp.drift.arx_pls import from_gains
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Beyond, Features
from wrist_ft_comp.fit.folds import MOST_PLATEAUS
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.series import FloatArray


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
    knots = list[FloatArray]()
    if settings.features == 'hats':
        for column in (everything if observed is None else np.concatenate(list(observed))).T:
            plateaus = np.unique(column)
            if settings.hat_temperatures_c:
                plateaus = np.array(settings.hat_temperatures_c, dtype=float)
            elif len(plateaus) == 1:
                plateaus = plateaus[0] + np.array([0.0, 1.0])  # a constant needs a hat, too
            elif len(plateaus) > MOST_PLATEAUS:
                plateaus = np.linspace(plateaus[0], plateaus[-1], MOST_PLATEAUS // 2)
            knots.append(plateaus)
    return Features(
        kind=settings.features, reference_c=everything.mean(axis=0),
        lower_c=everything.min(axis=0), upper_c=everything.max(axis=0),
        degree=settings.highest_degree if settings.features == 'powers' else 1,
        knots_c=tuple(knots), beyond=beyond)  # fmt: skip


def build_axis_model(
    features: Features,
    time_constants_s: FloatArray,
    gains: FloatArray,
    inputs: Sequence[FloatArray],
    period_s: float,
) -> AxisModel | None:
    """
    Write gains of the features of K relaxed temperatures in the form that runs.

    Gains, (K·F,), are those of the zero drift, by relaxation; or (2·K·F + 1,), with those of the
    sensitivity drift and its constant behind. Relaxations become filters, and all filtered
    temperatures one set of features; inputs, (n_i, K·F), say how far they move. Soaked at T_ref
    there is no zero drift. All gains zero give None.
    """
    count, width = len(time_constants_s), len(time_constants_s) * len(features.names)
    joined = replace(
        features, reference_c=np.tile(features.reference_c, count),
        lower_c=np.tile(features.lower_c, count), upper_c=np.tile(features.upper_c, count),
        knots_c=features.knots_c * count)  # fmt: skip
    everything = np.concatenate(inputs)
    outputs = 2 if len(gains) > width else 1
    by_output = gains[: outputs * width].reshape(outputs, width)
    rows = np.stack((everything.mean(axis=0), everything.std(axis=0), *by_output))
    if features.kind == 'powers':  # from relaxation, power, thermometer to power first
        shape = len(rows), count, features.degree, features.thermometers
        rows = rows.reshape(shape).swapaxes(1, 2).reshape(len(rows), width)
    mean, deviation = rows[:2]
    weight = 1.0 / np.where(deviation > 0, deviation, 1.0)
    flat = np.ascontiguousarray(rows[2:].T)
    dynamics = from_gains([static_gain()], flat[np.newaxis], mean, weight, np.ones(outputs))
    if dynamics is None:
        return None
    bank = tuple(relaxation(tau, period_s) for tau in time_constants_s.tolist())
    model = AxisModel(joined, dynamics, bank if time_constants_s.any() else ())
    if outputs == 1:
        return anchored(model, [0.0])
    x = features.expand(features.reference_c)
    sensitivity = x @ by_output[1].reshape(count, -1).sum(axis=0) + gains[-1]
    return anchored(model, [0.0, float(sensitivity)])


def anchored(model: AxisModel, at_rest: Sequence[float]) -> AxisModel:
    """Shift a model's constants so that soaked at T_ref it gives these outputs, (M,)."""
    resting = model.step(model.start(model.reference_c), model.reference_c)[1]
    mean = model.dynamics.output_mean - resting + np.array(at_rest)
    return replace(model, dynamics=replace(model.dynamics, output_mean=mean))
