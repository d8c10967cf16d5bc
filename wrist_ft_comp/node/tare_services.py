"""The part that answers ~/tare and ~/reset_tare."""

from collections.abc import Sequence
from dataclasses import dataclass, field
import time
from typing import Any

import numpy as np

from wrist_ft_comp.channels import AXES, axis_unit
from wrist_ft_comp.errors import TareRefusedError
from wrist_ft_comp.node.external_wrench import ExternalWrench
from wrist_ft_comp.node.raw_wrench import WrenchInput
from wrist_ft_comp.node.state_keeper import StateKeeper
from wrist_ft_comp.ros.hub import Part
from wrist_ft_comp.ros.parameters import Parameter
from wrist_ft_comp.ros.services import service, warned, Work
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.stream.tare import TareCollector

#: A tare is refused where the stamps of wrenches do not go on for this time, s.
_PATIENCE_S = 2.0
#: Specific force has to be fresh for this share of the wrenches of a tare: a sample may be late.
_FRESH_SHARE = 0.9
#: A tare is answered when it is saved, or after this time, s.
_DISK_S = 5.0


@dataclass(eq=False)
class TareService(Part):
    """Takes a tare from wrenches; where a payload is active, the external wrench is tared, too."""

    compensator: Compensator
    external: ExternalWrench
    wrenches: WrenchInput
    state_keeper: StateKeeper
    #: Collects wrenches; None when it has enough, or no tare runs.
    _collector: TareCollector | None = None
    #: Weight of the payload at every wrench, N and N m; None where it was not known.
    _weights: list[list[float] | None] = field(default_factory=list)
    #: The drift at every wrench, N and N m.
    _drifts: list[FloatArray] = field(default_factory=list)

    title = 'tare'
    parameters = (
        Parameter(
            'tare.duration', 1.0,
            'How long a tare averages, in stamps of the wrench.', 's', 0.01, 60.0),
        Parameter(
            'tare.max_deviation', 1.0,
            'A tare is refused when a force moves by more, or a torque by more than a tenth of it '
            'in N m.', 'N', 0.001, 1e6),
    )  # fmt: skip

    @service('~/reset_tare', 'forgets both tares')
    def reset(self, *_: Any) -> str:
        """Forget the tare."""
        self.compensator.reset_tare()
        self.state_keeper.save()
        return 'the tare is zero again'

    def on_wrench(self, stamp_ns: int, raw: Sequence[float], *_: Any) -> None:
        """Take one wrench, N and N m, until there are enough."""
        if self._collector is None:
            return
        self._weights.append(self.external.weight_at(stamp_ns))
        self._drifts.append(self.compensator.tared_with(stamp_ns).zero)
        if self._collector.add(stamp_ns, raw):
            self._collector = None

    @service(
        '~/tare',
        'makes the present wrench zero, with payload.active wrench_external, too; refused while '
        'the load moves',
    )
    def tare(self, _: Any) -> Work:
        """Collect wrenches for the whole time, of a living sensor, and tare."""
        chosen, payload = self.hub.chosen(), self.external.payload
        collector = TareCollector(chosen['tare.duration'], chosen['tare.max_deviation'])
        lasted_ns, went_on_s, stream = 0, time.monotonic(), self.compensator
        model, had_drift = stream.model, stream.compensating
        self._collector, self._weights, self._drifts = collector, [], []
        self.hub.listen(self, wanted=True)
        try:
            # Simulated time may be slow: the tare waits for as long as the stamps go on.
            while self._collector is not None and time.monotonic() <= went_on_s + _PATIENCE_S:
                yield
                if collector.lasted_ns != lasted_ns:
                    lasted_ns, went_on_s = collector.lasted_ns, time.monotonic()
        finally:
            self._collector = None
            self.hub.listen(self, wanted=False)
        if sick := self.wrenches.sickness():
            raise TareRefusedError(
                f'The sensor gives nothing to tare ({sick}). Look at the status input, and call '
                'again when the sensor works.'
            )
        mean, stamp_ns = collector.result()
        if dead := collector.dead(model.axes if model else ()):
            reading = ', '.join(f'{axis} {mean[AXES.index(axis)]:.4g}' for axis in dead)
            raise TareRefusedError(
                f'All wrenches of the tare are the same to the last bit ({reading}): the sensor '
                'is frozen, saturated, or not up yet. Look at its driver. Mock hardware, whose '
                'readings never change, needs no tare: do not call it there. Where the steps of '
                'the sensor are coarse, raise tare.duration.'
            )
        weights, weight = [one for one in self._weights if one is not None], None
        if why := self.external.wrong:
            if why == self.external.check.found:
                why += '; when that is mended, turn the tool about until the status says so'
        elif self.external.payload is not payload:
            why = 'payload.active changed meanwhile'
        elif payload is not None and len(weights) < _FRESH_SHARE * len(self._weights):
            why = f'specific force was fresh for {len(weights)} of {len(self._weights)} wrenches'
        elif payload is not None:
            weight = np.asarray(np.mean(weights, axis=0))
        if why:
            raise TareRefusedError(
                f'wrench_external cannot be tared: {why}. Both tares stay as they were. Look at '
                'the status payload and call again.'
            )
        if stream.model is not model or stream.compensating != had_drift:
            raise TareRefusedError(
                'The model was changed, or its drift began, while the tare was taken. Both tares '
                'stay as they were. Call again.'
            )
        # The tare is of the drift at one stamp, and a minute of a warm-up drifts.
        mean = mean + stream.tared_with(stamp_ns).zero - np.mean(self._drifts, axis=0)
        self.wrenches.note_drivers()  # a driver that has just come back is tared, too
        tare = stream.set_tare(mean, stamp_ns, weight)
        self.external.note_tare()
        problems: list[str] = []
        self.state_keeper.save(problems.append)
        asked_s = time.monotonic()
        while not problems and time.monotonic() - asked_s < _DISK_S:
            yield
        unsaved = problems[0] if problems else 'the disk does not answer'
        offsets = ', '.join(
            f'{axis} {value:.4g} {axis_unit(axis)}' for axis, value in zip(AXES, tare, strict=True)
        )
        also = '' if weight is None else '; wrench_external is tared, too'
        lost = f'A restart loses this tare: {unsaved}' if unsaved else ''
        return warned(f'tared: {offsets}{also}', lost)
