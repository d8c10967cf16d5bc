"""From fitted gains of features behind relaxations to the model that runs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrist_ft_comp.drift.arx import relaxation, static_gain
from wrist_ft_comp.drift.arx_pls import from_gains
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.signals import FloatArray


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
    """Write gains (K, F, M) of the features of K relaxed temperatures in the form that runs."""
    # Relaxations become filters, K·J filtered temperatures one set of features, and ``inputs``, of
    # ``bank_inputs``, say how far each moves. None without gains; constants stay open.
    count = len(time_constants_s)
    joined = replace(
        features, reference_c=np.tile(features.reference_c, count),
        lower_c=np.tile(features.lower_c, count), upper_c=np.tile(features.upper_c, count),
        knots_c=features.knots_c * count)  # fmt: skip
    everything = np.concatenate(inputs)
    mean, deviation = (
        _by_power(each.reshape(count, -1, 1), features)[:, 0]
        for each in (everything.mean(axis=0), everything.std(axis=0))
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
