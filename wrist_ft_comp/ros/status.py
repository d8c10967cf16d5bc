"""How it stands with one thing, and the message of all of them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
ERROR, STALE = DiagnosticStatus.ERROR, DiagnosticStatus.STALE


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


def diagnostic_array(
    stamp: Any, node_name: str, hardware_id: str, statuses: Sequence[Status]
) -> DiagnosticArray:
    """Build what goes to /diagnostics; each status is named "node: status" (REP-107)."""
    array = DiagnosticArray()
    array.header.stamp = stamp
    array.status = [
        DiagnosticStatus(
            level=status.level, name=f'{node_name}: {status.name}', message=status.message,
            hardware_id=hardware_id,
            values=[KeyValue(key=key, value=value) for key, value in status.values.items()])
        for status in statuses
    ]  # fmt: skip
    return array
