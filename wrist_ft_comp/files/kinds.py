"""Which kinds of recordings there are, and which of them a file is."""

from pathlib import Path

from wrist_ft_comp import RecordingError
from wrist_ft_comp.files.bag_file import SUFFIXES
from wrist_ft_comp.files.chamber_table import is_chamber_table

BAG, CSV, TABLE = 'rosbag2', 'CSV recording', 'chamber table'


def kind_of(path: Path) -> str:
    """
    Tell what kind of recording a path is, from its name and its first line.

    Parameters
    ----------
    path : Path
        File or folder.

    Returns
    -------
    str
        BAG, CSV or TABLE; CSV also for files that turn out to be nothing of the kind.

    Raises
    ------
    RecordingError
        When there is no such file, or its kind is known not to be readable.

    """
    if not path.exists():
        raise RecordingError(
            f'{path} does not exist; expected a bag folder, an .mcap, .db3 or CSV file.'
        )
    if path.is_dir() or path.suffix in SUFFIXES:
        return BAG
    if path.suffix in {'.bag', '.zstd', '.zst'}:
        raise RecordingError(
            f'{path.name} cannot be read alone. Of a compressed bag, name the folder; convert a '
            "ROS 1 bag with 'rosbags-convert'."
        )
    return TABLE if is_chamber_table(path) else CSV
