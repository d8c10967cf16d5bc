"""
Where a node keeps what it made: models, own recordings, and which model is active.

    <directory>/models/*.yaml        every calibration's result
    <directory>/recordings/*.csv     the node's own recordings
    <directory>/active.json          which model was live since when, and why, newest last; and
                                     which model the operator gave at the last start
    <directory>/state.json           thermal state and tare, for a restart (state_file.py)
    <directory>/days/, learning.json  of a node that learns by itself (learning/days.py)
    <directory>/lock                 held by the node that keeps its files here
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime, timezone
import fcntl
from itertools import chain, count
import os
from pathlib import Path
import re
import time
from typing import Literal
from weakref import finalize

from wrist_ft_comp.errors import ModelFileError, SettingsError
from wrist_ft_comp.stored.safe_file import Kind, MAKE_ROOM, remove_leftovers, to_plain

#: Most changes of the live model that are kept, newest last. A rollback can return to all of them.
MAX_HISTORY = 100
#: Most of the node's own recordings that a calibration uses.
MAX_RECORDINGS = 10
# A list of MAX_HISTORY models, with reasons, is shorter.
_LIST = Kind(
    name='list of models', says='wrist_ft_comp live models', version=1, max_bytes=1_000_000,
    error=ModelFileError, made_by='Remove it and set model_file.',
    renewed_by='Remove it and set model_file',
    remedy=f'{MAKE_ROOM} the model is active until the node ends.')  # fmt: skip

#: Why a model went live: a person chose it, the node learnt it, or ~/rollback went back to it.
How = Literal['chosen', 'learnt', 'back']


@dataclass(frozen=True)
class HistoryEntry:
    """A model that went live, which one, when and why."""

    #: Its file; None is no compensation.
    path: Path | None
    #: SHA-256 of its file; empty where no model is live.
    sha256: str = ''
    #: Date and time, UTC, in ISO 8601; empty for what was live before the first change.
    since: str = ''
    #: The reason in a sentence.
    why: str = ''
    how: How = 'chosen'
    #: Newest day in ``days/`` that had ended by then; empty where there was none.
    day: str = ''
    #: Whether ~/rollback went back from it or past it; another rollback does not return to it.
    withdrawn: bool = False


@dataclass(frozen=True)
class _List:
    """What active.json holds."""

    #: Paths below the node's folder are relative.
    history: tuple[HistoryEntry, ...] = ()
    #: SHA-256 of the model that the operator gave at the last start.
    given: str = ''


def model_on(history: Sequence[HistoryEntry], day: str) -> HistoryEntry | None:
    """Find the model that was live on a day: the last one that went live before it."""
    return next((entry for entry in reversed(history) if entry.day < day), None)


def day_of_choice(history: Sequence[HistoryEntry]) -> str:
    """Name the newest day before a person's last decision; empty where nobody decided."""
    return next((entry.day for entry in reversed(history) if entry.how != 'learnt'), '')


