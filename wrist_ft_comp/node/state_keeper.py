"""The part for warm restarts: it saves thermal state and tare, and continues from them."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
import time
from typing import Any

from wrist_ft_comp.errors import StateFileError
from wrist_ft_comp.node.live_model import LiveModel
from wrist_ft_comp.node.raw_wrench import Counts
from wrist_ft_comp.ros.diagnostics import OK, WARN
from wrist_ft_comp.ros.hub import Part
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stored.safe_file import FileWriter
from wrist_ft_comp.stored.state_file import belongs_to, load_state, save_state, SavedState
from wrist_ft_comp.stream.compensator import Compensator

#: How often the thermal state is saved, s; also when the node ends, and when the tare or the model
#: changes. A restart goes on from it.
SAVE_PERIOD_S = 5.0


@dataclass(eq=False)
class StateKeeper(Part):
    """
    Continues from the state that the last node saved, and saves the state of this one.

    Of the writer, which all parts share, it hands out the outcomes, and waits for it at the end.
    """

    compensator: Compensator
    live: LiveModel
    counts: Counts
    writer: FileWriter
    path: Path
    #: The bytes of the tares in the file, where they are known.
    _written: tuple[bytes, bytes] = b'', b''
    #: When the state was saved that the first thermal cell decides about, ns.
    _loaded_ns: int = 0
    #: When to save next, by the steady clock.
    _due: float = 0.0
    #: What was saved last, as ``_present`` collects it; None before the first model is live.
    _saved: tuple[Any, int | None] | None = None

    title = 'state'

    def start(self) -> None:
        """Continue from the saved state, and begin to save."""
        self._due, tracker = time.monotonic() + SAVE_PERIOD_S, self.compensator.tracker
        self._origin = tracker.origin
        if why := self._restore():
            self._origin = f'{why}; the drift starts at the steady state of the first temperatures'
            tracker.origin = self._origin
            self.hub.log.warning(self._origin)
        self._saved = self._present()

    def _restore(self) -> str:
        """Continue from the saved state, where there is one; return why it cannot be used."""
        try:
            state = load_state(self.path)
        except StateFileError as error:
            return str(error).removesuffix('.')
        if state is None:
            return ''
        self.counts.payload = state.payload
        if state.model_sha256 != self.live.sha256:
            return 'the saved state belongs to another model, and so does its tare'
        self._written = state.tare.tobytes(), state.external_tare.tobytes()
        memory, model = state.thermal, self.compensator.model
        if state.tare.any() or state.external_tare.any():
            self.compensator.restore_tare(
                state.tare, state.external_tare, tared=state.tared, before_drift=memory is None
            )
            self.compensator.tare_deviation = state.tare_deviation
            self.hub.log.info('the tare from before the restart is active')
            self.counts.drivers, self.counts.weighed = set(state.drivers), state.weighed
        for doubt in state.zero_doubts:
            self.compensator.doubt_zero(doubt)
        if memory is None or model is None:
            return ''
        if not belongs_to(model, memory):
            return f'{self.path} does not fit the model it names'
        # With simulated time, the system's clock does not show how long a restart took.
        simulated = self.hub.get_parameter('use_sim_time').value
        gap_s = 0.0 if simulated else (time.time_ns() - state.saved_ns) / NANOSECONDS
        self._loaded_ns = state.saved_ns
        self.compensator.resume(memory, gap_s)
        return ''

    def _present(self) -> tuple[Any, int | None]:
        """Collect what is saved at once when it changes, and where the thermal state ends, ns."""
        stream, drivers = self.compensator, sorted(self.counts.drivers)
        tares = stream.tare.tobytes(), stream.external_tare.tobytes()
        key = (self.live.sha256, tares, [*stream.zero_doubts], drivers, self.counts.payload)
        return key, stream.tracker.end_ns if stream.compensating else None

    def poll(self) -> None:
        """Log what happened to the saved state; save where something changed or is due."""
        self.writer.poll()
        tracker = self.compensator.tracker
        if self._saved is None:
            return
        if tracker.origin != self._origin:
            self._origin = tracker.origin
            self.hub.log.write(WARN if tracker.forgot else OK, tracker.origin)
        present = self._present()
        is_due = time.monotonic() >= self._due and present != self._saved
        if is_due or present[0] != self._saved[0]:
            self.save()

    def save(self, then: Callable[[str], None] | None = None) -> None:
        """Have the present state saved; ``then`` gets why that failed, or '', when it is known."""
        stream = self.compensator
        self._due = time.monotonic() + SAVE_PERIOD_S
        self._saved = self._present()
        # A state that is not yet used does not get younger.
        saved_ns = self._loaded_ns if stream.tracker.awaited is not None else time.time_ns()
        state = SavedState(
            saved_ns, self.live.sha256, stream.tare, stream.memory(), stream.external_tare,
            stream.tared, tuple(stream.zero_doubts), tuple(sorted(self.counts.drivers)),
            self.counts.payload, self.counts.weighed, stream.tare_deviation,
        )  # fmt: skip
        model = None if self.live.stored is None else self.live.stored.path
        self.writer.put(self.path.name, partial(self._write, state, model), then)

    def _write(self, state: SavedState, model: Path | None) -> None:
        """Write a state; where that fails, no state of another tare may come back."""
        tares = state.tare.tobytes(), state.external_tare.tobytes()
        try:
            save_state(self.path, state)
        except StateFileError:
            if tares != self._written:
                with suppress(OSError):
                    self.path.unlink()
            raise
        self._written = tares
        if model is not None and not model.exists():
            raise StateFileError(
                f'{model} is gone, and after a restart drift model and tare are: put a copy of it '
                'back, or call ~/calibrate.'
            )

    def end(self) -> None:
        """Save once more, and wait for the disk."""
        if self._saved is not None and self._present() != self._saved:
            self.save()
        if not self.writer.end(timeout_s=2.0):
            self.hub.log.error(f'{self.path} was not saved: the disk does not answer.')
        elif problem := self.writer.problems.get(self.path.name):
            self.hub.log.error(problem)
        self.writer.poll()
