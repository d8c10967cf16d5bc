"""The diagnostics: a status, the doubts that it is made of, and the message of all of them."""

from collections.abc import Iterable
from dataclasses import dataclass, field
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
ERROR, STALE = DiagnosticStatus.ERROR, DiagnosticStatus.STALE


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


def doubtful(name: str, doubts: Iterable[str], well: str, values: dict[str, str]) -> Status:
    """Make a status of all doubts, the worst first; ``well`` is its message without doubts."""
    found = tuple(doubts)
    return Status(name, WARN if found else OK, '; '.join(found) or well, values, found)


class Growth:
    """Measures by how much counts have grown since the last report."""

    def __init__(self) -> None:
        self._at_s, self._counts = time.monotonic(), dict[str, int]()

    def since(self, **counts: int) -> tuple[dict[str, int], float]:
        """Give the growth of each count since the last call, and how long ago that was, s."""
        now_s = time.monotonic()
        elapsed_s = max(now_s - self._at_s, 1e-9)
        grown = {name: count - self._counts.get(name, 0) for name, count in counts.items()}
        self._at_s, self._counts = now_s, counts
        return grown, elapsed_s


def diagnostic_array(
    node_name: str, hardware_id: str, stamp: Any, statuses: Iterable[Status]
) -> DiagnosticArray:
    """Write statuses, each named "node: status" (REP-107); a stamp is a Time of ROS."""
    array = DiagnosticArray()
    array.header.stamp = stamp
    array.status = [
        DiagnosticStatus(
            level=status.level, name=f'{node_name.lstrip("/")}: {status.name}',
            message=status.message, hardware_id=hardware_id,
            values=[KeyValue(key=key, value=text) for key, text in status.values.items()])
        for status in statuses
    ]  # fmt: skip
    return array
