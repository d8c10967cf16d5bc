"""The service ~/identify_payload: what is mounted, from a minute of motion."""

from dataclasses import dataclass
import time
from typing import Any

from wrist_ft_comp.errors import CalibrationRefusedError, WristFtCompError
from wrist_ft_comp.model.payload.learnt import payload_line
from wrist_ft_comp.ros.node_log import NodeLog
from wrist_ft_comp.ros.payload.external_wrench import ExternalWrench, Shelf
from wrist_ft_comp.ros.services.deferred import Reply
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.stream.payload import Force
from wrist_ft_comp.stream.payload_motion import DURATION_S, Identified, identify, MotionCollector

#: Wrenches or specific force that stay away for so long by a steady clock end it, s.
_PATIENCE_S = 10.0


@dataclass(eq=False)
class IdentifyService:
    """Learns a payload from the wrenches of a minute; the shelf keeps it, the answer names it."""

    _compensator: Compensator
    _external: ExternalWrench
    _shelf: Shelf
    _node_name: str
    _log: NodeLog
    #: What the last one answered; empty before the first.
    last_outcome: str = ''
    _running: tuple[MotionCollector, Reply] | None = None
    _heard_s: float = 0.0
    #: What must not change meanwhile: it would step the wrenches.
    _tare: Any = None

    @property
    def progress(self) -> float | None:
        """Tell how much of the minute has passed, 0 to 1; None when none runs."""
        return None if self._running is None else self._running[0].share

    def on_request(self, _request: Any, reply: Reply) -> None:
        """Start to collect; the answer comes after a minute of stamps."""
        if self._running is not None:
            passed = self._running[0].share * DURATION_S
            raise CalibrationRefusedError(
                f'A payload is being identified for {passed:.0f} of {DURATION_S:g} s; wait for '
                'its answer, then call again.'
            )
        if self._external.forces.newest is None:
            self._refuse(
                'No specific force has come. Set gravity.source to imu or tf, and look whether '
                'that is published.',
                reply,
            )
        elif not self._compensator.compensating:
            self._refuse(
                'No drift model runs, and drift would be taken for weight. Calibrate first, or '
                'wait for the first temperature.',
                reply,
            )
        else:
            self._running = MotionCollector(), reply
            self._tare, self._heard_s = self._compensator.external_tare, time.monotonic()
            self._external.collect(self._add)

    def _add(self, stamp_ns: int, wrench: list[float], force: Force, speed: float) -> None:
        """Take one wrench less drift, and its specific force."""
        if self._running is not None and self._running[0].share < 1:
            self._running[0].add(stamp_ns, wrench, force, speed)
            self._heard_s = time.monotonic()

    def poll(self) -> None:
        """Answer when a minute is over, or when it can't be any more."""
        if self._running is None:
            return
        collector, reply = self._running
        tared = self._compensator.external_tare is not self._tare
        silent = time.monotonic() - self._heard_s > _PATIENCE_S
        if collector.share < 1 and not tared and not silent:
            return
        self._stop()
        if tared:
            self._refuse('The tare or the model changed meanwhile. Call again.', reply)
        elif collector.share < 1:
            self._refuse(
                f'Wrenches with specific force have stayed away for {_PATIENCE_S:g} s. Look at '
                'the diagnostics, input and payload, then call again.',
                reply,
            )
        else:
            try:
                self._answer(identify(collector.cells(), self._shelf.sensor()), reply)
            except WristFtCompError as error:
                self._refuse(str(error), reply)

    def _answer(self, found: Identified, reply: Reply) -> None:
        """Keep a payload, and say what it is and how to use it."""
        name = self._shelf.keep(found.payload, found.frame)
        message = (
            f"{payload_line(name, found.payload)} in the wrench's frame. Contact was taken for "
            f'{found.contact:.0%} of the time, {found.fast:.0%} was too fast. Use it: ros2 param '
            f'set {self._node_name} payload.active {name}'
        )
        self.last_outcome = message
        self._log.info(f'identified: {message}')
        reply(success=True, message=message)

    def _refuse(self, why: str, reply: Reply) -> None:
        """Answer that nothing was learnt, and why."""
        self.last_outcome = message = f'No payload was identified: {why}'
        self._log.note_refusal('~/identify_payload', message)
        self._log.warning(message)
        reply(success=False, message=message)

    def _stop(self) -> None:
        """Collect no more."""
        self._running = None
        self._external.collect(None)

    def end(self) -> bool:
        """Stop; tell whether its asker was answered just now."""
        if self._running is None:
            return False
        reply = self._running[1]
        self._stop()
        self._refuse('The node is shutting down.', reply)
        return True
