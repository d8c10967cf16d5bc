"""The paths on the command line: checked before work that takes minutes; what is written there."""

from collections.abc import Sequence
from pathlib import Path

from wrist_ft_comp.errors import ModelFileError, RecordingError
from wrist_ft_comp.recordings.bag import SUFFIXES
from wrist_ft_comp.recordings.chamber_table import is_chamber_table
from wrist_ft_comp.stored.model_file import is_model


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
