"""Checks of the paths on the command line, made before work that takes minutes."""

from collections.abc import Sequence
from pathlib import Path

from wrist_ft_comp.errors import ModelFileError, RecordingError
from wrist_ft_comp.files.recordings import is_worth_keeping, looks_like_model, looks_like_recording


def check_model(path: Path) -> None:
    """
    Refuse a recording in the place of a model.

    Parameters
    ----------
    path : Path
        As typed.

    Raises
    ------
    ModelFileError
        When it looks like a recording.

    """
    if path.exists() and looks_like_recording(path):
        raise ModelFileError(
            f'{path} is a recording, where a model file was expected. Name the model first, as '
            'made by wrist_ft_comp calibrate, then the recordings.'
        )


def check_recordings(paths: Sequence[Path]) -> None:
    """
    Refuse a model in the place of a recording.

    Parameters
    ----------
    paths : sequence of Path
        As typed.

    Raises
    ------
    RecordingError
        When one is a model, or named twice.

    """
    for path in paths:
        if looks_like_model(path):
            raise RecordingError(
                f'{path} is a model file, where a recording was expected. Name a bag, a CSV file '
                'or a chamber table; see what a file holds with wrist_ft_comp show.'
            )
    resolved = [path.resolve() for path in paths]
    twice = next((path for path in paths if resolved.count(path.resolve()) > 1), None)
    if twice is not None:
        raise RecordingError(f'{twice} is named twice; name each recording once.')


def check_model_target(path: Path) -> None:
    """
    Refuse to put a model in the place of something else.

    Parameters
    ----------
    path : Path
        Where the model is to go; folders on the way are made later.

    Raises
    ------
    ModelFileError
        When it is a folder, or a file that is no model.

    """
    if path.is_dir():
        raise ModelFileError(
            f'{path} is a folder; name a file in it, such as {path / "model.yaml"}.'
        )
    if is_worth_keeping(path):
        raise ModelFileError(
            f'{path} exists and is no model file, so it is not overwritten. Name another file for '
            'the model, or remove this one first.'
        )
    above = next((folder for folder in path.absolute().parents if folder.exists()), path.parent)
    if not above.is_dir():
        raise ModelFileError(f'{path} cannot be made: {above} is no folder. Name another file.')


def check_report_target(path: Path | None, others: Sequence[Path]) -> None:
    """
    Refuse a report that cannot be written, or that would overwrite something else.

    Parameters
    ----------
    path : Path or None
        Where the report is to go, if one was asked for.
    others : sequence of Path
        Model and recordings.

    Raises
    ------
    RecordingError
        When its folder is missing, it is a folder, or it is one of the others.

    """
    if path is None:
        return
    if not path.absolute().parent.is_dir():
        raise RecordingError(
            f'The report {path} cannot be written: {path.parent} is no folder. Make it first.'
        )
    if path.is_dir():
        raise RecordingError(
            f'The report {path} cannot be written: it is a folder. Name a file in it.'
        )
    if path.resolve() in {other.resolve() for other in others}:
        raise RecordingError(
            f'The report {path} would overwrite the model or a recording. Name another file.'
        )
