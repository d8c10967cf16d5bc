"""Parsers of values on the command line."""

import argparse
from collections.abc import Sequence
import math
import re

from wrist_ft_comp.core.ranges import PERIODS_S


def with_negative_values(argv: Sequence[str]) -> list[str]:
    """
    Join options with values that begin with a minus sign, which argparse takes for options.

    Parameters
    ----------
    argv : sequence of str
        As typed, such as ``--hat-temperatures -40,0,20``.

    Returns
    -------
    list of str
        Such as ``--hat-temperatures=-40,0,20``.

    """
    joined: list[str] = []
    for word in argv:
        before = joined[-1] if joined else ''
        if re.match(r'-\.?\d', word) and re.fullmatch(r'--[a-z-]+', before):
            joined[-1] = f'{before}={word}'
        else:
            joined.append(word)
    return joined


def positive(text: str) -> float:
    """
    Parse a positive number.

    Parameters
    ----------
    text : str
        As typed.

    Returns
    -------
    float
        Finite and above 0.

    Raises
    ------
    argparse.ArgumentTypeError
        When it is not.

    """
    value = _number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f'expected a number above 0, got {text}')
    return value


def not_negative(text: str) -> float:
    """
    Parse a number of at least 0.

    Parameters
    ----------
    text : str
        As typed.

    Returns
    -------
    float
        Finite and at least 0.

    Raises
    ------
    argparse.ArgumentTypeError
        When it is not.

    """
    value = _number(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f'expected a number of at least 0, got {text}')
    return value


def period(text: str) -> float:
    """
    Parse a thermal period.

    Parameters
    ----------
    text : str
        As typed.

    Returns
    -------
    float
        Within PERIODS_S.

    Raises
    ------
    argparse.ArgumentTypeError
        When it is not.

    """
    value = _number(text)
    if not PERIODS_S[0] <= value <= PERIODS_S[1]:
        raise argparse.ArgumentTypeError(
            f'expected {PERIODS_S[0]:g} to {PERIODS_S[1]:g} s, got {text}'
        )
    return value


def temperatures(text: str) -> tuple[float, ...]:
    """
    Parse temperatures that are separated by commas.

    Parameters
    ----------
    text : str
        Such as ``-40,0,20,50``.

    Returns
    -------
    tuple of float
        Increasing, without repetitions, °C.

    Raises
    ------
    argparse.ArgumentTypeError
        When one is not a number, or there are fewer than two.

    """
    found = tuple(sorted({_number(part) for part in text.split(',')}))
    if len(found) < 2:
        raise argparse.ArgumentTypeError(f'expected at least two temperatures, got {text!r}')
    return found


def _number(text: str) -> float:
    """Parse a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'expected a number, got {text!r}')
    return value
