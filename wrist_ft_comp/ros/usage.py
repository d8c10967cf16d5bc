"""What ``--help`` of a node shows, and words on its command line that nothing reads."""

from collections.abc import Sequence
import json
from textwrap import fill
from typing import Any

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.ros.parameters import Parameter

HELP = ('-h', '--help')
_WIDTH, _INDENT = 79, ' ' * 6


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


def refuse_strays(words: Sequence[str]) -> None:
    """Refuse words of a command line that stand outside of --ros-args: nothing would read them."""
    strays, behind = [], False
    for word in words[1:]:
        if word in {'--ros-args', '--'}:
            behind = word == '--ros-args'
        elif not behind:
            strays.append(word)
    if strays:
        raise SettingsError(
            f'Nothing reads {" ".join(strays)!r}: arguments of a node stand behind --ros-args, '
            'such as --ros-args -p NAME:=VALUE. --help shows them all.'
        )
