"""The weight of the mounted payload, taken off live, in floats instead of arrays."""

from collections.abc import Sequence

import numpy as np

from wrist_ft_comp.payload.weight import ForceFrame, Payload

Force = tuple[float, float, float]


class LivePayload:
    """A payload and the frame of its specific force; ``turned`` says where that was learnt."""

    def __init__(self, name: str, payload: Payload, frame: ForceFrame, turned: str = '') -> None:
        self.name, self.payload, self.frame = name, payload, frame
        #: The same in words for people.
        self.turn = f'specific force is {frame}, {turned}'
        still = payload.weight(frame.turn(np.zeros(3)))
        gains = payload.weight(frame.turn(np.eye(3))) - still
        #: Per axis: gains of the three directions of the specific force, and a constant.
        self._rows: list[tuple[float, float, float, float]] = list(
            zip(*gains.tolist(), still.tolist(), strict=True)
        )

    def __str__(self) -> str:
        center = ', '.join(f'{coordinate:.4f}' for coordinate in self.payload.center_m)
        return f'{self.name}, {self.payload.mass_kg:.4f} kg at ({center}) m'

    def weight(self, force: Force) -> list[float]:
        """Compute its wrench at a specific force, m/s²: N and N m, axis order AXES."""
        return [-value for value in self.taken_off([0.0] * 6, force)]

    def taken_off(self, wrench: Sequence[float], force: Force) -> list[float]:
        """Subtract its wrench at a specific force, m/s², from a wrench, N and N m."""
        x, y, z = force
        return [
            w - (a * x + b * y + c * z + d)
            for w, (a, b, c, d) in zip(wrench, self._rows)  # noqa: B905 -- as in Compensator
        ]
