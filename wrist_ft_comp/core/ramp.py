"""The drift between two thermal cells, as plain numbers: all that a wrench touches."""

import numpy as np

from wrist_ft_comp.core.drift import Drift
from wrist_ft_comp.core.recording import AXES, FloatArray


class Ramp:
    """
    Zero drift and gain on their way from one thermal cell's values to the next one's.

    Attributes
    ----------
    start_ns : int
        Stamp at which it began, ns; it lasts one cell.
    zero, zero_step : list of 6 floats
        Zero drift at the start, and how much it moves, N and N m, axis order AXES.
    gain, gain_step : list of 6 floats
        1 + sensitivity drift at the start, and how much it moves.

    """

    def __init__(self) -> None:
        self.start_ns = 0
        self.zero: list[float] = [0.0] * len(AXES)
        self.zero_step: list[float] = [0.0] * len(AXES)
        self.gain: list[float] = [1.0] * len(AXES)
        self.gain_step: list[float] = [0.0] * len(AXES)

    def at(self, share: float) -> tuple[FloatArray, FloatArray]:
        """
        Compute where it stands.

        Parameters
        ----------
        share : float
            Share of the ramp that is done, 0 to 1.

        Returns
        -------
        tuple of ndarrays, shape (6,)
            Zero drift and gain.

        """
        return (
            np.array(self.zero) + share * np.array(self.zero_step),
            np.array(self.gain) + share * np.array(self.gain_step),
        )

    def drift_at(self, share: float) -> Drift:
        """
        Compute where it stands, as a drift.

        Parameters
        ----------
        share : float
            Share of the ramp that is done, 0 to 1.

        Returns
        -------
        Drift
            Arrays of shape (6,).

        """
        zero, gain = self.at(share)
        return Drift(zero, gain - 1.0)

    def restart(self, start_ns: int, share: float, target: Drift) -> None:
        """
        Go to a new target from where the ramp stands.

        Parameters
        ----------
        start_ns : int
            Now, ns.
        share : float
            Share of the present ramp that is done, 0 to 1.
        target : Drift
            Arrays of shape (6,).

        """
        zero, gain = self.at(share)
        self.start_ns = start_ns
        self.zero, self.gain = zero.tolist(), gain.tolist()
        self.zero_step = (target.zero - zero).tolist()
        self.gain_step = (1.0 + target.sensitivity - gain).tolist()

    def settle(self, target: Drift) -> None:
        """
        Stand at a target.

        Parameters
        ----------
        target : Drift
            Arrays of shape (6,).

        """
        self.zero, self.gain = target.zero.tolist(), (1.0 + target.sensitivity).tolist()
        self.zero_step, self.gain_step = [0.0] * len(AXES), [0.0] * len(AXES)
