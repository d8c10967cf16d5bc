"""Files that are either the old one or the new one, never half of one."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import errno
import os
from pathlib import Path
import tempfile
import time

#: What a temporary neighbour's name ends with.
_SUFFIX = '.wrist_ft_comp.tmp'
#: One that is older than this is nobody's any more, s.
_ABANDONED_S = 60.0


@contextmanager
def replaced_on_success(target: Path) -> Iterator[Path]:
    """
    Lend a temporary neighbour of a file; on success it is synced and takes the file's place.

    Parameters
    ----------
    target : Path
        The file to make or replace; its folder must exist.

    Yields
    ------
    Path
        The neighbour: write it, and close it. It is removed when the block raises.

    Raises
    ------
    OSError
        When the target is a device or a pipe, which must not be replaced, or the disk refuses.

    """
    if target.exists() and not (target.is_file() or target.is_dir()):
        raise FileExistsError(errno.EEXIST, 'It is no regular file', str(target))
    handle, name = tempfile.mkstemp(_SUFFIX, f'.{target.name}.', target.parent)
    os.fchmod(handle, _mode(target))
    os.close(handle)
    neighbour = Path(name)
    try:
        yield neighbour
        sync(neighbour)
        neighbour.replace(target)
        sync(target.parent)
    except BaseException:
        with suppress(FileNotFoundError):
            neighbour.unlink()
        raise


def remove_leftovers(folder: Path) -> int:
    """
    Remove temporary neighbours that a killed process left behind.

    Parameters
    ----------
    folder : Path
        Where to look; it need not exist.

    Returns
    -------
    int
        How many were removed.

    """
    removed = 0
    for path in folder.glob(f'.*{_SUFFIX}'):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > _ABANDONED_S:
                path.unlink()
                removed += 1
    return removed


def _mode(target: Path) -> int:
    """Permissions of the file that is replaced, or what a new file would get."""
    if target.exists():
        return target.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def sync(path: Path) -> None:
    """Wait until a file's content, or a folder's entries, are on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
