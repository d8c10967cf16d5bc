"""wrist_ft_comp completion: a script that lets a shell complete commands, options and files."""

import argparse
from pathlib import Path

from wrist_ft_comp.errors import SettingsError

HELP = 'print a script that completes words in a shell'
DESCRIPTION = 'Print a script that lets a shell complete commands, options and files.'
EXAMPLES = """\
examples:
  wrist_ft_comp completion bash > \\
      ~/.local/share/bash-completion/completions/wrist_ft_comp
  wrist_ft_comp completion zsh > ~/.zfunc/_wrist_ft_comp

zsh looks into ~/.zfunc when ~/.zshrc says, before compinit: fpath+=~/.zfunc
"""
_SHELLS = ('bash', 'zsh')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument('shell', choices=_SHELLS, metavar='SHELL', help=', '.join(_SHELLS))


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    try:
        import shtab  # noqa: PLC0415 -- optional, and only here
    except ImportError as error:
        raise SettingsError(
            'Completion needs the package shtab, which this Python does not have. Install it '
            '(pip install shtab), then run this again.'
        ) from error
    for parser in arguments.commands.choices.values():
        for action in parser._actions:  # noqa: SLF001 -- argparse has no public list of them
            if action.type is Path:
                vars(action)['complete'] = shtab.FILE
    print(shtab.complete(arguments.whole, arguments.shell))
    return 0
