"""Files are written in a thread of their own, so that no wrench waits for a slow disk."""

from collections.abc import Callable
import threading

from wrist_ft_comp.errors import WristFtCompError


class FileWriter:
    """Writes files in turn; what waits for one file is written once, by the newest request."""

    def __init__(self) -> None:
        #: By name of a file, why its last write failed; empty when it did not.
        self.problems: dict[str, str] = {}
        self._waiting: dict[str, tuple[Callable[[], None], list[Callable[[str], None]]]] = {}
        #: What is to be called with the outcomes of writes.
        self._outcomes: list[tuple[Callable[[str], None], str]] = []
        self._ended = False
        self._changed = threading.Condition()
        # A daemon: a disk that never answers must not keep the process.
        self._thread = threading.Thread(target=self._run, name='file writer', daemon=True)

    def put(
        self, name: str, write: Callable[[], None], then: Callable[[str], None] | None = None
    ) -> None:
        """Have a file written; return at once. ``poll`` tells ``then`` why that failed, or ''."""
        with self._changed:
            _, callers = self._waiting.pop(name, (None, []))
            self._waiting[name] = write, [*callers, then] if then else callers
            self._changed.notify()
        if self._ended and not self._thread.is_alive():  # else the disk does not answer
            self._run()
            self.poll()
        elif self._thread.ident is None:
            self._thread.start()

    def poll(self) -> bool:
        """Tell the outcomes of writes to whoever waits for them; whether there were any."""
        with self._changed:
            outcomes, self._outcomes = self._outcomes, []
        for then, problem in outcomes:
            then(problem)
        return bool(outcomes)

    def end(self, timeout_s: float) -> bool:
        """Write what waits, and stop; False where the disk takes longer than the timeout."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        if self._thread.ident is not None:
            self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._ended)
                if not self._waiting:
                    return
                name = next(iter(self._waiting))
                write, callers = self._waiting.pop(name)
            problem = ''
            try:
                write()
            except Exception as error:  # the next file is written all the same
                fault = f'{name} was not written, by a fault of this program: {error!r}'
                problem = str(error) if isinstance(error, WristFtCompError) else fault
            with self._changed:
                self.problems[name] = problem
                self._outcomes += [(then, problem) for then in callers]
