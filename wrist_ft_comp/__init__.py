"""
Temperature-drift compensation for a robot's wrist force/torque sensor.

The rooms, and who may look into whom (``core <- files <- {ros, cli}``, nothing points back):

- ``core``: the mathematics: recordings on the thermal grid, PLS, ARX, the drift model, its
  identification, the stream. numpy and scipy only; no files, no clock, no logging, no ROS.
- ``files``: everything that opens a file: recordings (CSV, rosbag2, chamber tables), models,
  pictures, and the calibration job that reads, fits and saves.
- ``ros``: the only modules that import rclpy: wire format, parameters, diagnostics, nodes.
- ``cli``: argument parsing, exit codes, progress bars, and every print.
"""

__version__ = '0.1.0'

#: Environment in which numpy computes in one thread. The sums of a fit are too small for more:
#: on a busy computer threads that wait for one another cost it four times the processor time.
ONE_THREAD = {'OPENBLAS_NUM_THREADS': '1', 'MKL_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1'}


class WristFtCompError(Exception):
    """
    Base of every error this package raises on purpose; its text is a sentence for the user.

    The text says what was expected, what came (value, file, channel) and what to do. Each door
    translates it once: the command line into exit code 1, a service into ``success: false``.
    """


class RecordingError(WristFtCompError):
    """A recording cannot be read or does not hold what it must."""


class ModelFileError(WristFtCompError):
    """A model file cannot be read, is of another version, or breaks the schema."""


class StateFileError(WristFtCompError):
    """A saved state cannot be read or written, is of another version, or breaks the schema."""


class SettingsError(WristFtCompError):
    """A setting is outside its range or contradicts another."""


class CalibrationRefusedError(WristFtCompError):
    """The recordings do not allow a trustworthy fit; the running model stays."""


class TooShortError(WristFtCompError):
    """There are fewer samples than the model's longest lag needs."""


class TareRefusedError(WristFtCompError):
    """The load moved, or no wrenches came, while taring."""
