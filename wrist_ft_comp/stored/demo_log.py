"""What the demonstration received, as a file between two processes."""

from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.signals import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class DemoLog:
    """Wrenches and temperatures as they came from the topics."""

    #: Shape (n,): stamps for which raw, compensated and reference wrench all came.
    stamps_ns: IntArray
    #: Shape (n, 6), N and N m, axis order AXES.
    raw: FloatArray
    compensated: FloatArray
    reference: FloatArray
    #: The same of wrench_external and what pushed on the tool; NaN where it did not come.
    external: FloatArray
    external_reference: FloatArray
    #: Shape (m,): the thermometers' samples, of each in turn: stamp, which one, °C.
    temperature_stamps_ns: IntArray
    thermometer: IntArray
    temperature_c: FloatArray
    #: Stamp of the last wrench before the model went live.
    calibrated_ns: int


def save_demo_log(path: Path, log: DemoLog) -> None:
    """Write a log as ``.npz``."""
    np.savez(path, **vars(log))


def load_demo_log(path: Path) -> DemoLog:
    """Read a log; refused with a RecordingError when it is not there or not whole."""
    try:
        with path.open('rb') as file, np.load(file, allow_pickle=False) as arrays:
            fields = {name: arrays[name] for name in arrays.files}
            return DemoLog(**{**fields, 'calibrated_ns': int(fields['calibrated_ns'])})
    except (OSError, EOFError, BadZipFile, ValueError, KeyError, TypeError) as error:
        raise RecordingError(
            f'{path} is not a whole log of the demonstration: {error}. Run it again.'
        ) from error