class NodeFolder:
    """A node's folder, which is made when something is first written."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        #: Leaves the folder to others.
        self.release: Callable[[], object] = lambda: None
        #: The file that names the recording that runs; after a kill it is still there.
        self._unfinished = directory / 'recordings' / 'unfinished'

    def new_model_path(self) -> Path:
        """Name a new model file after the present time (UTC)."""
        return _unused(self.directory / 'models', 'model', '.yaml')

    def discard(self, model: Path) -> None:
        """Remove a model that was never live, and its report, where the disk lets us."""
        for path in (model, model.with_suffix('.html')):
            with suppress(OSError):
                path.unlink()

    def new_recording_path(self) -> Path:
        """Name a new recording after the present time (UTC); its folder exists afterwards."""
        path = _unused(self.directory / 'recordings', 'recording', '.csv')
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def cut_off_recording(self) -> tuple[Path | None, float]:
        """Find the recording that ran when the last node here was killed, and its age, s."""
        with suppress(OSError, ValueError):
            name = self._unfinished.read_text(encoding='utf-8')
            if (path := self._unfinished.with_name(name)) in self.recordings():
                return path, time.time() - path.stat().st_mtime
        return None, 0.0

    def mark_recording(self, path: Path | None) -> None:
        """Note which recording runs, or that none does; a disk that refuses keeps none back."""
        with suppress(OSError):
            if path is None:
                self._unfinished.unlink()
            else:
                self._unfinished.write_text(path.name, encoding='utf-8')

    def recordings(self) -> list[Path]:
        """List the newest of the node's own recordings, oldest first."""
        return sorted((self.directory / 'recordings').glob('*.csv'))[-MAX_RECORDINGS:]

    def locate(self, given: str) -> Path:
        """Find a file that a person named: absolute, below ``~``, in this folder, or from here."""
        path = _expanded(given)
        with suppress(OSError, ValueError):  # no possible name, or nothing that may be looked at
            if (self.directory / path).exists():
                return self.directory / path
        return path

    def require_inside(self, name: str, given: str) -> None:
        """Refuse a file, set as parameter ``name`` at run time, that lies outside the folder."""
        is_inside = not given
        with suppress(OSError, RuntimeError, ValueError):  # a loop of links, no possible name
            end = self.locate(given).resolve()
            # Python 3.13 gives back a loop of links as it is, older ones raise.
            is_inside |= end.is_relative_to(self.directory.resolve()) and not end.is_symlink()
        if not is_inside:
            raise SettingsError(
                f'{name} set at run time must lie inside data_directory ({self.directory}), '
                f'models in models/; got {given}. Copy the file there, or give it at start-up.'
            )

    def newest_day(self) -> str:
        """Name the newest day that is kept for learning; empty where there is none."""
        with suppress(OSError):
            days = (self.directory / 'days').glob(f'day_{5 * "[0-9]"}.csv')
            return max((path.name for path in days), default='')
        return ''

    def history(self) -> list[HistoryEntry]:
        """List the models that were live, newest last."""
        return [
            entry if entry.path is None else replace(entry, path=self.directory / entry.path)
            for entry in self._read().history
        ]

    def given(self) -> str:
        """Read the SHA-256 of the model given at the last start; empty where none is known."""
        return self._read().given

    def _read(self) -> _List:
        return _LIST.load(_List, self.directory / 'active.json') or _List()

    def activate(self, history: Sequence[HistoryEntry], given: str = '') -> None:
        """Remember models that were live, newest last; ``given`` is as in ``_List``."""
        base, entries = self.directory.resolve(), []
        for entry in history[-MAX_HISTORY:]:
            path = entry.path and entry.path.resolve()
            if path and path.is_relative_to(base):
                path = path.relative_to(base)
            entries.append({**to_plain(entry), 'path': path and str(path)})
        content = {'history': entries, 'given': given}
        _LIST.save(self.directory / 'active.json', content, record=_List)

    def take(self) -> str:
        """
        Keep other nodes out until the release or the end of the process, or SettingsError.

        A disk that cannot be written or locked is no hindrance; says why nothing can be kept, or
        ''. What killed processes left half-written is removed.
        """
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            name, flags = self.directory / 'lock', os.O_CLOEXEC
            try:
                lock = os.open(name, os.O_CREAT | os.O_RDWR | flags, 0o644)
            except PermissionError:  # another user's, as of a start with sudo; it locks, too
                lock = os.open(name, os.O_RDONLY | flags)
        except OSError as error:
            return (
                f'{self.directory} cannot be written: {error.strerror}. Mend its rights, or '
                'choose another data_directory; until then no recording, calibration or thermal '
                'state is kept.'
            )
        self.release = finalize(self, os.close, lock)
        with suppress(OSError):  # some disks know no locks
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                holder = os.read(lock, 200).decode(errors='replace').strip()
                raise SettingsError(
                    f'{self.directory} is in use by another node ({holder}). Give this one a '
                    'data_directory of its own, or end the other one.'
                ) from error
            os.truncate(lock, 0)
            os.write(lock, f'process {os.getpid()} on {os.uname().nodename}\n'.encode())
        for folder in (self.directory, self.directory / 'models', self.directory / 'days'):
            remove_leftovers(folder)
        return ''


def node_directory(shared: str, node_name: str = '') -> Path:
    """Choose a node's folder: as named, or below ROS_HOME; SettingsError without a home."""
    if not shared:
        home = _expanded(os.environ.get('ROS_HOME') or '~/.ros')
        return home / 'wrist_ft_comp' / node_name.strip('/').replace('/', '__')
    directory = _expanded(shared)
    if str(directory).startswith('~'):
        raise SettingsError(
            f'data_directory is {shared}, but nobody here has a home of that name. Give an '
            'absolute path.'
        )
    return directory.absolute()


def _expanded(given: str) -> Path:
    """Resolve ``~`` where there is a home to resolve it to."""
    return Path(os.path.expanduser(given))  # noqa: PTH111 -- that of Path raises without a home


def _unused(folder: Path, stem: str, suffix: str) -> Path:
    """Name a file after the present time, numbered when several fall into a second."""
    now = datetime.now(timezone.utc).strftime('%Y%m%dT%H%M%SZ')
    # Where the clock ran back: after the newest, as the newest are taken by their names.
    stamps = (re.match(rf'{stem}_(\d{{8}}T\d{{6}}Z)', path.name) for path in folder.glob('*'))
    now = max([now, *(found[1] for found in stamps if found)])
    names = chain((f'{stem}_{now}',), (f'{stem}_{now}_{number:03}' for number in count(2)))
    return next(path for name in names if not (path := folder / f'{name}{suffix}').exists())
