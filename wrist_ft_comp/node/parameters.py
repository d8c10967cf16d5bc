"""The parameters of the node ``compensator``."""

from typing import get_args

from wrist_ft_comp.fit.settings import CalibrationSettings, METHODS
from wrist_ft_comp.payload.weight import FARTHEST_M, MOST_KG
from wrist_ft_comp.ranges import PERIODS_S
from wrist_ft_comp.ros.parameters import at_start, Parameter, PROCESS_PARAMETERS
from wrist_ft_comp.signals import Reference
from wrist_ft_comp.stream.compensator import StreamSettings

_STREAM, _CALIBRATION = StreamSettings(), CalibrationSettings()

PARAMETERS = (
    *PROCESS_PARAMETERS,
    at_start(
        'wrench_topic', 'wrench_raw',
        'The raw wrench: a topic of geometry_msgs/WrenchStamped, or TOPIC:FIELD for a Wrench or '
        'WrenchStamped inside messages of any type, such as /driver/state:wrench, or for six '
        'numbers in an array, such as /driver/state:data[0..5].'),
    at_start(
        'temperature_topics', ('temperature',),
        'The thermometers, the one inside the sensor first: topics of sensor_msgs/Temperature, or '
        'TOPIC:FIELD for a number in messages of any type, such as '
        '/driver/state:joints[2].temperature, with :K or :F behind it where that is not in °C.'),
    at_start(
        'hardware_id', '',
        'Serial number of the sensor, which no topic holds. Recordings and models keep it, and a '
        'model of another sensor gives a warning.'),
    Parameter(
        'model_file', '',
        'Model to run, relative to data_directory or to the working directory; empty takes the '
        'one that was live last. Where it is the same as at the last start, the model of a '
        'calibration or rollback since then goes on. Set at run time, it must lie inside '
        'data_directory.'),
    at_start(
        'data_directory', '',
        'Where models and own recordings are kept, by several sensors in a folder each; empty '
        'takes wrist_ft_comp/NODE below ROS_HOME (or ~/.ros).'),
    at_start(
        'save_period', 5.0,
        'How often the thermal state is saved, so that a restart goes on from it; also when the '
        'node ends, and when the tare or the model changes.', 's', 0.1, 3600.0),
    at_start(
        'thermal_period', _STREAM.thermal_period_s,
        'Length of a thermal cell without a model, and in recordings; a model brings its own.',
        's', *PERIODS_S),
    at_start(
        'temperature_timeout', _STREAM.temperature_timeout_s,
        'Silence of a thermometer after which its last value is held and a warning is given.',
        's', 0.1, 3600.0),
    at_start(
        'max_drift', _STREAM.max_drift_n,
        'Largest zero drift that is subtracted from a force; from a torque, a tenth of it in N m.',
        'N', 0.0, 1e6),
    at_start(
        'max_drift_rate', _STREAM.max_drift_rate_n_s,
        'How fast the zero drift that is subtracted from a force may move; from a torque, a tenth '
        'of it in N m/s. A tare and its reset step at once; a change of model never steps.',
        'N/s', 0.001, 1e6),
    Parameter(
        'uncalibrated', 'passthrough',
        'What to publish without a model or before the first temperature: the raw wrench, tared '
        '(passthrough), or nothing (silent).', choices=('passthrough', 'silent')),
    at_start(
        'correction.rate', 10.0,
        'How often ~/correction is published.', 'Hz', 1.0, 1000.0),
    at_start(
        'gravity.source', 'none',
        'Where specific force comes from, to learn a payload and to subtract its weight: an IMU '
        'at the sensor on the topic imu, /tf and /tf_static (tf), or nothing (none).',
        choices=('none', 'imu', 'tf')),
    at_start(
        'gravity.frame', '',
        'With gravity.source tf: the frame whose z is up, against which the frame_id of the '
        'wrench turns.'),
    Parameter(
        'gravity.timeout', 0.2,
        'Age above which a specific force is not used, so that no weight is subtracted.',
        's', 0.01, 10.0),
    Parameter(
        'payload.active', '',
        'What is mounted, and subtracted on wrench_external: the name of a payload that was '
        'learnt, manual for what payload.mass and payload.center_of_mass say, or empty for none.'),
    Parameter(
        'payload.mass', 0.0,
        'With payload.active manual: mass of all that is mounted on the sensor.',
        'kg', 0.0, MOST_KG),
    Parameter(
        'payload.center_of_mass', (0.0, 0.0, 0.0),
        'With payload.active manual: its x, y and z in the frame of the wrench.',
        'm', -FARTHEST_M, FARTHEST_M),
    Parameter(
        'calibration.recordings', (),
        "Recordings to calibrate from; empty takes the node's own, the newest ten. Set at run "
        'time, they must lie inside data_directory.', element=str),
    Parameter(
        'calibration.reference', _CALIBRATION.reference,
        'The true wrench while recording: zero (unloaded), unknown but constant (constant), the '
        'weight of an unknown payload, found by the specific force (payload), or that on '
        'wrench_reference (recorded).',
        choices=get_args(Reference)),
    Parameter(
        'calibration.method', _CALIBRATION.identification.method,
        'Identification method.', choices=METHODS),
    Parameter(
        'calibration.min_temperature_span', _CALIBRATION.min_temperature_span_k,
        'A calibration is refused when no thermometer spans this much.', 'K', 0.0, 200.0),
    at_start(
        'learning', 'off',
        'Whether to keep a diary of every day and to learn from it. A better model is offered, '
        'and ~/adopt makes it live (propose), or it goes live by itself (auto); off does '
        'nothing. Needs calibration.reference payload and a gravity.source.',
        choices=('off', 'propose', 'auto')),
    at_start(
        'learning.keep_days', 30,
        'Most days that are kept; those with temperatures that no other day had are kept '
        'longest.',
        minimum=2, maximum=1000),
    at_start(
        'learning.max_mb', 500.0,
        'Most room on the disk for the days of a sensor.', 'MB', 50.0, 1e6),
    Parameter(
        'tare.duration', 1.0,
        'How long a tare averages, in stamps of the wrench.', 's', 0.01, 60.0),
    Parameter(
        'tare.max_deviation', 1.0,
        'A tare is refused when a force moves by more, or a torque by more than a tenth of it in '
        'N m.', 'N', 0.001, 1e6),
)  # fmt: skip
