"""Limits of numbers that people choose, and numbers written for people."""

import math

import numpy as np

from wrist_ft_comp.errors import SettingsError

#: Thermal cells that a person may choose, s: longer ones would average a warm-up away.
PERIODS_S = (0.1, 600.0)


def rounded(value: float, count: int = 3) -> str:
    """Write a number with some significant figures, and never with an exponent."""
    return np.format_float_positional(value, count, unique=False, fractional=False, trim='-')


def check_range(
    name: str, value: float, least: float, most: float = math.inf, *, above: bool = False
) -> None:
    """Raise SettingsError for NaN, infinities and what lies outside; ``above`` excludes least."""
    inside = least < value <= most if above else least <= value <= most
    if math.isfinite(value) and inside:
        return
    words = range_words(least, most, above=above) or 'that is finite'
    raise SettingsError(f'{name} must be a number {words}; got {value}.')


def range_words(least: float, most: float = math.inf, *, above: bool = False) -> str:
    """Write limits as they follow the word "number"; an empty string where there are none."""
    if math.isfinite(least) and math.isfinite(most):
        return f'from {least:g} to {most:g}'
    if math.isfinite(least):
        return f'above {least:g}' if above else f'of at least {least:g}'
    return f'of at most {most:g}' if math.isfinite(most) else ''
