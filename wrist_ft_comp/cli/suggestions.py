"""What a mistyped word may have meant."""

import argparse
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
import difflib


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """
    Suggest the known word that is most like a mistyped one.

    Parameters
    ----------
    word : str
        As typed.
    known : iterable of str
        What it can have meant.

    Returns
    -------
    str
        A sentence with a space before it, or nothing when none is alike.

    """
    near = difflib.get_close_matches(word, list(known), 1)
    return f' Did you mean {near[0]}?' if near else ''


def one_of(choices: Collection[str]) -> Callable[[str], str]:
    """
    Make a parser of values that names the choice which a mistyped value may have meant.

    Parameters
    ----------
    choices : collection of str
        What is allowed.

    Returns
    -------
    callable
        For ``add_argument(type=…)``, beside its ``choices``.

    """

    def parse(text: str) -> str:
        if text not in choices:
            raise argparse.ArgumentTypeError(
                f'invalid choice: {text!r}; expected one of {", ".join(choices)}.'
                f'{did_you_mean(text, choices)}'
            )
        return text

    return parse


def check_words(
    parser: argparse.ArgumentParser,
    commands: Mapping[str, argparse.ArgumentParser],
    argv: Sequence[str],
) -> None:
    """
    Refuse an unknown command or option before argparse does, which knows no suggestion.

    Argparse would also name the first argument that is missing instead of the option that was
    mistyped. Ends the process with exit code 2, as argparse does.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Of all commands.
    commands : mapping of str to argparse.ArgumentParser
        By name.
    argv : sequence of str
        Arguments behind the program's name.

    """
    at = next((i for i, word in enumerate(argv) if not word.startswith('-')), len(argv))
    _check_options(parser, argv[:at])
    if at == len(argv):
        return
    command = argv[at]
    if command not in commands:
        parser.error(
            f'there is no command {command!r}; expected one of {", ".join(commands)}.'
            f'{did_you_mean(command, commands)}'
        )
    _check_options(commands[command], argv[at + 1 :])


def _check_options(parser: argparse.ArgumentParser, words: Sequence[str]) -> None:
    """Refuse a long option that is none, nor the beginning of one."""
    options = parser._option_string_actions  # noqa: SLF001 -- argparse has no public list of them
    for word in words:
        name = word.partition('=')[0]
        if name == '--':
            return
        if name.startswith('--') and not any(option.startswith(name) for option in options):
            parser.error(f'there is no option {name}.{did_you_mean(name, options)}')
