"""The payloads that a node has learnt, or finds beside the model it was given."""

from dataclasses import replace
from pathlib import Path

from wrist_ft_comp.files.payload_file import add_payloads, Learnt, load_payloads, PAYLOADS
from wrist_ft_comp.model.payload.weight import ForceFrame, Payload
from wrist_ft_comp.ros.live_model import LiveModel

#: What the names of payloads that were identified in operation begin with.
_IDENTIFIED = 'identified'


class Shelf:
    """Looks into a folder of models, and into that of the live model; source is this node's."""

    def __init__(self, models: Path, live: LiveModel, source: str) -> None:
        self._own, self._live, self.source = models / PAYLOADS, live, source

    def payloads(self) -> Learnt:
        """Read what there is, oldest first; of the same name the node's own counts."""
        stored, own = self._live.stored, load_payloads(self._own)
        beside = {} if stored is None else load_payloads(stored.path.parent / PAYLOADS)
        return {**{name: each for name, each in beside.items() if name not in own}, **own}

    def frames(self) -> dict[str, ForceFrame]:
        """Give the frames of payloads, but for those that another source told, oldest first."""
        known = {name: frame for name, (_, frame) in self.payloads().items()}
        return {name: each for name, each in known.items() if each.source in ('', self.source)}

    def sensor(self) -> ForceFrame | None:
        """Tell what the last calibration found of the accelerometer: it saw more than a minute."""
        calibrated = [
            each for name, each in self.frames().items() if not name.startswith(f'{_IDENTIFIED}-')
        ]
        return calibrated[-1] if calibrated else None

    def keep(self, payload: Payload, frame: ForceFrame) -> str:
        """Keep a payload that was identified, and name it."""
        frame = replace(frame, source=self.source)
        return add_payloads(self._own, _IDENTIFIED, [payload], frame, self.payloads())[0]
