"""What a node says of its state: statuses and their doubts, and the log of them."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
import re
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
ERROR, STALE = DiagnosticStatus.ERROR, DiagnosticStatus.STALE
#: The first reports, in which a stale status is not logged: a driver may take time to start.
_PATIENCE_REPORTS = 5
#: The log says that a trouble is over after this many reports without it. Trouble that returns
#: sooner is logged once.
_QUIET_REPORTS = 10
#: Growth counts as late for this time, s.
_LATELY_S = 10.0
#: Numbers that change from report to report, but not those of thermometers, which are names.
_NUMBERS = re.compile(r'(?<!thermometer )(?<!, )\b[\d.]+')


@dataclass(frozen=True)
class Status:
    """The state of one thing, such as ``temperature``."""

    name: str
    #: OK, WARN, ERROR or STALE.
    level: bytes
    #: What is the case, and what to do.
    message: str
    #: The numbers behind the message.
    values: dict[str, str] = field(default_factory=dict)
    #: The sentences that the message is made of, where there are several.
    doubts: tuple[str, ...] = ()


def doubtful(
    name: str, doubts: Iterable[str], well: str, values: dict[str, str], level: bytes = WARN
) -> Status:
    """Make a status of all doubts, the worst first; ``well`` is its message without doubts."""
    found = tuple(doubts)
    return Status(name, level if found else OK, '; '.join(found) or well, values, found)


class Growth:
    """Measures by how much counts have grown since the last report, and remembers which did."""

    def __init__(self) -> None:
        self._at_s, self._counts = time.monotonic(), dict[str, int]()
        #: When each count grew last, by the steady clock.
        self._grew_s: dict[str, float] = {}

    def since(self, **counts: int) -> tuple[dict[str, int], float]:
        """Give the growth of each count since the last call, and how long ago that was, s."""
        now_s = time.monotonic()
        elapsed_s = max(now_s - self._at_s, 1e-9)
        grown = {name: count - self._counts.get(name, 0) for name, count in counts.items()}
        self._grew_s |= {name: now_s for name, more in grown.items() if more > 0}
        self._at_s, self._counts = now_s, counts
        return grown, elapsed_s

    def lately(self) -> set[str]:
        """Name the counts that had grown at a report of the last ten seconds."""
        return {name for name, at_s in self._grew_s.items() if at_s > self._at_s - _LATELY_S}


class NodeLog:
    """A node's log; it is given refusals, and once a second the statuses that it shall log."""

    def __init__(self, logger: Any) -> None:
        self.info, self.warning, self.error = logger.info, logger.warning, logger.error
        self._reports = 0
        #: Sentences that were logged since a status was well, by its name.
        self._logged: dict[str, set[str]] = defaultdict(set)
        #: For how many reports a status has been well, by its name.
        self._well: dict[str, int] = defaultdict(int)

    def write(self, level: bytes, line: str) -> None:
        """Log a line at the level of a status."""
        # One call site each: rclpy insists that a call site keeps its severity.
        if level == OK:
            self.info(line)
        elif level == ERROR:
            self.error(line)
        else:
            self.warning(line)

    def report(self, statuses: Iterable[Status]) -> None:
        """Log what is new in statuses, and what has been well for long."""
        self._reports += 1
        for status in statuses:
            logged = self._logged[status.name]
            if status.level == OK:
                self._well[status.name] += 1
                if logged and self._well[status.name] >= _QUIET_REPORTS:
                    logged.clear()
                    self.info(f'{status.name}: {status.message}')
                continue
            self._well[status.name] = 0
            doubts = status.doubts or (status.message,)
            news = [doubt for doubt in doubts if _NUMBERS.sub('#', doubt) not in logged]
            starting = status.level == STALE and self._reports <= _PATIENCE_REPORTS
            if starting or not news:
                continue
            logged.update(_NUMBERS.sub('#', doubt) for doubt in news)
            self.write(status.level, f'{status.name}: {"; ".join(news)}')
