"""
What every thermometer should read, as the others show it.

    T̂_j(k) = c_j + Σ_τ Σ_i g_jτi (H_τ T_i)(k),     g_jτj = 0

H_τ is a relaxation with the time constant τ, stepped once per thermal cell.
"""

from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.errors import ModelFileError
from wrist_ft_comp.series import FloatArray


@dataclass(frozen=True, eq=False)
class ThermometerPrediction:
    """Predicts J thermometers from each other behind K relaxations; what healthy ones do."""

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
            if getattr(self, name).shape != shape:
                raise ModelFileError(
                    f'{name} of the predicted thermometers must have shape {shape}; got '
                    f'{getattr(self, name).shape}. Restore the file.'
                )
            if name != 'gains' and not (getattr(self, name) >= 0).all():
                raise ModelFileError(f'{name} of the predicted thermometers must not be negative.')

    def relax(self, relaxed_c: FloatArray, temperature_c: FloatArray, time_s: float) -> FloatArray:
        """Let relaxed temperatures, (K, J), follow constant ones, °C, (J,), for some time, s."""
        # One of 0 s has forgotten everything.
        slowness = np.maximum(self.time_constants_s, np.finfo(float).eps)[:, np.newaxis]
        return np.asarray(temperature_c + np.exp(-time_s / slowness) * (relaxed_c - temperature_c))

    def predict(self, relaxed_c: FloatArray) -> FloatArray:
        """Predict all thermometers, °C, (J,), from relaxed temperatures, (K, J)."""
        gains = self.gains.reshape(len(self.constant_c), -1)
        return np.asarray(self.constant_c + gains @ relaxed_c.ravel())
