"""Payloads that were learnt, by name, and the frame that their specific force was measured in."""

from dataclasses import dataclass, replace

from wrist_ft_comp.model.payload.weight import ForceFrame, Payload


@dataclass(frozen=True, eq=False)
class LearntPayloads:
    """
    Payloads that were learnt together.

    Attributes
    ----------
    frame : ForceFrame
        How measured specific force leads to the wrench's frame.
    payloads : dict
        By name, lightest first.

    """

    frame: ForceFrame
    payloads: dict[str, Payload]

    def named(self, stem: str) -> 'LearntPayloads':
        """Name them for the model they belong to: stem-1, stem-2 …."""
        numbered = enumerate(self.payloads.values(), 1)
        return replace(self, payloads={f'{stem}-{n}': payload for n, payload in numbered})
