"""The compensator's parameters: one table, defaults from the core's settings where it has them."""

from wrist_ft_comp.core.calibration import CalibrationSettings
from wrist_ft_comp.core.compensator import StreamSettings
from wrist_ft_comp.core.identification import METHODS
from wrist_ft_comp.core.ranges import PERIODS_S
from wrist_ft_comp.ros.parameter_table import Parameter
from wrist_ft_comp.ros.running import EXECUTOR_PARAMETER

NODE_NAME = 'wrist_ft_comp'
_STREAM = StreamSettings()
_CALIBRATION = CalibrationSettings()

#: What concerns the process, not one sensor.
PROCESS_PARAMETERS = (
    Parameter(
        'sensors',
        (),
        'Names of the sensors to serve from this process, each by a node in a namespace of that '
        'name; empty serves one sensor, in no namespace of its own.',
        read_only=True,
        element=str,
    ),
    EXECUTOR_PARAMETER,
)

PARAMETERS = (
    *PROCESS_PARAMETERS,
    Parameter(
        'temperature_topics',
        ('temperature',),
        'Topics of the thermometers; the first is the one inside the sensor.',
        read_only=True,
    ),
    Parameter(
        'model_file',
        '',
        'Model to run, relative to data_directory or to the working directory; empty takes the '
        'one that was live last. Given at start as at the start before, a calibration or rollback '
        'since then goes on. Set at run time, it must lie inside data_directory.',
    ),
    Parameter(
        'data_directory',
        '',
        'Where models and own recordings are kept, by several sensors in a folder each; empty '
        'takes wrist_ft_comp/NODE below ROS_HOME (or ~/.ros).',
        read_only=True,
    ),
    Parameter(
        'save_period',
        5.0,
        'How often the thermal state is saved, so that a restart goes on from it; also when the '
        'node ends, and when the tare or the model changes.',
        unit='s',
        minimum=0.1,
        maximum=3600.0,
        read_only=True,
    ),
    Parameter(
        'thermal_period',
        _STREAM.thermal_period_s,
        'Length of a thermal cell while no model says otherwise, and in recordings.',
        unit='s',
        minimum=PERIODS_S[0],
        maximum=PERIODS_S[1],
        read_only=True,
    ),
    Parameter(
        'temperature_timeout',
        _STREAM.temperature_timeout_s,
        'Silence of a thermometer after which its last value is held and a warning is given.',
        unit='s',
        minimum=0.1,
        maximum=3600.0,
        read_only=True,
    ),
    Parameter(
        'max_drift',
        _STREAM.max_drift_n,
        'Largest zero drift that is subtracted from a force; from a torque, a tenth of it in N m.',
        unit='N',
        minimum=0.0,
        maximum=1e6,
        read_only=True,
    ),
    Parameter(
        'max_drift_rate',
        _STREAM.max_drift_rate_n_s,
        'How fast the zero drift that is subtracted from a force may move; from a torque, a tenth '
        'of it in N m/s. A tare and its reset step at once; a change of model never steps.',
        unit='N/s',
        minimum=0.001,
        maximum=1e6,
        read_only=True,
    ),
    Parameter(
        'uncalibrated',
        'passthrough',
        'What to publish without a model or before the first temperature: the raw wrench, tared '
        '(passthrough), or nothing (silent).',
        choices=('passthrough', 'silent'),
    ),
    Parameter(
        'calibration.recordings',
        (),
        "Recordings to calibrate from; empty takes the node's own, the newest ten. Set at run "
        'time, they must lie inside data_directory.',
        element=str,
    ),
    Parameter(
        'calibration.reference',
        _CALIBRATION.reference,
        'What the true wrench was while recording: zero, an unknown constant, or recorded on '
        'wrench_reference.',
        choices=('unloaded', 'constant', 'recorded'),
    ),
    Parameter(
        'calibration.method',
        _CALIBRATION.identification.method,
        'Identification method.',
        choices=METHODS,
    ),
    Parameter(
        'calibration.min_temperature_span',
        _CALIBRATION.min_temperature_span_k,
        'A calibration is refused when no thermometer spans this much.',
        unit='K',
        minimum=0.0,
        maximum=200.0,
    ),
    Parameter(
        'tare.duration',
        1.0,
        'How long a tare averages, in stamps of the wrench.',
        unit='s',
        minimum=0.01,
        maximum=60.0,
    ),
    Parameter(
        'tare.max_deviation',
        1.0,
        'A tare is refused when a force moves by more, or a torque by more than a tenth of it in '
        'N m.',
        unit='N',
        minimum=0.001,
        maximum=1e6,
    ),
)
