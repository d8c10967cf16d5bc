"""What recordings have seen, and what to do next: one list, the most useful first."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
import json
import re
import shlex
from shutil import which

import numpy as np

from wrist_ft_comp.fit.folds import mean_over
from wrist_ft_comp.recording import Recording, Reference, Topics
from wrist_ft_comp.report.evaluation import SAME_K
from wrist_ft_comp.report.verdict import Level
from wrist_ft_comp.series import FloatArray

#: Rise and fall are counted between means over this time, s, so that noise does not count.
_TREND_S = 300.0
#: A recording should last for at least this time, s.
_SHORTEST_S = 3600.0
#: Warming is missing where it is less than this share of cooling, and the other way round.
_ONE_WAY_SHARE = 0.2
#: What is warned of where a load moves (fit/outliers_and_steps.py), where thermometers are
#: exchanged (stream/exchanged_thermometers.py), and at a warm start (stream/drift_warnings.py).
_MOTION = 'swings around its levels'
_EXCHANGED = 'read what is expected of each other'
_WARM = 'begins on a warm robot'
_CALIBRATE_AGAIN = 'Calibrate again with these recordings among the others.'


@dataclass(frozen=True, eq=False)
class Coverage:
    """What all recordings have seen together."""

    #: Lowest and highest temperature of each thermometer, °C, shape (J, 2).
    range_c: FloatArray
    #: Number of the thermometer that spans most, counted from 0; advice is about this one.
    leading: int
    #: How far the leading thermometer went up, and down, in one recording at most.
    risen_k: float
    fallen_k: float


def cover(recordings: Sequence[Recording]) -> Coverage:
    """Count what recordings have seen together; at least one of them must hold a wrench."""
    seen_c = []
    for recording in recordings:
        has_wrench = np.isfinite(recording.wrench).any(axis=1, keepdims=True)
        seen_c.append(np.where(has_wrench, recording.temperature_c, np.nan))
    together_c = np.concatenate(seen_c)
    range_c = np.stack((np.nanmin(together_c, axis=0), np.nanmax(together_c, axis=0)), axis=1)
    leading = int(np.argmax(np.ptp(range_c, axis=1)))
    cells = max(round(_TREND_S / recordings[0].period_s), 1)
    means = [mean_over(one_c[:, leading], cells) for one_c in seen_c]
    moves = [np.diff(of_one[np.isfinite(of_one)]) for of_one in means]
    risen_k, fallen_k = (max(float((sign * k).clip(0).sum()) for k in moves) for sign in (1, -1))
    return Coverage(range_c, leading, risen_k, fallen_k)


@dataclass(frozen=True, eq=False)
class Case:
    """What is known when somebody asks what to do next."""

    recordings: Sequence[Recording]
    coverage: Coverage
    reference: Reference
    #: Of the axes that were recorded; one that drifts unexplained is weak.
    levels: Mapping[str, Level]
    #: What was found while reading and fitting, in sentences.
    warnings: Sequence[str]
    #: The command to go on with: it runs a model that was judged, and judges one that was learnt.
    #: Empty where a model was judged on what it was learnt from.
    run: str = ''
    #: Of an evaluation: the temperatures that the model learnt, °C.
    learnt_c: Sequence[tuple[float, float]] = ()
    #: Axes of which little is left, though they promise nothing.
    explained: Sequence[str] = ()
    #: Of an evaluation: axes whose errors are above the stated limit.
    beyond: Sequence[str] = ()
    #: Of an evaluation: axes that drift, and that the calibration did not hold.
    unlearnt: Sequence[str] = ()


def start_command() -> list[str]:
    """Give the words that start the node here; where only this package is installed, it is one."""
    return ['ros2', 'run', 'wrist_ft_comp', 'compensator'] if which('ros2') else ['compensator']


def as_yaml(path: object) -> str:
    """Write a path as the value of a parameter, which ROS 2 reads as YAML."""
    is_plain = re.fullmatch(r'[\w./~][\w./~-]*', str(path))
    return str(path) if is_plain else json.dumps(str(path), ensure_ascii=False)


def run_command(topics: Topics, model: object) -> str:
    """Write the command that runs a model on the topics of a bag."""
    words = [*start_command(), '--ros-args', '-p', f'model_file:={as_yaml(model)}']
    if topics.wrench.strip('/') != Topics.wrench.strip('/'):
        words += ['-r', f'wrench_raw:={topics.wrench}']
    if topics.temperatures != Topics.temperatures:
        words += ['-p', f'temperature_topics:={json.dumps(topics.temperatures)}']
    if topics.imu:
        words += ['-p', 'gravity.source:=imu']
        if topics.imu.strip('/') != 'imu':  # where the node hears one
            words += ['-r', f'imu:={topics.imu}']
    elif topics.gravity_frame:
        words += ['-p', 'gravity.source:=tf', '-p', f'gravity.frame:={topics.gravity_frame}']
    return shlex.join(words)


def advise(case: Case) -> tuple[str, ...]:
    """Say what to do next, the most useful first: one sentence or two for each step."""
    steps = []
    if any(_MOTION in warning for warning in case.warnings):
        steps.append(
            f'The load moved, although it was declared {case.reference}. Let the robot stand '
            'still while recording, or record its specific force and use --reference payload.'
        )
    poor = [axis for axis, level in case.levels.items() if level in {'weak', 'harmful'}]
    unexplained = [axis for axis in poor if axis not in {*case.beyond, *case.explained}]
    ranges_c = zip(case.coverage.range_c, case.learnt_c, strict=False)
    outside = [
        f'thermometer {number}' for number, (seen, learnt) in enumerate(ranges_c, start=1)
        if seen[0] < learnt[0] - SAME_K or seen[1] > learnt[1] + SAME_K
    ]  # fmt: skip
    if case.learnt_c:
        none_is_good = poor and {*case.levels.values()} <= {'weak', 'harmful', 'uncalibrated'}
        doubted = any(_EXCHANGED in warning for warning in case.warnings)
        if poor and any(_WARM in warning for warning in case.warnings):
            steps.append(
                'A recording begins on a warm robot, unless it had rested. Judge one from cold.'
            )
        if doubted or (none_is_good and len(case.learnt_c) > 1 and not steps):
            steps.append(
                'Are the thermometers in the order of the model? Where two are exchanged, every '
                'correction is wrong. Name topics or columns in the order of the calibration.'
            )
        steps += _judged(case, outside)
    count = len(case.coverage.range_c)
    if unexplained and not outside and not (count > 1 and 'good' in case.levels.values()):
        who = 'One thermometer does' if count == 1 else f'The {count} thermometers do'
        what = 'any axis' if len(unexplained) == len(case.levels) > 1 else _enumerate(unexplained)
        exchanged = ' Or the sensor was exchanged: calibrate from the recordings since then.'
        steps.append(
            f'{who} not explain {what} well: heat enters at a place without one.'
            f'{exchanged if len(case.recordings) > 1 else ""} Use another one that the recording '
            'holds (wrist_ft_comp show), or put one at the flange: where the motor heats it, or '
            'opposite.'
        )
    if case.learnt_c and poor and not steps:
        left = f'Much of the drift of {_enumerate(poor)} is left; a report says why.'
        steps.append(f'{left} {_CALIBRATE_AGAIN}')
    if harmful := [axis for axis, level in case.levels.items() if level == 'harmful']:
        steps.insert(0, f'Do not run this model: it makes {_enumerate(harmful)} worse.')
    return (*steps, *(() if case.learnt_c else _recorded(case)))


def _recorded(case: Case) -> Iterator[str]:
    """Say what another recording should hold, for a better model."""
    coverage, durations_s = case.coverage, [r.duration_s for r in case.recordings]
    leading = f'thermometer {coverage.leading + 1}' if len(coverage.range_c) > 1 else ''
    if max(durations_s) < _SHORTEST_S:
        yield (
            f'The longest recording lasts {max(durations_s) / 3600:.1f} h; record '
            f'{_SHORTEST_S / 3600:.1f} h or more.'
        )
    up, down = coverage.risen_k, coverage.fallen_k
    if min(up, down) < _ONE_WAY_SHARE * max(up, down):
        ended, other, ways = 'hot', 'cool down', 'cools down'
        if up < down:
            ended, other, ways = 'cold', 'warm up', 'warms up'
        yield (
            f'The recording ended {ended}: {leading or "the sensor"} warmed by {up:.1f} K and '
            f'cooled by {down:.1f} K. Let it {other} while recording. A lag can only be measured '
            f'if it also {ways}.'
        )
    if len(durations_s) == 1:
        yield 'Record on a second day: a model is then judged on whole days that it has not seen.'
    low_c, high_c = coverage.range_c[coverage.leading]
    where = f' at {leading}' if leading else ''
    yield (
        f'The recordings go from {low_c:.0f} to {high_c:.0f} °C{where}. If the robot gets colder '
        'or hotter, record that, too: outside of this range the correction is a guess.'
    )
    yield f'Judge this model on a recording that it has not seen:\n{case.run}'


def _judged(case: Case, outside: Sequence[str]) -> Iterator[str]:
    """Say what an evaluation asks for."""
    if case.beyond:
        yield (
            'The largest error is above the limit that the calibration stated for 9 of 10 days: '
            f'{_enumerate(case.beyond)}. See in the report (--report) when the error began: the '
            'zero may have jumped (a tare in the driver, a contact, another tool), a cable may '
            'pull, a temperature may be missing, or it is another sensor. If it is nothing of '
            'that, calibrate again with these recordings among the others.'
        )
    if outside:
        yield (
            f'In these recordings {_enumerate(outside)} left the range that the model was learnt '
            f'from; outside of it the limits say nothing. {_CALIBRATE_AGAIN}'
        )
    elif case.unlearnt:
        without = _enumerate(case.unlearnt)
        yield f'The model was learnt without {without}, whose drift stays. {_CALIBRATE_AGAIN}'
    elif case.run and {'good'} <= {*case.levels.values()} <= {'good', 'uncalibrated'}:
        yield f'The model holds on these recordings. Run it:\n{case.run}'


def _enumerate(words: Sequence[str]) -> str:
    """Write a list for people, such as ``force_x, force_y and force_z``."""
    return ' and '.join([', '.join(words[:-1]), *words[-1:]] if len(words) > 1 else words)
