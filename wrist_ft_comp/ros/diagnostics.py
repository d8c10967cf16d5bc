"""Diagnostics: one status per concern, a level, a sentence, and values (REP-107)."""

from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR
STALE = DiagnosticStatus.STALE


@dataclass(frozen=True)
class Concern:
    """
    The state of one concern.

    Attributes
    ----------
    name : str
        Such as ``temperature``.
    level : bytes
        OK, WARN, ERROR or STALE.
    sentence : str
        What is, and what to do.
    values : dict of str to str
        Numbers behind it.

    """

    name: str
    level: bytes
    sentence: str
    values: dict[str, str] = field(default_factory=dict)


def diagnostic_array(
    stamp: object, node_name: str, hardware_id: str, concerns: list[Concern]
) -> DiagnosticArray:
    """
    Build the message.

    Parameters
    ----------
    stamp : builtin_interfaces.msg.Time
        Now.
    node_name : str
        Each status is named "node: concern".
    hardware_id : str
        The sensor's frame.
    concerns : list of Concern
        In the order of the statuses.

    Returns
    -------
    DiagnosticArray
        For /diagnostics.

    """
    array = DiagnosticArray()
    array.header.stamp = stamp
    array.status = [
        DiagnosticStatus(
            level=concern.level,
            name=f'{node_name}: {concern.name}',
            message=concern.sentence,
            hardware_id=hardware_id,
            values=[KeyValue(key=key, value=value) for key, value in concern.values.items()],
        )
        for concern in concerns
    ]
    return array
