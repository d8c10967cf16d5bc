"""The node's log: the last refusal, and of the diagnostics' statuses what is news, once."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
import re
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
ERROR, STALE = DiagnosticStatus.ERROR, DiagnosticStatus.STALE

#: Reports for which a driver may take its time to start.
_PATIENCE = 5
#: Reports without trouble after which it is over; what comes and goes is told once.
_PEACE = 10
#: What these say is not logged elsewhere.
_LOGGED = ('input', 'temperature', 'payload', 'output')
#: Numbers that change from report to report, but not those of thermometers, which are names.
_NUMBERS = re.compile(r'(?<!thermometer )(?<!, )\b[\d.]+')


#: What is asked for may be as long as the asker likes; diagnostics repeat it every second.
_LONGEST_REFUSAL = 1000


@dataclass(frozen=True)
class Status:
    """How it stands with one thing, such as ``temperature``."""

    name: str
    #: OK, WARN, ERROR or STALE.
    level: bytes
    #: What is, and what to do.
    message: str
    #: Numbers behind it.
    values: dict[str, str] = field(default_factory=dict)
    #: What the message is made of, where it is several doubts.
    doubts: tuple[str, ...] = ()


def doubtful(name: str, doubts: Iterable[str], well: str, values: dict[str, str]) -> Status:
    """Make a status of all doubts, the worst first, or of what is said where there are none."""
    found = tuple(doubts)
    return Status(name, WARN if found else OK, '; '.join(found) or well, values, found)


class NodeLog:
    """A node's log, which is told of refusals, and once a second of the statuses."""

    def __init__(self, logger: Any) -> None:
        # rclpy tells call sites apart, so there is no method of ours between them and it.
        self.info, self.warning, self.error = logger.info, logger.warning, logger.error
        #: What was refused last, and why; empty before the first refusal.
        self.last_refusal = ''
        self._reports = 0
        #: Per status: what was told since all was well, and for how many reports it has been.
        self._told: dict[str, set[str]] = defaultdict(set)
        self._well: dict[str, int] = defaultdict(int)

    def note_refusal(self, what: str, why: str) -> None:
        """Remember, for the diagnostics, what was refused and why."""
        self.last_refusal = f'{what}: {why}'[:_LONGEST_REFUSAL]

    def tell(self, statuses: Iterable[Status]) -> None:
        """Log what is news in a report."""
        self._reports += 1
        for status in statuses:
            if status.name in _LOGGED:
                self._tell_one(status)

    def _tell_one(self, status: Status) -> None:
        """Log one status, if it is news."""
        told, line = self._told[status.name], f'{status.name}: {status.message}'
        doubts = status.doubts or (status.message,)
        news = [doubt for doubt in doubts if _NUMBERS.sub('#', doubt) not in told]
        if status.level == OK:
            self._well[status.name] += 1
            if told and self._well[status.name] >= _PEACE:
                told.clear()
                self.info(line)
            return
        self._well[status.name] = 0
        starting = status.level == STALE and self._reports <= _PATIENCE
        if starting or not news:
            return
        told.update(_NUMBERS.sub('#', doubt) for doubt in news)
        line = f'{status.name}: {"; ".join(news)}'
        # One call site each: rclpy insists that a call site keeps its severity.
        if status.level == ERROR:
            self.error(line)
        else:
            self.warning(line)
