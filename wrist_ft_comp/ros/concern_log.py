"""Troubles in the log: each sentence of the diagnostics once when it begins, and when all ends."""

from collections import defaultdict
from collections.abc import Sequence
import re
from typing import Any

from wrist_ft_comp.ros.diagnostics import Concern, ERROR, OK, STALE

#: Reports for which a driver may take its time to start.
_PATIENCE = 5
#: Reports without trouble after which it is over; what comes and goes is told once.
_PEACE = 10
#: What these say is not logged elsewhere.
_LOGGED = ('input', 'temperature', 'output')
#: Numbers that change from report to report, but not those of thermometers, which are names.
_NUMBERS = re.compile(r'(?<!thermometer )(?<!, )\b[\d.]+')


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
        self._reports = 0
        #: Per concern: what was told since all was well, and for how many reports it has been.
        self._told: defaultdict[str, set[str]] = defaultdict(set)
        self._well: defaultdict[str, int] = defaultdict(int)

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
        """Log one concern, if that is news."""
        told, line = self._told[concern.name], f'{concern.name}: {concern.sentence}'
        if concern.level == OK:
            self._well[concern.name] += 1
            if told and self._well[concern.name] >= _PEACE:
                told.clear()
                self._console.info(line)
            return
        self._well[concern.name] = 0
        starting = concern.level == STALE and self._reports <= _PATIENCE
        sentence = _NUMBERS.sub('#', line)
        if starting or sentence in told:
            return
        told.add(sentence)
        # One call site each: rclpy insists that a call site keeps its severity.
        if concern.level == ERROR:
            self._console.error(line)
        else:
            self._console.warning(line)
