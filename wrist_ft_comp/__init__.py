"""
Temperature-drift compensation for a robot's wrist force/torque sensor.

``__all__`` is for others' programs (docs/python.md); each name is loaded when it is asked for.
docs/architecture.md says what the folders are, in the order in which they import each other.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from wrist_ft_comp.errors import WristFtCompError
    from wrist_ft_comp.fit.calibrate import calibrate
    from wrist_ft_comp.fit.paper_methods import accuracy, thermal_sensitivity_drift
    from wrist_ft_comp.fit.result import Calibration
    from wrist_ft_comp.fit.settings import CalibrationSettings
    from wrist_ft_comp.recording import Recording, Topics
    from wrist_ft_comp.recordings.read import compensate, read_recording, recording_from_columns
    from wrist_ft_comp.report.evaluation import evaluate
    from wrist_ft_comp.report.html_page import write_report
    from wrist_ft_comp.stored.model_file import load_model, save_model
    from wrist_ft_comp.stream.compensator import Compensator, StreamSettings
    from wrist_ft_comp.stream.tare import TareCollector

__version__ = '0.3.0'

#: Environment in which numpy computes in one thread. The sums of a fit are too small for more:
#: on a busy computer threads that wait for one another cost it four times the processor time.
ONE_THREAD = {'OPENBLAS_NUM_THREADS': '1', 'MKL_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1'}

#: Where the names live that are for others: as above, where type checkers read it.
_HOMES = {
    'accuracy': 'fit.paper_methods',
    'thermal_sensitivity_drift': 'fit.paper_methods',
    'calibrate': 'fit.calibrate', 'write_report': 'report.html_page',
    'Calibration': 'fit.result', 'CalibrationSettings': 'fit.settings',
    'compensate': 'recordings.read', 'recording_from_columns': 'recordings.read',
    'Compensator': 'stream.compensator', 'StreamSettings': 'stream.compensator',
    'evaluate': 'report.evaluation', 'TareCollector': 'stream.tare',
    'load_model': 'stored.model_file', 'save_model': 'stored.model_file',
    'read_recording': 'recordings.read', 'WristFtCompError': 'errors',
    'Recording': 'recording', 'Topics': 'recording',
}  # fmt: skip
__all__ = [
    'Calibration', 'CalibrationSettings', 'Compensator', 'Recording', 'StreamSettings',
    'TareCollector', 'Topics', 'WristFtCompError', 'accuracy', 'calibrate', 'compensate',
    'evaluate', 'load_model', 'read_recording', 'recording_from_columns', 'save_model',
    'thermal_sensitivity_drift', 'write_report',
]  # fmt: skip

if not TYPE_CHECKING:  # or every mistyped name would pass

    def __getattr__(name: str) -> object:
        """Load a name of ``__all__`` from its room."""
        if name not in _HOMES:
            raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
        return getattr(import_module(f'{__name__}.{_HOMES[name]}'), name)


def __dir__() -> list[str]:
    """List what is there, loaded or not."""
    return sorted({*globals(), *__all__})
