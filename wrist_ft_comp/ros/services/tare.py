"""The services ~/tare and ~/reset_tare."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
import time
from typing import Any

import numpy as np

from wrist_ft_comp.errors import TareRefusedError, WristFtCompError
from wrist_ft_comp.model.signals import AXES, axis_unit
from wrist_ft_comp.ros.node_log import NodeLog
from wrist_ft_comp.ros.payload.external_wrench import ExternalWrench
from wrist_ft_comp.ros.services.deferred import Reply
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.stream.tare import TareCollector

#: A tare that gets no wrenches is answered this long after it should have been done, s.
_GRACE_S = 2.0


@dataclass(eq=False)
class TareService:
    """Takes a tare from the wrenches that are pushed to it; ``save`` keeps it over a restart."""

    # Where a payload is held, the external wrench is tared, too.

    _compensator: Compensator
    _external: ExternalWrench
    _settings: Callable[[], Mapping[str, Any]]
    _save: Callable[[], None]
    _log: NodeLog
    _running: tuple[TareCollector, Reply, float] | None = None
    #: Of the payload, N and N m; None where nobody knew.
    _weights: list[list[float] | None] = field(default_factory=list)

    def on_request(self, _request: Any, reply: Reply) -> None:
        """Start to collect wrenches; the answer comes when there are enough."""
        if self._running is not None:
            raise TareRefusedError('A tare is running; wait for its answer, then call again.')
        chosen = self._settings()
        collector = TareCollector(chosen['tare.duration'], chosen['tare.max_deviation'])
        deadline = time.monotonic() + chosen['tare.duration'] + _GRACE_S
        self._running, self._weights = (collector, reply, deadline), []

    def reset(self, *_: Any) -> str:
        """Forget the tare."""
        self._compensator.reset_tare()
        self._save()
        return 'the tare is zero again'

    def add(self, stamp_ns: int, raw: Sequence[float]) -> None:
        """Take one wrench, N and N m; answer when there are enough."""
        if self._running is None:
            return
        self._weights.append(self._external.weight_at(stamp_ns))
        if self._running[0].add(stamp_ns, raw):
            self._finish(*self._running)

    def poll(self) -> None:
        """Answer with what there is when wrenches stay away."""
        if self._running is not None and time.monotonic() > self._running[2]:
            self._finish(*self._running)

    def _finish(self, collector: TareCollector, reply: Reply, _: float) -> None:
        """Set the tare, or say why not."""
        self._running = None
        try:
            mean, stamp_ns = collector.result()
        except WristFtCompError as error:
            self._refuse(str(error), reply)
            return
        known = [each for each in self._weights if each is not None]
        whole = len(known) == len(self._weights)
        weight = np.mean(known, axis=0) if whole else None
        tare = self._compensator.set_tare(mean, stamp_ns, weight)
        self._save()
        offsets = ', '.join(
            f'{axis} {value:.4g} {axis_unit(axis)}' for axis, value in zip(AXES, tare, strict=True)
        )
        if self._external.payload is not None:
            offsets += '; wrench_external ' + (
                'is tared, too' if whole else 'is not: specific force stayed away meanwhile'
            )
        self._log.info(f'tared: {offsets}')
        reply(success=True, message=f'tared: {offsets}')

    def _refuse(self, why: str, reply: Reply) -> None:
        """Answer that nothing changed, and why."""
        self._log.note_refusal('~/tare', why)
        self._log.warning(f'not tared: {why}')
        reply(success=False, message=why)

    def end(self) -> bool:
        """Stop taking a tare; tell whether its asker was answered just now."""
        if self._running is None:
            return False
        reply, self._running = self._running[1], None
        self._refuse('The node is shutting down; the tare is unchanged.', reply)
        return True
