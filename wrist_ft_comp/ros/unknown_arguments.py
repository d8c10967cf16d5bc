"""Parameters that were given and that the node does not have: mistyped, or another node's."""

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any

from rclpy.node import Node

#: As alike are names that were confused; those of two topics' policies always are, somewhat.
_ALIKE, _ALIKE_OVERRIDES = 0.8, 0.96
_OVERRIDE = 'qos_overrides.'
#: So many names are told; a file of parameters may hold those of a whole robot.
_MOST = 8
#: What overridable() of messages.py lets parameters override.
_POLICIES = ('history', 'depth', 'reliability')


def tell_unknown(node: Node, later: Iterable[str], log: Any) -> None:
    """Log what a node was given and has not declared; topics of ``later`` open in time."""
    # rclpy has no public name for it.
    given: Iterable[str] = getattr(node, '_parameter_overrides', {})
    known = set(node.list_parameters([], 0).names)
    known |= {f'{_OVERRIDE}{t}.subscription.{policy}' for t in later for policy in _POLICIES}
    others = []
    for name in sorted(set(given) - known):
        alike = _ALIKE_OVERRIDES if name.startswith(_OVERRIDE) else _ALIKE
        near = get_close_matches(name, known, 1, alike)
        if near:
            log.warning(
                f'There is no parameter {name}, so its value is ignored. Did you mean {near[0]}?'
            )
        else:
            others.append(name)
    if others:
        more = f' and {len(others) - _MOST} more' if len(others) > _MOST else ''
        log.info(
            f'Parameters that this node does not have are ignored: {", ".join(others[:_MOST])}'
            f'{more}.'
        )
