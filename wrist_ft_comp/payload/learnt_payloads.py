"""Payloads that were learnt together, and the frame that their specific force was measured in."""

from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.payload.weight import ForceFrame, Payload


@dataclass(frozen=True, eq=False)
class LearntPayloads:
    """All payloads of a calibration."""

    #: Converts measured specific force to the wrench's frame.
    frame: ForceFrame
    #: By name, the lightest first.
    payloads: dict[str, Payload]

    def lines(self) -> list[str]:
        """Describe every payload in one line, and the frame in another."""
        lines = [f'payload {payload_line(*payload)}' for payload in self.payloads.items()]
        return [*lines, f'specific force {self.frame}']


def payload_line(name: str, payload: Payload) -> str:
    """Describe a payload in one line."""
    center = ', '.join(f'{1e3 * center_m:.1f}' for center_m in payload.center_m)
    line = (
        f'{name}: {payload.mass_kg:.3f} ± {payload.mass_error_kg:.2g} kg, centre of mass at '
        f'{center} mm (± {1e3 * float(np.max(payload.center_error_m)):.2g})'
    )
    return line if np.isnan(payload.share) else f'{line}, on for {payload.share:.0%} of the time'


def same_payload(one: Payload, other: Payload) -> bool:
    """Whether two payloads may be the same one: within 3 % and 5 mm, or three standard errors."""
    errors_kg = np.nan_to_num([one.mass_error_kg, other.mass_error_kg])
    errors_m = np.nan_to_num([one.center_error_m, other.center_error_m])
    apart_kg, apart_m = abs(one.mass_kg - other.mass_kg), np.abs(one.center_m - other.center_m)
    alike = apart_kg < max(0.03 * one.mass_kg, 3 * float(np.hypot(*errors_kg)))
    return alike and bool((apart_m < np.maximum(0.005, 3 * np.hypot(*errors_m))).all())
