"""Troubles in the log: each sentence of the diagnostics once when it begins, and when it ends."""

from collections.abc import Sequence
import re
from typing import Any

from wrist_ft_comp.ros.diagnostics import Concern, ERROR, OK, STALE

#: Reports for which a driver may take its time to start.
_PATIENCE = 5
#: What these say is not logged elsewhere.
_LOGGED = ('input', 'temperature', 'output')


class ConcernLog:
    """
    Logs what changes about the concerns.

    Parameters
    ----------
    console : rclpy logger
        Where to.

    """

    def __init__(self, console: Any) -> None:
        self._console = console
        self._before: dict[str, tuple[bytes, str]] = {}
        self._reports = 0

    def tell(self, concerns: Sequence[Concern]) -> None:
        """
        Log the troubles that are new, and the end of those that were.

        Parameters
        ----------
        concerns : sequence of Concern
            The present report.

        """
        self._reports += 1
        for concern in concerns:
            if concern.name in _LOGGED:
                self._tell_one(concern)

    def _tell_one(self, concern: Concern) -> None:
        """Log one concern, unless it says what it said before, numbers aside."""
        now = concern.level, re.sub(r'[\d.]+', '#', concern.sentence)
        before = self._before.get(concern.name)
        if before is None and concern.level == STALE and self._reports <= _PATIENCE:
            return
        self._before[concern.name] = now
        well = concern.level == OK and (before is None or before[0] == OK)
        if now == before or well:
            return
        line = f'{concern.name}: {concern.sentence}'
        # One call site each: rclpy insists that a call site keeps its severity.
        if concern.level == ERROR:
            self._console.error(line)
        elif concern.level == OK:
            self._console.info(line)
        else:
            self._console.warning(line)
