"""The features that settings and recorded temperatures ask for: reference, range and knots."""

from collections.abc import Sequence

import numpy as np

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
    """Choose reference, range and knots, where samples are, from temperatures, (N_i, J)."""
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
    """Lay the knots of one thermometer, °C."""
    if settings.hat_temperatures_c:
        return np.array(settings.hat_temperatures_c, dtype=float)
    plateaus = np.unique(temperature_c)
    if len(plateaus) == 1:
        return np.array([plateaus[0], plateaus[0] + 1.0])  # a constant needs a hat, too
    if len(plateaus) <= _MAX_PLATEAUS:
        return plateaus
    return np.linspace(plateaus[0], plateaus[-1], _EVEN_KNOTS)
