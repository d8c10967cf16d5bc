"""What a person chose about the structure of the model."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import get_args, Literal

import numpy as np

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.identification.pls_arx import OuterInnerMethod
from wrist_ft_comp.model.arx import Orders
from wrist_ft_comp.model.features import FeatureKind, Features
from wrist_ft_comp.model.signals import FloatArray

Method = OuterInnerMethod | Literal['arx_pls_oe', 'auto']


METHODS: tuple[Method, ...] = (*get_args(OuterInnerMethod), 'arx_pls_oe', 'auto')


#: More distinct temperatures than this are no plateaus; hats then get evenly spaced knots.
_MAX_PLATEAUS = 12


_EVEN_KNOTS = 6


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
        if self.degree not in {1, 2, 3, 4}:
            raise SettingsError(f'The degree must be between 1 and 4; got {self.degree}.')
        if self.latents is not None and not 1 <= self.latents < np.inf:
            raise SettingsError(f'At least 1 latent is needed; got {self.latents}.')
        knots = np.array(self.hat_temperatures_c, dtype=float)
        if len(knots) == 1 or not (np.isfinite(knots).all() and (np.diff(knots) > 0).all()):
            raise SettingsError(
                f'hat_temperatures_c needs at least 2 temperatures that ascend; got '
                f'{knots.tolist()}.'
            )


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
    if len(plateaus) == 1:
        return np.array([plateaus[0], plateaus[0] + 1.0])  # a constant needs a hat, too
    if len(plateaus) <= _MAX_PLATEAUS:
        return plateaus
    return np.linspace(plateaus[0], plateaus[-1], _EVEN_KNOTS)
