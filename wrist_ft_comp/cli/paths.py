"""Checks of the paths on the command line, made before work that takes minutes."""

from collections.abc import Sequence
from pathlib import Path

from wrist_ft_comp.errors import ModelFileError, RecordingError
from wrist_ft_comp.files.bags.bag import SUFFIXES
from wrist_ft_comp.files.chamber_table import is_chamber_table
from wrist_ft_comp.files.model_file import is_model


def _is_recording(path: Path) -> bool:
    """Tell whether what is there is named like a recording, or is a chamber table."""
    named_so = path.is_dir() or path.suffix in {*SUFFIXES, '.csv'}
    return path.exists() and not is_model(path) and (named_so or is_chamber_table(path))


def check_model(path: Path) -> None:
    """Refuse a recording in the place of a model."""
    if _is_recording(path):
        raise ModelFileError(
            f'{path} is a recording, where a model file was expected. Name the model first, as '
            'made by wrist_ft_comp calibrate, then the recordings.'
        )


def check_recordings(paths: Sequence[Path]) -> None:
    """Refuse a model in the place of a recording, and a recording that is named twice."""
    for path in paths:
        if is_model(path):
            raise RecordingError(
                f'{path} is a model file, where a recording was expected. Name a bag, a CSV file '
                'or a chamber table; see what a file holds with wrist_ft_comp show.'
            )
    resolved = [path.resolve() for path in paths]
    for path in paths:
        if resolved.count(path.resolve()) > 1:
            raise RecordingError(f'{path} is named twice; name each recording once.')


def check_report_target(path: Path | None, others: Sequence[Path]) -> None:
    """Refuse a report that cannot be written, or would overwrite the model or a recording."""
    if path is None:
        return
    problem = ''
    if not path.absolute().parent.is_dir():
        problem = f'cannot be written: {path.parent} is no folder. Make it first.'
    elif path.is_dir():
        problem = 'cannot be written: it is a folder. Name a file in it.'
    elif path.resolve() in {other.resolve() for other in others}:
        problem = 'would overwrite the model or a recording. Name another file.'
    if problem:
        raise RecordingError(f'The report {path} {problem}')
