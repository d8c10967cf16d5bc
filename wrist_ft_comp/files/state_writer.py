"""
Saving beside the stream: a thread that does nothing but write state files.

Waiting for a disk takes milliseconds to seconds. A thread that waits there does not hold the
interpreter, so the callbacks of a node go on.
"""

from pathlib import Path
import threading
import time

from wrist_ft_comp import StateFileError
from wrist_ft_comp.files.state_file import save_state, SavedState


class StateWriter:
    """
    Writes the newest state it was given; those that were overtaken are left out.

    Parameters
    ----------
    path : Path
        The state file.

    """

    def __init__(self, path: Path) -> None:
        #: Why the last save failed; empty when it did not.
        self.problem = ''
        #: How many states were written.
        self.written = 0
        #: How long the last save took, s.
        self.took_s = 0.0
        self._path = path
        self._newest: SavedState | None = None
        self._ended = False
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None

    def put(self, state: SavedState) -> None:
        """Have a state saved soon; returns at once."""
        with self._changed:
            self._newest = state
            self._changed.notify()
        if self._thread is None:
            # A daemon: a disk that never answers must not keep the process.
            self._thread = threading.Thread(target=self._run, name='state writer', daemon=True)
            self._thread.start()

    def end(self, timeout_s: float) -> bool:
        """
        Save what was put, and stop.

        Parameters
        ----------
        timeout_s : float
            How long to wait for the disk, s.

        Returns
        -------
        bool
            Whether everything was done in time.

        """
        with self._changed:
            self._ended = True
            self._changed.notify()
        if self._thread is None:
            return True
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        """Write until the end."""
        while (state := self._take()) is not None:
            before = time.monotonic()
            try:
                save_state(self._path, state)
            except StateFileError as error:
                self.problem = str(error)
            else:
                self.problem = ''
                self.written += 1
            self.took_s = time.monotonic() - before

    def _take(self) -> SavedState | None:
        """Wait for a state; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._newest is not None or self._ended)
            state, self._newest = self._newest, None
            return state
