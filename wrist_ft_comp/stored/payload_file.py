"""
The learnt payloads, by name, in one JSON file beside the models.

A name is never given to another payload: a program may have set it as ``payload.active``.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
import fcntl
import os
from pathlib import Path
import re

import numpy as np

from wrist_ft_comp.errors import ModelFileError, WristFtCompError
from wrist_ft_comp.payload.weight import ForceFrame, FrameIds, Payload
from wrist_ft_comp.stored.documents import Document, Kind

#: Name of the file, in the folder of the models.
PAYLOADS = 'payloads.json'
#: Beginning of the names of payloads that ~/identify_payload found.
IDENTIFIED = 'identified'
KIND = Kind(
    name='file of payloads', says='wrist_ft_comp payloads', version=2,
    schema='payloads.schema.json', max_bytes=10_000_000, error=ModelFileError,
    made_by='A calibration with --reference payload makes one.',
    renewed_by='Remove it, calibrate again',
    unwritable='{path} cannot be written: {reason}. Make room, or choose another folder.',
)  # fmt: skip
#: By name, oldest first.
Learnt = dict[str, tuple[Payload, ForceFrame]]


def load_payloads(path: Path) -> Learnt:
    """Read a file of payloads; none where there is no file. ModelFileError when it is broken."""
    return {name: _payload(path, name, entry) for name, entry in _entries(path).items()}


def add_payloads(
    path: Path, stem: str, payloads: Iterable[Payload], frame: ForceFrame, more: Iterable[str] = ()
) -> list[str]:
    """Add payloads as stem-1, stem-2 …, after the names that are taken; give their names."""
    with _alone(path.parent):
        entries = _entries(path)
        taken = [re.fullmatch(rf'{re.escape(stem)}-(\d+)', name) for name in (*entries, *more)]
        first = 1 + max((int(match[1]) for match in taken if match), default=0)
        placed = {key: np.asarray(value).tolist() for key, value in vars(frame).items()}
        added = {
            f'{stem}-{number}': {**payload_figures(payload), **placed}
            for number, payload in enumerate(payloads, first)
        }
        KIND.write_json(path, {'payloads': {**entries, **added}})
    return list(added)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Let one process at a time change the payloads of a folder; a kill releases the lock."""
    handle = None
    with suppress(OSError):  # writing says why nothing can be written; some disks know no locks
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
        fcntl.flock(handle, fcntl.LOCK_EX)
    try:
        yield
    finally:
        if handle is not None:
            os.close(handle)


def _entries(path: Path) -> Document:
    """Read and check what a file holds."""
    entries: Document = (KIND.load_json(path) or {'payloads': {}})['payloads']
    return entries


def payload_figures(payload: Payload) -> Document:
    """Turn a payload into plain values; what is not known is null."""
    arrays = {name: np.asarray(value, dtype=float) for name, value in vars(payload).items()}
    values = {name: a.tolist() if np.isfinite(a).all() else None for name, a in arrays.items()}
    return {'center_of_mass_m' if k == 'center_m' else k: value for k, value in values.items()}


def _payload(path: Path, name: str, entry: Document) -> tuple[Payload, ForceFrame]:
    """Build a payload from an entry that was checked."""
    words = {key: entry[key] for key in ('source', *FrameIds._fields)}
    figures = {key: value for key, value in entry.items() if key not in words}
    arrays = {key: np.array(value, dtype=float) for key, value in figures.items()}  # null is NaN
    error_kg, errors_m = float(arrays['mass_error_kg']), np.zeros(3) + arrays['center_error_m']
    mass_kg, share = entry['mass_kg'], float(arrays['share'])
    try:
        payload = Payload(mass_kg, arrays['center_of_mass_m'], error_kg, errors_m, share)
    except WristFtCompError as refusal:
        raise ModelFileError(f'{name} of {path} cannot be used: {refusal}') from refusal
    return payload, ForceFrame(arrays['rotation'], arrays['bias'], arrays['scale'], **words)
