"""
The parameters of the executable ``simulated_sensor``, and the run that they describe.

Defaults of a run come from the core's settings.
"""

from typing import Any

from wrist_ft_comp.core.simulated_run import RunSettings
from wrist_ft_comp.ros.parameters import Parameter
from wrist_ft_comp.ros.running import EXECUTOR_PARAMETER

_RUN = RunSettings()


def _row(name: str, default: Any, description: str, **more: Any) -> Parameter:
    """Make a row that is read at start-up only, as all are: a run is fixed when it begins."""
    return Parameter(name, default, description, read_only=True, **more)


PARAMETERS = (
    EXECUTOR_PARAMETER,
    _row('seed', 1, 'Draws the specimen of the sensor, its gauges and their places.', minimum=0),
    _row('run', 0, 'Draws noise, loads and room of this run, for the same sensor.', minimum=0),
    _row('speed', 1.0, 'Simulated seconds per wall second.', minimum=0.01, maximum=10000.0),
    _row('wrench_rate', 100.0, 'Wrenches per wall second.', unit='Hz',
         minimum=0.1, maximum=8000.0),
    _row('temperature_rate', 10.0, 'Temperatures per wall second, of each thermometer.',
         unit='Hz', minimum=0.1, maximum=1000.0),
    _row('frame_id', 'wrist_ft', 'Frame of the messages.'),
    _row('start_stamp_s', 0.0, 'First stamp; 0 means the time of the start.', unit='s',
         minimum=0.0, maximum=2.0**31 - 1),
    _row('wait_for_subscriber', True,
         'Whether the run waits for a subscriber of one of its topics, and for a second in which '
         'no other comes.'),
    _row('room_temperature_c', _RUN.room_c, 'Mean room temperature.', unit='°C',
         minimum=-40.0, maximum=85.0),
    _row('room_swing_k', _RUN.room_swing_k, 'Amplitude of the slow swing of the room temperature.',
         unit='K', minimum=0.0, maximum=20.0),
    _row('room_swing_period_s', _RUN.room_swing_period_s, 'Period of that swing.',
         unit='simulated s', minimum=1.0),
    _row('load.force_n', _RUN.force_n, 'Largest force of an axis; 0 is unloaded.', unit='N',
         minimum=0.0, maximum=1000.0),
    _row('load.torque_nm', _RUN.torque_nm, 'Largest torque of an axis; 0 is unloaded.',
         unit='N m', minimum=0.0, maximum=100.0),
    _row('load.period_s', _RUN.load_period_s, 'About the time from one peak of load to the next.',
         unit='simulated s', minimum=0.1),
    _row('duty_cycle.start_s', _RUN.duty_start_s,
         'Ascending times at which the duty cycle of the motor changes.', unit='simulated s',
         minimum=0.0),
    _row('duty_cycle.level', _RUN.duty_level, 'Duty cycle from each of these times on.',
         minimum=0.0, maximum=1.0),
)  # fmt: skip


def run_settings(chosen: dict[str, Any]) -> RunSettings:
    """
    Translate the parameters of a run.

    Parameters
    ----------
    chosen : dict
        Value by parameter name, as ``values`` reads them.

    Returns
    -------
    RunSettings
        The run they describe.

    Raises
    ------
    SettingsError
        When the duty schedule cannot be followed.

    """
    return RunSettings(
        duty_start_s=chosen['duty_cycle.start_s'],
        duty_level=chosen['duty_cycle.level'],
        room_c=chosen['room_temperature_c'],
        room_swing_k=chosen['room_swing_k'],
        room_swing_period_s=chosen['room_swing_period_s'],
        force_n=chosen['load.force_n'],
        torque_nm=chosen['load.torque_nm'],
        load_period_s=chosen['load.period_s'],
    )
