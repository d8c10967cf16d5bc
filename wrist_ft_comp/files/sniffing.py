"""Telling a model from a recording by a first look, for whoever mixed them up."""

from pathlib import Path

from wrist_ft_comp.files.bag_file import SUFFIXES
from wrist_ft_comp.files.chamber_table import is_chamber_table
from wrist_ft_comp.files.model_file import FORMAT
from wrist_ft_comp.files.report import GENERATOR

_BEGINNING = 4096


def looks_like_model(path: Path) -> bool:
    """
    Tell whether a file names the format of models near its beginning.

    Parameters
    ----------
    path : Path
        Whatever was named; it need not exist.

    Returns
    -------
    bool
        Also True for models of versions that this package does not read.

    """
    return FORMAT.encode() in _beginning(path)


def looks_like_report(path: Path) -> bool:
    """
    Tell whether a file is a page that this package wrote.

    Parameters
    ----------
    path : Path
        Whatever was named; it need not exist.

    Returns
    -------
    bool
        True for reports of calibrations and of evaluations.

    """
    return GENERATOR.encode() in _beginning(path)


def _beginning(path: Path) -> bytes:
    """Read the beginning of a file; of what is none, nothing."""
    try:
        with path.open('rb') as file:
            return file.read(_BEGINNING)
    except (OSError, ValueError):
        return b''


def looks_like_recording(path: Path) -> bool:
    """
    Tell whether a file is named like a recording, or is a chamber table.

    Parameters
    ----------
    path : Path
        Whatever was named; it need not exist.

    Returns
    -------
    bool
        False for models.

    """
    try:
        named_so = path.is_dir() or path.suffix in {*SUFFIXES, '.csv'}
    except (OSError, ValueError):
        return False
    return (named_so or is_chamber_table(path)) and not looks_like_model(path)


def is_worth_keeping(path: Path) -> bool:
    """
    Tell whether a file holds something that a model must not overwrite.

    Parameters
    ----------
    path : Path
        Where a model is to go.

    Returns
    -------
    bool
        False when there is nothing, an empty file, or another model.

    """
    try:
        return path.is_file() and path.stat().st_size > 0 and not looks_like_model(path)
    except (OSError, ValueError):
        return False
