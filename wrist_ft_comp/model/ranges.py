"""Ranges of settings: a sentence for the number that lies outside."""

import math

from wrist_ft_comp.errors import SettingsError

#: Thermal cells that a person may choose, s: longer ones would average a warm-up away.
PERIODS_S = (0.1, 600.0)


def check_range(
    name: str, value: float, least: float, most: float = math.inf, *, above: bool = False
) -> None:
    """Raise SettingsError for NaN, infinities and what lies outside; ``above`` excludes least."""
    inside = least < value <= most if above else least <= value <= most
    if math.isfinite(value) and inside:
        return
    if least == -math.inf:
        words = 'that is finite'
    elif math.isfinite(most):
        words = f'from {least:g} to {most:g}'
    else:
        words = f'above {least:g}' if above else f'of at least {least:g}'
    raise SettingsError(f'{name} must be a number {words}; got {value}.')
