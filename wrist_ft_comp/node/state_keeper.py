"""The part for warm restarts: it saves thermal state and tare, and continues from them."""

from collections.abc import Callable
from dataclasses import dataclass
import time
from typing import Any

from wrist_ft_comp.errors import StateFileError
from wrist_ft_comp.ros.part import Part
from wrist_ft_comp.signals import NANOSECONDS
from wrist_ft_comp.stored.state_file import load_state, SavedState, StateWriter
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.stream.thermal_memory import belongs_to, ThermalMemory

#: How often the thermal state is saved, s; also when the node ends, and when the tare or the model
#: changes. A restart goes on from it.
SAVE_PERIOD_S = 5.0
#: Longest time that the node waits for the disk when it ends, s.
_END_TIMEOUT_S = 2.0
_SOAKED = 'the drift starts at the steady state of the first temperatures'


@dataclass(eq=False, kw_only=True)
class StateKeeper(Part):
    """
    Continues from the state that the last node saved, and saves the state of this one.

    ``live_sha256`` gives the hash of the live model's file.
    """

    compensator: Compensator
    live_sha256: Callable[[], str | None]
    writer: StateWriter
    #: What happened to the saved state.
    outcome: str = 'there was no saved state'
    #: The trouble with the file that was logged last.
    _complained: str = ''
    #: The saved state, until the first thermal cell decides whether it is used.
    _loaded: SavedState | None = None

    #: When to save next, by the steady clock; None before the first model is live.
    _due: float | None = None

    title = 'state'

    def on_model(self) -> None:
        """Continue from the saved state when the first model is live, and begin to save."""
        if self._due is None:
            self._due = time.monotonic() + SAVE_PERIOD_S
            self._logged_origin = self.compensator.tracker.origin
            self._restore()
            self._saved, self._saved_end_ns = self._key(), self._end_ns()

    def _restore(self) -> None:
        """Continue from the saved state, if it can be used."""
        try:
            state = load_state(self.writer.path)
        except StateFileError as error:
            self._begin_anew(str(error).removesuffix('.'))
            return
        if state is None:
            return
        if state.model_sha256 != self.live_sha256():
            self._begin_anew('the saved state belongs to another model, and so does its tare')
            return
        if state.tare.any() or state.external_tare.any():
            tares, before_drift = (state.tare, state.external_tare), state.thermal is None
            self.compensator.restore_tare(*tares, before_drift=before_drift)
            self.hub.log.info('the tare from before the restart is active')
        self.outcome = 'the saved state holds no thermal state'
        if state.thermal is not None and self.compensator.model is not None:
            self._resume(state, state.thermal, self.compensator.model)

    def _resume(self, state: SavedState, memory: ThermalMemory, model: Any) -> None:
        """Continue from a thermal state, if it can be used."""
        if not belongs_to(model, memory):
            self._begin_anew(f'{self.writer.path} does not fit the model it names')
            return
        # With simulated time, the system's clock does not show how long a restart took.
        simulated = self.hub.get_parameter('use_sim_time').value
        gap_s = 0.0 if simulated else (time.time_ns() - state.saved_ns) / NANOSECONDS
        self._loaded = state
        self.compensator.resume(memory, gap_s)
        self.outcome = self.compensator.tracker.origin

    def _begin_anew(self, why: str) -> None:
        """Say why the saved state is not used."""
        self.outcome = f'{why}; {_SOAKED}'
        self.hub.log.warning(self.outcome)

    def _key(self) -> tuple[str | None, bytes, bytes]:
        """Collect the model and the tares: a change of them is saved at once."""
        compensator = self.compensator
        tare, external = compensator.tare.tobytes(), compensator.external_tare.tobytes()
        return self.live_sha256(), tare, external

    def _end_ns(self) -> int | None:
        """Stamp of the end of the thermal state, ns; None without one."""
        tracker = self.compensator.tracker
        return tracker.end_ns if tracker.following else None

    def poll(self) -> None:
        """Log what happened to the saved state; save where something changed or is due."""
        self._log_origin()
        if self.writer.problem != self._complained:
            self._complained = self.writer.problem
            if self.writer.problem:
                self.hub.log.error(self.writer.problem)
        if self._due is None:
            return
        due = time.monotonic() >= self._due and self._end_ns() != self._saved_end_ns
        if due or self._key() != self._saved:
            self.save()

    def _log_origin(self) -> None:
        """Log how the drift started, once that is known."""
        tracker = self.compensator.tracker
        if tracker.origin == self._logged_origin:
            return
        self._logged_origin = tracker.origin
        if self._loaded is not None:
            self.outcome = self._logged_origin
            if not tracker.awaiting_gap:
                self._loaded = None
        # One call site each: rclpy insists that a call site keeps its severity.
        if tracker.forgot:
            self.hub.log.warning(self._logged_origin)
        else:
            self.hub.log.info(self._logged_origin)

    def save(self) -> None:
        """Have the present state saved; returns at once."""
        compensator = self.compensator
        self._due = time.monotonic() + SAVE_PERIOD_S
        self._saved, self._saved_end_ns = self._key(), self._end_ns()
        saved_ns = time.time_ns()
        if self._loaded is not None and compensator.tracker.awaiting_gap:
            saved_ns = self._loaded.saved_ns  # a state that is not yet used does not get younger
        model, memory = self.live_sha256(), compensator.memory()
        tares = compensator.tare, compensator.external_tare
        self.writer.put(SavedState(saved_ns, model, tares[0], memory, tares[1]))

    def end(self) -> bool:
        """Save once more, and wait for the disk."""
        if self._due is None:
            return False
        if self._end_ns() != self._saved_end_ns or self._key() != self._saved:
            self.save()
        if not self.writer.end(_END_TIMEOUT_S):
            self.hub.log.error(f'{self.writer.path} was not saved: the disk does not answer.')
        elif self.writer.problem not in {'', self._complained}:
            self.hub.log.error(self.writer.problem)
        return False
