"""A bag opened: by rosbags or rosbag2_py, also without its metadata, or cut off."""

from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
from importlib import import_module
from pathlib import Path
from types import ModuleType

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings.bag import Bag, SUFFIXES, translated


def backend() -> ModuleType:
    """Choose the backend: rosbags where it can be imported, else rosbag2_py."""
    try:
        return import_module('wrist_ft_comp.recordings.rosbags_backend')
    except ImportError as no_rosbags:
        try:
            return import_module('wrist_ft_comp.recordings.rosbag2_backend')
        except ImportError as no_rosbag2:
            raise RecordingError(
                f'A bag needs rosbags ({no_rosbags}) or rosbag2_py ({no_rosbag2}), and neither '
                "can be imported. Run 'pip install rosbags', or install ros-jazzy-rosbag2-py and "
                'source ROS 2.'
            ) from no_rosbag2


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """
    Open a bag for reading, also a cut off one, for as long as the context lasts.

    A folder without ``metadata.yaml``, as a killed recorder leaves it, is read when it holds one
    storage file. Of a cut-off ``.mcap``, rosbags reads everything up to its last complete chunk.
    """
    # The backend gets the folder, or a storage file.
    chosen = path
    if path.is_dir() and not (path / 'metadata.yaml').exists():
        files = sorted(file for file in path.iterdir() if file.suffix in SUFFIXES)
        if len(files) > 1:
            raise RecordingError(
                f'{path} holds {len(files)} storage files and no metadata.yaml. Run '
                f"'ros2 bag reindex {path}', or name one of the files."
            )
        if not files:
            raise RecordingError(
                f'{path} is no bag: expected a folder with metadata.yaml or one .mcap or .db3 '
                'file. Name the folder that ros2 bag record made.'
            )
        chosen = files[0]
    if chosen.is_file() and not chosen.stat().st_size:
        raise RecordingError(f'{chosen} is empty (0 bytes); nothing was recorded. Record again.')
    journals = chosen.glob('*.db3-wal') if chosen.is_dir() else [Path(f'{chosen}-wal')]
    for journal in journals:
        if journal.exists() and journal.stat().st_size:
            database = str(journal).removesuffix('-wal')
            raise RecordingError(
                f'{journal} holds messages which are not in the bag yet: its recorder is running '
                f"or was killed. Stop it, then run: sqlite3 {database} 'PRAGMA wal_checkpoint'"
            )
    with ExitStack() as stack:
        with translated(path.name):
            bag = backend().open_bag(path.name, chosen, stack)
        yield bag
