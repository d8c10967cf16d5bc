"""The learnt payloads, in a file beside the models; no name is ever given to another one."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path
import re
from typing import Literal

import numpy as np

from wrist_ft_comp.channels import LARGEST
from wrist_ft_comp.errors import ModelFileError, SettingsError
from wrist_ft_comp.payload.weight import ForceFrame, Payload
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.stored.safe_file import Document, exclusive, Kind, to_plain

#: Name of the file, in the folder of the models.
PAYLOADS = 'payloads.json'
#: Beginning of the names of payloads that ~/identify_payload found.
IDENTIFIED = 'identified'
#: No scale of an accelerometer is smaller.
_SMALLEST_SCALE = 0.01
KIND = Kind(
    name='file of payloads', says='wrist_ft_comp payloads', version=2, max_bytes=10_000_000,
    error=ModelFileError, made_by='A calibration with --reference payload makes one.',
    renewed_by='Remove it, calibrate again',
    remedy='Make room, or choose another folder.')  # fmt: skip
#: By name, oldest first.
Learnt = dict[str, tuple[Payload, ForceFrame]]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Entry(ForceFrame):
    """What a file says of a payload, and its frame; absent figures are not known."""

    mass_kg: float
    center_of_mass_m: FloatArray
    mass_error_kg: float
    center_error_m: FloatArray | None
    #: Of the time in which it was on.
    share: float
    source: Literal['imu', 'tf', ''] = ''

    def __post_init__(self) -> None:
        for name, shape in {'rotation': (3, 3), 'bias': (3,), 'scale': (3,)}.items():
            values = getattr(self, name)
            least = _SMALLEST_SCALE if name == 'scale' else -LARGEST
            if values.shape != shape or values.min() < least or values.max() > LARGEST:
                raise SettingsError(
                    f'{name} must have shape {shape} and lie from {least:g} to {LARGEST:g}; got '
                    f'{values.tolist()}.'
                )
        self.payload()  # which checks its own figures

    def payload(self) -> Payload:
        errors_m = np.full(3, np.nan) if self.center_error_m is None else self.center_error_m
        center_m, error_kg = self.center_of_mass_m, self.mass_error_kg
        return Payload(self.mass_kg, center_m, error_kg, errors_m, self.share)

    def frame(self) -> ForceFrame:
        return ForceFrame(**{part.name: getattr(self, part.name) for part in fields(ForceFrame)})


@dataclass(frozen=True)
class _Payloads:
    #: By name, oldest first.
    payloads: dict[str, _Entry]


def load_payloads(path: Path) -> Learnt:
    """Read a file of payloads; none where there is no file. ModelFileError when it is broken."""
    entries = KIND.load(_Payloads, path) or _Payloads({})
    return {name: (entry.payload(), entry.frame()) for name, entry in entries.payloads.items()}


def add_payloads(
    path: Path, stem: str, payloads: Iterable[Payload], frame: ForceFrame, more: Iterable[str] = ()
) -> list[str]:
    """Add payloads as stem-1, stem-2 …, after the names that are taken; give their names."""
    with exclusive(path.parent):
        entries = (KIND.load(_Payloads, path) or _Payloads({})).payloads
        taken = [re.fullmatch(rf'{re.escape(stem)}-(\d+)', name) for name in (*entries, *more)]
        first = 1 + max((int(match[1]) for match in taken if match), default=0)
        added = {
            f'{stem}-{number}': {**payload_figures(payload), **to_plain(frame)}
            for number, payload in enumerate(payloads, first)
        }
        KIND.save(path, {'payloads': {**to_plain(entries), **added}})
    return list(added)


def payload_figures(payload: Payload) -> Document:
    """Turn a payload into plain values; what is not known is null."""
    arrays = {name: np.asarray(value, dtype=float) for name, value in vars(payload).items()}
    values = {name: a.tolist() if np.isfinite(a).all() else None for name, a in arrays.items()}
    return {'center_of_mass_m' if k == 'center_m' else k: value for k, value in values.items()}
