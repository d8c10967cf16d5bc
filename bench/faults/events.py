"""
What happens to the robot of ``truth.py``: EVENTS, each a script that says what it waits for.

Drivers, clocks, thermometers, disk and operator are attributes of ``robot.Robot``. A script
changes them, yields how many seconds it waits, and puts them back.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from robot import CLOCKS, IMU, OTHER_FRAME, OWN_FRAME, PART, Robot, TOOL, TURN

#: What happens, in steps: it waits for the seconds that it yields.
Script = Callable[[Robot], Iterator[float]]


def sick(name: str, how: str, least_s: float, most_s: float, *, tare: bool = False) -> Script:
    """Let the driver (wrench) or the IMU do something for some time; perhaps tare meanwhile."""

    def script(robot: Robot) -> Iterator[float]:
        if (name == 'imu' and robot.gravity != 'imu' and how != 'silent') or getattr(robot, name):
            return
        setattr(robot, name, how)
        yield robot.between(least_s, most_s)
        if tare:
            yield from robot.tare()
            yield robot.between(least_s, most_s)
        setattr(robot, name, '')

    return script


def one_thermometer(how: str, least_s: float, most_s: float) -> Script:
    """
    Let a thermometer do something for some time.

    Nobody can know at once that a single one froze, nor that it came loose while the node was off
    (docs/reliability.md, "What is not covered").
    """

    def script(robot: Robot) -> Iterator[float]:
        j = int(robot.rng.integers(robot.thermometers))
        unseen = how == 'frozen' or (how == 'loose' and robot.node is None)
        if robot.thermometers > 1 or not unseen:
            robot.thermometer[j] = how
            yield robot.between(least_s, most_s)
            robot.thermometer[j] = ''

    return script


def exchanged(robot: Robot) -> Iterator[float]:
    """Exchange two thermometers for hours; nobody can know it at once where they read the same."""
    if robot.thermometers > 1 and robot.apart_k() > 3:
        robot.lies[:2] = 1, 0
        yield robot.between(1800, 7200)
        robot.lies[:2] = 0, 1


def clock(source: str, *, stands_still: bool) -> Script:
    """Let the clock of a source stand still for some time, or differ by seconds to hours."""

    def script(robot: Robot) -> Iterator[float]:
        by_s = float(robot.rng.choice([-1, 1]) * 10 ** robot.between(0.5, 4.5))
        if stands_still:
            robot.stopped[source] = robot.stamp(source)
        else:
            robot.ahead_s[source] += by_s
        yield robot.between(20, 1800)
        if stands_still:
            del robot.stopped[source]
        else:
            robot.ahead_s[source] -= by_s

    return script


def all_leap(robot: Robot) -> Iterator[float]:
    """Set the clock of all drivers, and perhaps that of the system, by seconds to days."""
    by_s = float(robot.rng.choice([-1, 1]) * 10 ** robot.between(0.3, 6))
    for source in robot.ahead_s:
        robot.ahead_s[source] += by_s
    robot.set_s += by_s * robot.rng.integers(2)
    yield 1.0


def driver_again(robot: Robot, *, biased: bool = True, stays: bool = False) -> Iterator[float]:
    """Let the driver go away and come back, or only its sensor, perhaps biased anew."""
    robot.publishers, robot.wrench = int(stays), 'silent'
    yield robot.between(20 if stays else 2, 300)
    robot.publishers, robot.wrench, robot.driver = 1, '', robot.driver + (not stays)
    if biased and not (stays and robot.node is None):  # which nobody could know
        robot.bias[:] = robot.rng.normal(0, 1, 6) * [5, 5, 5, 0.3, 0.3, 0.3]
    yield 1.0


def driver_zeroed(robot: Robot, *, cycles: int = 1) -> Iterator[float]:
    """
    Let a program zero the sensor in its driver, of a robot at rest, perhaps in each cycle.

    Again and again it does so without a load: with a tool in another pose, a load could have been
    let go (docs/reliability.md, "What is not covered").
    """
    for cycle in range(cycles if cycles == 1 or robot.held is None else 0):
        yield robot.between(60, 300) if cycle else 0.0
        while cycles > 1 and robot.push().any():
            yield 5.0
        robot.held_still, robot.fast_until_s = robot.held_still + 1, robot.elapsed_s + 10
        yield 4.0
        robot.bias[:] -= robot.frozen_n - robot.noise if robot.node else 0.0
        yield 4.0
        robot.held_still -= 1
    if cycles > 1:
        yield from robot.tare()


def driver_in(unit: float, turn: Any, frame: bytes) -> Script:
    """
    Let the driver come back with another unit or turn, and tare; later it is as before.

    Where its frame_id is the same, only a payload of known weight can show it.
    """

    def script(robot: Robot) -> Iterator[float]:
        if frame == OWN_FRAME and (robot.gravity == 'none' or robot.named is None):
            return
        yield from driver_again(robot, biased=False)
        robot.unit, robot.turn, robot.frame = unit, turn, frame
        robot.shown = np.eye(6) if frame == OWN_FRAME else turn
        yield 120.0
        yield from robot.tare()
        yield robot.between(600, 3600)
        yield from driver_again(robot, biased=False)
        robot.unit, robot.turn, robot.shown, robot.frame = 1.0, np.eye(6), np.eye(6), OWN_FRAME

    return script


def restart(
    robot: Robot, *, biased: bool = False, set_clock: bool = False, cold: bool = False
) -> Iterator[float]:
    """
    Kill the node, and start it again after seconds to hours.

    Meanwhile the driver may be biased anew, the system's clock be set, or all thermometers be off,
    which then read 0 °C for some time: perhaps for a new node, whose sensor is tared then.
    """
    is_new = cold and bool(robot.rng.integers(2))
    robot.kill(forget=is_new)
    yield 10 ** robot.between(0, 3.9)
    if biased:
        yield from driver_again(robot)
    if set_clock:
        robot.set_s += float(robot.rng.choice([-1, 1]) * 10 ** robot.between(1, 6))
    if cold:
        robot.thermometer[:] = ['zero'] * robot.thermometers
    robot.start()
    yield 5.0
    robot.name(robot.named)
    if is_new:
        yield from robot.tare()
    if cold:
        yield robot.between(1, 10 if is_new else 60)
        robot.thermometer[:] = [''] * robot.thermometers
    yield 1.0


def full_disk(robot: Robot) -> Iterator[float]:
    """Fill the disk, tare, kill the node, and start it again; then there is room."""
    robot.flush()
    robot.full = True
    yield robot.between(10, 600)
    yield from robot.tare()
    yield robot.between(1, 60)
    yield from restart(robot)
    robot.full = False


def payload(robot: Robot) -> Iterator[float]:
    """Take another payload, and say so a little before or after."""
    other = [None, TOOL, PART][robot.rng.integers(3)]
    acts = [partial(setattr, robot, 'held', other), partial(robot.name, other)]
    for k in robot.rng.permutation(2):
        acts[k]()
        yield robot.between(0, 30)


def tare_first(robot: Robot) -> Iterator[float]:
    """Tare the empty sensor while nothing is named, then take a payload and name it."""
    for one, least_s, most_s in ((None, 5, 60), (TOOL, 5, 600)):
        robot.held = one
        robot.name(one)
        if one is None:
            yield robot.between(least_s, most_s)
            yield from robot.tare()
        yield robot.between(least_s, most_s)


def tare_at_once(robot: Robot) -> Iterator[float]:
    """Tare, whatever happens, perhaps in contact."""
    robot.touches = bool(robot.rng.integers(2))
    yield from robot.tare()
    robot.touches = False


def tare_reset(robot: Robot) -> Iterator[float]:
    """Forget the tare for some time."""
    if robot.node is not None:
        robot.node.tare.reset()
        yield robot.between(100, 900)
        yield from robot.tare()


def moved(robot: Robot) -> Iterator[float]:
    """Move the frame of the wrench on the robot, for some time; TF shows it."""
    if robot.gravity == 'tf' and not robot.imu:
        robot.tilt, robot.imu = float(robot.rng.choice([0.5, 1.0, 1.57])), 'moved'
        yield robot.between(300, 1800)
        robot.imu = ''


def other_model(robot: Robot) -> Iterator[float]:
    """Run the model of a single morning, perhaps tare, and go back to the good one."""
    robot.choose(robot.models[1])
    yield robot.between(20, 7200)
    if robot.rng.integers(2):
        yield from robot.tare()
        yield robot.between(20, 3600)
    robot.choose(robot.models[0])
    yield 1.0


class Event(NamedTuple):
    """What happens, what it needs for itself, and words; a status that is not OK must say one."""

    uses: str
    words: str
    script: Script


def _events() -> Iterator[tuple[str, Event]]:
    for kind, words, least_s, most_s in (
        ('frozen', 'frozen', 20, 900), ('zeros', 'frozen|zero', 20, 900),
        ('saturated', 'saturated', 30, 600), ('pulses', 'saturated', 120, 300),
        ('stuck', 'one value', 30, 600),
        ('nan', 'NaN|unusable', 20, 300), ('silent', 'no raw wrenches', 20, 900),
        ('unstamped', 'stamp', 20, 600), ('mixed', 'publisher', 70, 300),
    ):  # fmt: skip
        yield f'wrench {kind}', Event('driver', words, sick('wrench', kind, least_s, most_s))
    turned = 'mirrored|turned|did not fit'  # the last is of a tare that was taken meanwhile
    for kind, words, least_s, most_s in (
        ('mirrored', turned, 300, 1800), ('turned', turned, 300, 1800),
        ('upside down', turned, 300, 1800), ('silent', 'specific force', 20, 900),
        ('frozen', 'specific force', 20, 900), ('in g', 'specific force', 60, 900),
        ('nan', 'specific force|IMU', 20, 900),
    ):  # fmt: skip
        yield f'IMU {kind}', Event('imu', words, sick('imu', kind, least_s, most_s))
    for kind, least_s, most_s in (
        ('dead', 20, 7200), ('frozen', 300, 7200), ('sparse', 300, 7200), ('late', 60, 3600),
        ('loose', 20, 3600), ('kelvin', 20, 900), ('fahrenheit', 20, 900), ('tenths', 20, 900),
        ('nan', 20, 900), ('zero', 2, 60),
    ):  # fmt: skip
        words = f'thermometer|thermal|{"stamps" if kind == "late" else "temperatures"}'
        script = one_thermometer(kind, least_s, most_s)
        yield f'thermometer {kind}', Event('thermometer', words, script)
    yield 'thermometers exchanged', Event('thermometer', 'thermometer', exchanged)
    for source in CLOCKS:
        missing = 'specific force' if source == IMU else 'before the .*temperatures'
        words = f'clock|stamp|apart|{missing}'
        for how in ('differs', 'stops'):
            script = clock(source, stands_still=how == 'stops')
            yield f'clock of {source} {how}', Event('clock', words, script)
    yield 'clocks leap', Event('clock', 'stamps|clock', all_leap)
    again, weighed = 'publisher|no raw', 'driver payload imu'  # only the weight shows some
    yield 'driver biased anew', Event('driver', again, driver_again)
    yield 'sensor biased anew', Event('driver', again, partial(driver_again, stays=True))
    # A tare that is in doubt already is not doubted again.
    for kind, uses, cycles in (('', '', 1), (' in each cycle', ' payload', 12)):
        script = partial(driver_zeroed, cycles=cycles)
        yield f'driver zeroed{kind}', Event(f'driver{uses}', f'zeroed|~/tare|{again}', script)
    for unit in (0.2248, 4.448, 1000.0):
        script = driver_in(unit, np.eye(6), OWN_FRAME)
        yield f'driver in units of {unit}', Event(weighed, f'unit|the weight|{again}', script)
    script = driver_in(1.0, TURN, OTHER_FRAME)
    yield 'driver in another frame', Event('driver', f'frame|{again}', script)
    script = driver_in(1.0, TURN, OWN_FRAME)
    yield 'driver turned in silence', Event(weighed, f'turned|the weight|{again}', script)
    yield 'tare', Event('driver', 'tare', tare_at_once)
    yield 'tare reset', Event('driver', 'tare', tare_reset)
    for kind in ('frozen', 'zeros', 'silent'):
        script = sick('wrench', kind, 1, 20, tare=True)
        yield f'tare while {kind}', Event('driver', 'frozen|zero|no raw', script)
    yield 'tare before a payload', Event('driver payload', 'tare|payload', tare_first)
    yield 'payload changes', Event('payload', 'payload', payload)
    yield 'frame moved on the robot', Event('imu', 'frame', moved)
    words = 'state|thermal|steady'
    named, script = f'thermometer|tare|{words}', partial(restart, cold=True)
    yield 'cold thermometers', Event('node driver thermometer', named, script)
    yield 'node killed', Event('node', words, restart)
    script = partial(restart, set_clock=True)
    yield 'node killed and clock set', Event('node', f'clock|{words}', script)
    script = partial(restart, biased=True)
    yield 'node killed and driver biased', Event('node driver', f'{again}|tare', script)
    yield 'model changed', Event('node driver', f'model|{words}', other_model)
    yield 'disk full', Event('node driver', f'written|room|tare|{words}', full_disk)


EVENTS = dict(_events())
