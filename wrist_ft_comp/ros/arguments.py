"""The ``--help`` of a node, and parameters that it does not have."""

from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
import json
from textwrap import fill
from typing import Any

from rclpy.node import Node

from wrist_ft_comp.ros.parameters import Parameter
from wrist_ft_comp.ros.rclpy_internals import given_parameters

_WIDTH = 79
_INDENT = ' ' * 6
#: A name is taken for a mistyped one from this similarity on, 0 to 1.
_SIMILAR = 0.8
#: The same for overrides of quality of service, whose names are always similar.
_SIMILAR_OVERRIDES = 0.96
_OVERRIDE = 'qos_overrides.'
#: Most unknown names that the log lists: a file may hold the parameters of a whole robot.
_LISTED_NAMES = 8
#: Policies that overridable() of qos.py lets parameters override.
_POLICIES = ('history', 'depth', 'reliability')


def usage(
    name: str, what: str, table: Sequence[Parameter], *ends: tuple[str, Mapping[str, str]]
) -> str:
    """Explain a node: its name, what it does, its ends (title, name to purpose), parameters."""
    lines = [f'usage: {name} --ros-args [-p NAME:=VALUE ...] [-r FROM:=TO ...]\n', what]
    for title, purposes in ends:
        lines += [title, *(_entry(end, f'{purpose}.') for end, purpose in purposes.items()), '']
    lines.append('parameters (-p, or --params-file FILE); * may change while the node runs:')
    for row in table:
        default: Any = list(row.default) if isinstance(row.default, tuple) else row.default
        text = f'{row.description} Must be {row.allowed}; default: {json.dumps(default)}.'
        lines.append(_entry(f'{row.name}{"" if row.read_only else " *"}', text))
    return '\n'.join([*lines, ''])


def _entry(name: str, text: str) -> str:
    """Write a name, and a text below it."""
    return f'  {name}\n{fill(text, _WIDTH, initial_indent=_INDENT, subsequent_indent=_INDENT)}'


def warn_of_unknown(node: Node, later: Iterable[str], log: Any) -> None:
    """
    Log the parameters that a node was given and does not have: a warning per mistyped name.

    The node has declared its parameters and opened its topics, but for those that it may subscribe
    to later, which come by their full names.
    """
    names = set(node.list_parameters([], 0).names)
    names |= {
        f'{_OVERRIDE}{topic}.subscription.{policy}' for topic in later for policy in _POLICIES
    }
    others = []
    for name in sorted(set(given_parameters(node)) - names):
        similar = _SIMILAR_OVERRIDES if name.startswith(_OVERRIDE) else _SIMILAR
        near = get_close_matches(name, names, 1, similar)
        if near:
            log.warning(
                f'There is no parameter {name}, so its value is ignored. Did you mean {near[0]}?'
            )
        else:
            others.append(name)
    if others:
        more = len(others) - _LISTED_NAMES
        log.info(
            'Parameters that this node does not have are ignored: '
            f'{", ".join(others[:_LISTED_NAMES])}{f" and {more} more" if more > 0 else ""}.'
        )
