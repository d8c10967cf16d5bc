"""What the demonstration's three programs are told: modules of ``ros``, and their arguments."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

TOPICS = ('temperature', 'temperature_2')
#: The sensor warms up, rests, works, and cools while recording; then it lives another day.
_RECORD_DUTY = ((0, 0.0), (300, 0.9), (3600, 0.0), (5700, 0.5), (8100, 1.0), (9600, 0.0))
_RECORD_S = 11400
_TEST_DUTY = ((0, 0.0), (2400, 0.7), (4800, 0.2), (6600, 1.0), (8400, 0.0), (9300, 0.6))
_TEST_S = 10800
#: Of the tool, and of the part that it picks up, kg.
TOOL_KG, PART_KG = 1.4, 0.8


@dataclass(frozen=True)
class Plan:
    """A demonstration."""

    #: Specimen of the simulated sensor, and how many times faster than real time it runs.
    seed: int
    speed: float
    #: Whether the robot works, and never stands empty.
    at_work: bool = False

    def compensator(self, folder: Path) -> list[str]:
        """Set the node up."""
        learns: dict[str, object] = {'calibration.reference': 'recorded'}
        if self.at_work:
            learns = {'calibration.reference': 'payload', 'gravity.source': 'imu'}
        where = {'data_directory': folder / 'data', 'temperature_topics': _array(TOPICS)}
        return _program('compensator', where | learns)

    def operator(self, log_file: Path) -> list[str]:
        """Tell the operator what to do."""
        work = ['--at-work'] * self.at_work
        return ['demo_client', *work, str(log_file), str(_RECORD_S), str(_TEST_S), *TOPICS]

    def sensor(self) -> list[str]:
        """Set the simulated sensor up for both days."""
        # A busy machine calibrates while hours go by here: the other day comes several times.
        days = range(_RECORD_S, _RECORD_S + 6 * _TEST_S, _TEST_S)
        test = [(day + start, level) for day in days for start, level in _TEST_DUTY]
        duty = [*_RECORD_DUTY, *test]
        works = {
            'work.tool_mass': TOOL_KG, 'work.part_mass': PART_KG, 'load.force_n': 0.0,
            'load.torque_nm': 0.0,
        }  # fmt: skip
        parameters = {
            'seed': self.seed, 'speed': self.speed, 'wrench_rate': 500.0,
            'temperature_rate': self.speed,
            'duty_cycle.start_s': _array([float(start) for start, _ in duty]),
            'duty_cycle.level': _array([float(level) for _, level in duty]),
        }  # fmt: skip
        return _program('simulated_sensor', parameters | (works if self.at_work else {}))


def _program(module: str, parameters: Mapping[str, object]) -> list[str]:
    """Name a program and its parameters, as a ROS command line."""
    pairs = (['-p', f'{name}:={value}'] for name, value in parameters.items())
    return [module, '--ros-args', *(word for pair in pairs for word in pair)]


def _array(values: Sequence[object]) -> str:
    """Write an array as ROS parameters are written."""
    return f'[{", ".join(str(value) for value in values)}]'
