"""What the commands share: options, checks of paths, JSON for scripts."""

import argparse
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import get_args, NoReturn

from wrist_ft_comp.errors import RecordingError, UsageError, WristFtCompError
from wrist_ft_comp.recording import Reference, Topics
from wrist_ft_comp.recordings.read import kind_of
from wrist_ft_comp.recordings.read_options import parse_options
from wrist_ft_comp.stored.model_file import KIND as MODEL
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.wire.temperature_source import parse_sources

RECORDING_HELP = (
    'a rosbag2 folder, a bare .mcap or .db3, or a table such as CSV; two tables with one clock '
    'are force.csv+temperature.csv (docs/files.md)'
)


class Parser(argparse.ArgumentParser):
    """Refuses by a UsageError of one line, where argparse would print many and end the process."""

    def error(self, message: str) -> NoReturn:
        """Leave the sentence to whoever parses."""
        raise UsageError(f'{message.rstrip(".")}. See {self.prog} --help.')


def add_recordings(parser: argparse.ArgumentParser, default: str) -> None:
    """Add recordings, and what the true wrench was in them; ``default`` says what it is else."""
    parser.add_argument('recordings', nargs='+', type=Path, metavar='REC', help=RECORDING_HELP)
    parser.add_argument(
        '--reference', choices=get_args(Reference), metavar='WHAT',
        help='the true wrench: unloaded (zero), constant (unknown), payload (the weight of what '
        'is mounted, found by the specific force; contacts are left out) or recorded (beside the '
        f'raw one); default: {default}')  # fmt: skip


def add_topics(parser: argparse.ArgumentParser) -> None:
    """Add the names of topics in bags, and what columns of tables are."""
    group = parser.add_argument_group('topics in bags')
    group.add_argument(
        '--wrench-topic', metavar='TOPIC',
        help=f"a geometry_msgs/WrenchStamped (default: the model's, else {Topics.wrench})",
    )  # fmt: skip
    group.add_argument(
        '--temperature-topic', action='append', metavar='TOPIC[:FIELD]',
        help='once per thermometer, the one inside the sensor first: a topic of '
        'sensor_msgs/Temperature, or a number in other messages, with a factor, and its unit, C '
        "(default), K or F: '/driver/state:joints[wrist].temp:K', '/plc/state:data[3]*0.1' "
        f"(default: the model's, else {Topics.temperatures[0]})")  # fmt: skip
    group.add_argument(
        '--reference-topic', default=Topics.reference, metavar='TOPIC',
        help='(default: %(default)s)')  # fmt: skip
    group.add_argument(
        '--imu-topic', default='', metavar='TOPIC',
        help='a sensor_msgs/Imu at the sensor, for gravity in its frame')  # fmt: skip
    group.add_argument(
        '--gravity-frame', default='', metavar='FRAME',
        help='without an IMU: gravity by /tf, from the rotation between FRAME, whose z is up, and '
        'the frame_id of the wrench')  # fmt: skip
    log = parser.add_argument_group('logs of other programs')
    log.add_argument(
        '--columns', default='', metavar='NAME=COLUMN[:UNIT],…',
        help="what a table's columns are: 'stamp=time,force_z=fz:kN,temperature_c=temp:F' "
        '(default: recording.yaml beside it, or its own names)')  # fmt: skip
    log.add_argument(
        '--time', default='', metavar='FORM',
        help='what its stamps are: s, ms, us, ns, min, h, d, excel, datenum, iso, timedelta, or a '
        'form such as "%%d.%%m.%%y %%H:%%M"')  # fmt: skip


def add_part_and_report(parser: argparse.ArgumentParser) -> None:
    """Add which part of recordings counts, report, and JSON; for commands that learn or judge."""
    part = parser.add_argument_group('a part of the recordings')
    part.add_argument(
        '--from', dest='begin', default='', metavar='TIME',
        help='leave out what was before, of each recording: 80min, 1.5h or 1:20:00')  # fmt: skip
    part.add_argument(
        '--until', dest='end', default='', metavar='TIME', help='leave out what was after'
    )
    part.add_argument(
        '--exclude', action='append', default=[], metavar='A..B',
        help='leave out the wrenches from A to B, such as 79min..81min; repeatable')  # fmt: skip
    parser.add_argument('--report', type=Path, metavar='REPORT.html', help='write a report, too')
    add_json(parser)


def topics_from(arguments: argparse.Namespace, paths: Sequence[Path]) -> Topics:
    """
    Build the topics that were given, or the model's; SettingsError if not meant so.

    RecordingError where a path holds no recording.
    """
    usual = load_model(arguments.model).topics if 'model' in arguments else Topics()
    temperatures = tuple(arguments.temperature_topic or usual.temperatures)
    parse_sources(temperatures, lambda topic: topic.strip('/'))
    topics = Topics(
        arguments.wrench_topic or usual.wrench, temperatures, arguments.reference_topic,
        arguments.imu_topic, arguments.gravity_frame,
        columns=arguments.columns, time=arguments.time,
        begin=getattr(arguments, 'begin', ''), end=getattr(arguments, 'end', ''),
        exclude=tuple(getattr(arguments, 'exclude', ())))  # fmt: skip
    parse_options(topics)
    for path in paths:
        kind_of(path)
        if MODEL.is_own(path):
            raise RecordingError(
                f'{path} is a model file, where a recording was expected. Name a bag or a CSV '
                'file; see what a file holds with wrist_ft_comp show.'
            )
    return topics


def require_ros(refusal: type[WristFtCompError], why: str) -> None:
    """Refuse to go on where Python finds no rclpy; ``why`` says what it is needed for."""
    if find_spec('rclpy') is None:
        raise refusal(
            f'{why}, which this Python does not have. Source a ROS 2 installation, or install the '
            'package with its extra "ros".'
        )


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add the form of output that scripts read."""
    parser.add_argument('--json', action='store_true', help='print JSON for scripts')
