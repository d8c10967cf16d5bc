"""
What every thermometer should read, as the others show it: by this, one that lies is found.

    T̂_j(k) = c_j + Σ_τ Σ_i g_jτi (H_τ T_i)(k),     g_jτj = 0        on bins of about a minute
"""

from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.errors import ModelFileError
from wrist_ft_comp.signals import FloatArray, NANOSECONDS

#: Length of a bin, s: shorter ones hold noise, longer ones find a lie later.
BIN_S = 60.0
#: Errors are averaged over this many bins before they are compared with their limit, …
AVERAGED_BINS = 5
#: … and with their average over this many bins before those: what comes loose shows by a jump.
EARLIER_BINS = 10
#: Limit where the recordings have not shown one, K.
NO_LIMIT_K = 1000.0


def bin_cells(period_ns: int) -> int:
    """Count the thermal cells of a bin."""
    return max(1, round(BIN_S * NANOSECONDS / period_ns))


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicts J thermometers from each other behind K relaxations; limits of healthy ones."""

    #: τ of the relaxations, s, shape (K,).
    time_constants_s: FloatArray
    #: g, without unit, shape (J, K, J).
    gains: FloatArray
    #: c, °C, shape (J,).
    constant_c: FloatArray
    #: Largest error of the prediction, averaged over AVERAGED_BINS, of a healthy one, K, (J,).
    limit_k: FloatArray
    #: Largest change of that error, from its average over the EARLIER_BINS before, K, (J,).
    jump_k: FloatArray
    #: Most that the prediction moves while a healthy one is silent, or the same to the last bit,
    #: K, (J,).
    still_k: FloatArray
    #: Longest silence of a healthy one, s, (J,).
    silence_s: FloatArray

    def __post_init__(self) -> None:
        count, thermometers = len(self.time_constants_s), len(self.constant_c)
        for name, shape in (
            ('gains', (thermometers, count, thermometers)),
            ('limit_k', (thermometers,)),
            ('jump_k', (thermometers,)),
            ('still_k', (thermometers,)),
            ('silence_s', (thermometers,)),
        ):
            if getattr(self, name).shape != shape:
                raise ModelFileError(
                    f'{name} of the predicted thermometers must have shape {shape}; got '
                    f'{getattr(self, name).shape}. Restore the file.'
                )

    def relax(self, relaxed_c: FloatArray, temperature_c: FloatArray, bin_s: float) -> FloatArray:
        """Advance relaxed temperatures, (K, J) or (J,), by a bin of temperatures, (J,): (K, J)."""
        slowness = bin_s / np.maximum(self.time_constants_s, bin_s / 100.0)
        poles = np.exp(-slowness)[:, np.newaxis]
        return np.asarray(temperature_c + poles * (relaxed_c - temperature_c))

    def predict(self, relaxed_c: FloatArray) -> FloatArray:
        """Predict all thermometers, °C, (J,), from relaxed temperatures, (K, J)."""
        gains = self.gains.reshape(len(self.constant_c), -1)
        return np.asarray(self.constant_c + gains @ relaxed_c.ravel())
