"""The ``--help`` of a node, and arguments that no node reads."""

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
import json
from textwrap import fill
from typing import Any

from rclpy.node import Node

from wrist_ft_comp.ros.parameters import Parameter

HELP = ('-h', '--help')
_WIDTH = 79
_INDENT = ' ' * 6
#: A name is taken for a mistyped one from this similarity on, 0 to 1.
_SIMILAR = 0.8
#: The same for overrides of quality of service, whose names are always similar.
_SIMILAR_OVERRIDES = 0.96
_OVERRIDE = 'qos_overrides.'
#: Most unknown names that the log lists: a file may hold the parameters of a whole robot.
_LISTED_NAMES = 8
#: Policies that overridable() of messages.py lets parameters override.
_POLICIES = ('history', 'depth', 'reliability')


def usage(name: str, what: str, table: Sequence[Parameter]) -> str:
    """Explain a node: its name, what it does and with which topics, and its parameters."""
    return '\n'.join(
        [
            f'usage: {name} --ros-args [-p NAME:=VALUE ...] [-r FROM:=TO ...]\n',
            what,
            'parameters (-p, or --params-file FILE); * may change while the node runs:',
            *map(_entry, table),
            '',
        ]
    )


def _entry(row: Parameter) -> str:
    """Describe a parameter: name, default, what is allowed, what it does."""
    default: Any = list(row.default) if isinstance(row.default, tuple) else row.default
    text = f'{row.description} Must be {row.allowed}; default: {json.dumps(default)}.'
    indented = fill(text, _WIDTH, initial_indent=_INDENT, subsequent_indent=_INDENT)
    return f'  {row.name}{"" if row.read_only else " *"}\n{indented}'


def tell_unknown(node: Node, later: Iterable[str], log: Any) -> None:
    """
    Log the parameters that a node was given and does not have: a warning per mistyped name.

    The node has declared its parameters and opened its topics, but for those that it may subscribe
    to later, which come by their full names.
    """
    # rclpy has no public name for it.
    given: Iterable[str] = getattr(node, '_parameter_overrides', {})
    names = set(node.list_parameters([], 0).names)
    names |= {
        f'{_OVERRIDE}{topic}.subscription.{policy}' for topic in later for policy in _POLICIES
    }
    others = []
    for name in sorted(set(given) - names):
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
