"""The error family: every sentence that this package says on purpose, and ranges of settings."""

import math
import re


class WristFtCompError(Exception):
    """Base of all that is raised on purpose; says what was expected, what came, what to do."""

    @classmethod
    def kind(cls) -> str:
        """Name the class, such as ``calibration_refused``: scripts read it, so classes stay."""
        return re.sub(r'(?<=[a-z])(?=[A-Z])', '_', cls.__name__.removesuffix('Error')).lower()


class UsageError(WristFtCompError):
    """The words of a command line make no sense together, whatever the files hold."""


class RecordingError(WristFtCompError):
    """A recording cannot be read or does not hold what it must."""


class ModelFileError(WristFtCompError):
    """A model file cannot be read, is of another version, or is damaged."""


class StateFileError(WristFtCompError):
    """A saved state cannot be read or written, is of another version, or is damaged."""


class OutputError(WristFtCompError):
    """A file would replace something that is not this package's, or cannot be written."""


class SettingsError(WristFtCompError):
    """A setting is outside its range or contradicts another."""


class CalibrationRefusedError(WristFtCompError):
    """The recordings do not allow a trustworthy fit; the running model stays."""


class TooShortError(WristFtCompError):
    """There are fewer samples than the model's longest lag needs."""


class NodeError(WristFtCompError):
    """A running node is not found, does not answer, or refuses what it is asked for."""


class TareRefusedError(WristFtCompError):
    """The load moved, or no wrenches came, while taring."""


def check_part(holds: bool, what: str) -> None:
    """Refuse a model with a part that contradicts the others; no program writes such."""
    if not holds:
        raise ModelFileError(f'{what} cannot be right')


def check_range(
    name: str, value: float, least: float, most: float = math.inf, *, above: bool = False
) -> None:
    """Raise SettingsError for NaN, infinities and what lies outside; ``above`` excludes least."""
    inside = least < value <= most if above else least <= value <= most
    if not (math.isfinite(value) and inside):
        words = range_words(least, most, above=above) or 'that is finite'
        raise SettingsError(f'{name} must be a number {words}; got {value}.')


def range_words(least: float, most: float = math.inf, *, above: bool = False) -> str:
    """Write limits as they follow the word "number"; an empty string where there are none."""
    if math.isfinite(least) and math.isfinite(most):
        return f'from {least:g} to {most:g}'
    if math.isfinite(least):
        return f'above {least:g}' if above else f'of at least {least:g}'
    return f'of at most {most:g}' if math.isfinite(most) else ''
