"""Parameters that were given and that the node does not have: mistyped, or another node's."""

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any

from rclpy.node import Node

#: As alike are names that were confused.
_ALIKE = 0.8
_OVERRIDE = 'qos_overrides.'
#: So many names are told; a file of parameters may hold those of a whole robot.
_MOST = 8
#: What overridable() of messages.py lets parameters override.
_POLICIES = ('history', 'depth', 'reliability')


def tell_unknown(node: Node, later: Iterable[str], log: Any) -> None:
    """
    Log what was given to a node that has declared its parameters, and that it does not have.

    A name like one that it has is a warning. Others are no fault where nodes share a file.

    Parameters
    ----------
    node : Node
        All its topics are open, but those it subscribes to later.
    later : iterable of str
        The full names of these; their quality of service may be overridden, too.
    log : NodeLog, or a logger of rclpy
        Gets the sentences.

    """
    # rclpy has no public name for it.
    given: Iterable[str] = getattr(node, '_parameter_overrides', {})
    known = set(node.list_parameters([], 0).names)
    known |= {f'{_OVERRIDE}{t}.subscription.{policy}' for t in later for policy in _POLICIES}
    others = []
    for name in sorted(set(given) - known):
        near = _nearest(name, known)
        if near:
            log.warning(
                f'There is no parameter {name}, so its value is ignored. Did you mean {near}?'
            )
        else:
            others.append(name)
    if others:
        more = f' and {len(others) - _MOST} more' if len(others) > _MOST else ''
        log.info(
            f'Parameters that this node does not have are ignored: {", ".join(others[:_MOST])}'
            f'{more}.'
        )


def _nearest(name: str, known: Iterable[str]) -> str:
    """Find the known name that was probably meant; empty when there is none."""
    if not name.startswith(_OVERRIDE):
        return ''.join(get_close_matches(name, known, 1, _ALIKE))
    # Word by word: whole, the names of two topics' policies are always alike.
    topic, _, policy = name.removeprefix(_OVERRIDE).partition('.')
    overrides = [each.removeprefix(_OVERRIDE).partition('.') for each in known]
    for near in get_close_matches(topic, {each[0] for each in overrides}, 1, _ALIKE):
        policies = [each[2] for each in overrides if each[0] == near]
        for meant in get_close_matches(policy, policies, 1, _ALIKE):
            return f'{_OVERRIDE}{near}.{meant}'
    return ''
