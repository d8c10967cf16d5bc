"""
A machine of truth: a simulated robot beside the wired node, events of every kind, and one oracle.

``python bench/faults/truth.py [--hours N] [--seed N] [--kinds WORDS] [--dev]``. A life is twelve
simulated hours. Drivers, clocks, thermometers, disk and operator do what EVENTS says, at random
times, and may overlap; ``--kinds`` takes those that hold one of some words, ``--dev`` shows every
event and what the statuses said.

The oracle: what comes out is within what the node itself states (three deviations of its drift, or
its limit for a day, and the noise of a tare), or within GRACE_S a status is not OK and names the
cause, by the words in EVENTS. In quiet hours, an hour after the last event, no status warns.
A finding is a line that its seed, with the same words, brings back. Exit code 1 where there was
one.
"""

import argparse
from collections import Counter, deque
from collections.abc import Callable, Iterator
from functools import partial
import math
import os
from pathlib import Path
import re
import sys
import tempfile
import time
from typing import Any, NamedTuple

import numpy as np
from robot import (
    CLOCKS,
    FAST_S,
    IMU,
    IMU_NOISE,
    LIFE_S,
    NOISE,
    OTHER_FRAME,
    OWN_FRAME,
    PART,
    Robot,
    surroundings,
    TOOL,
    TURN,
)

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.errors import WristFtCompError

#: A status has to name the cause within this time, and what was named stays named for this, s.
GRACE_S, NAMED_S = 60.0, 30.0
#: Hours are quiet this long after the last event, s.
QUIET_S = 3600.0
#: Mean time between events, s.
BETWEEN_S = 2400.0
#: An operator does what a status asks for after this time, s.
OPERATOR_S = 300.0
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
    """Let a thermometer do something for some time; nobody can know that a single one froze."""

    def script(robot: Robot) -> Iterator[float]:
        j = int(robot.rng.integers(robot.thermometers))
        if how != 'frozen' or robot.thermometers > 1:
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
    if biased:
        robot.bias[:] = robot.rng.normal(0, 1, 6) * [5, 5, 5, 0.3, 0.3, 0.3]
    yield 1.0


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
    which then read 0 °C for some time.
    """
    robot.kill()
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
    if cold:
        yield robot.between(1, 60)
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


class Event(NamedTuple):
    """What happens, what it needs for itself, and words; a status that is not OK must say one."""

    uses: str
    words: str
    script: Script


def _events() -> Iterator[tuple[str, Event]]:
    """Make all events, by kind."""
    for kind, words, least_s, most_s in (
        ('frozen', 'frozen', 20, 900), ('zeros', 'frozen|zero', 20, 900),
        ('saturated', 'saturated', 30, 600), ('pulses', 'saturated', 120, 300),
        ('nan', 'NaN|unusable', 20, 300), ('silent', 'no raw wrenches', 20, 900),
        ('unstamped', 'stamp', 20, 600), ('mixed', 'publisher', 70, 300),
    ):  # fmt: skip
        yield f'wrench {kind}', Event('driver', words, sick('wrench', kind, least_s, most_s))
    for kind, words, least_s, most_s in (
        ('mirrored', 'mirrored|turned', 300, 1800), ('turned', 'mirrored|turned', 300, 1800),
        ('upside down', 'mirrored|turned', 300, 1800), ('silent', 'specific force', 20, 900),
        ('frozen', 'specific force', 20, 900), ('in g', 'specific force', 60, 900),
        ('nan', 'specific force|IMU', 20, 900),
    ):  # fmt: skip
        yield f'IMU {kind}', Event('imu', words, sick('imu', kind, least_s, most_s))
    for kind, least_s, most_s in (
        ('dead', 20, 7200), ('frozen', 300, 7200), ('sparse', 300, 7200), ('late', 60, 3600),
        ('loose', 20, 3600), ('kelvin', 20, 900), ('fahrenheit', 20, 900), ('tenths', 20, 900),
        ('nan', 20, 900), ('zero', 2, 60),
    ):  # fmt: skip
        words = 'stamps|thermometer' if kind == 'late' else 'thermometer|temperatures|thermal'
        script = one_thermometer(kind, least_s, most_s)
        yield f'thermometer {kind}', Event('thermometer', words, script)
    yield 'thermometers exchanged', Event('thermometer', 'thermometer', exchanged)
    for source in CLOCKS:
        words = 'clock|stamp|apart' + ('|specific force' if source == IMU else '')
        yield (
            f'clock of {source} differs',
            Event('clock', words, clock(source, stands_still=False)),
        )
        yield f'clock of {source} stops', Event('clock', words, clock(source, stands_still=True))
    yield 'clocks leap', Event('clock', 'stamps|clock', all_leap)
    again, weighed = 'publisher|no raw', 'driver payload imu'  # only the weight shows some
    yield 'driver biased anew', Event('driver', again, driver_again)
    script = partial(driver_again, stays=True)
    yield 'sensor biased anew', Event('driver', again, script)
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
    script = partial(restart, cold=True)
    yield 'cold thermometers', Event('node thermometer', f'thermometer|{words}', script)
    yield 'node killed', Event('node', words, restart)
    script = partial(restart, set_clock=True)
    yield 'node killed and clock set', Event('node', f'clock|{words}', script)
    script = partial(restart, biased=True)
    yield 'node killed and driver biased', Event('node driver', f'{again}|tare', script)
    yield 'disk full', Event('node driver', f'written|room|tare|{words}', full_disk)


EVENTS = dict(_events())


class Oracle:
    """Judges a life, second by second; ``note`` takes what it finds."""

    def __init__(self, robot: Robot, note: Callable[..., None]) -> None:
        self._robot, self._note = robot, note
        #: Kinds that may still act, and when they did so last; and the kind that acted last.
        self.open: dict[str, float] = {}
        self.last = 'nothing'
        #: Since when an output has been wrong, and when it was last.
        self._since: dict[str, float] = {}
        self._seen: dict[str, float] = {}
        #: What statuses that are not OK said, and when.
        self._said: deque[tuple[float, str]] = deque()
        self._found: set[str] = set()
        self._warned = ''
        self.quiet_s = self.worst = 0.0

    def limits(self) -> dict[str, Any]:
        """Read from the status how far the outputs may be off, N and N m, (6,)."""
        values = {v.key: v.value for v in self._robot.statuses['output'].values}
        deviation, day = (
            np.array([float(values.get(f'{axis}_{what}', '0').split()[0]) for axis in AXES])
            for what in ('drift_deviation', 'day_limit')
        )
        wrench, payload = np.maximum(3 * deviation, day) + 2 * NOISE, self._robot.named
        # The weight that is subtracted has the noise of the IMU, which the tare has not.
        lever_m = 0.0 if payload is None else float(np.linalg.norm(payload.center_m))
        mass_kg = 0.0 if payload is None else payload.mass_kg
        noise = 4 * IMU_NOISE * mass_kg * np.array([1.0] * 3 + [lever_m] * 3)
        return {'wrench': wrench, 'wrench_external': wrench + noise}

    def judge(self, now_s: float, running: set[str], quiet_s: float) -> str:
        """Compare what came out with the truth, and with what the statuses say; give that."""
        robot, said = self._robot, ''
        if robot.node is None or not robot.statuses:
            self._since.clear()
            return ''
        said = '; '.join(
            f'{name}: {status.message}'
            for name, status in robot.statuses.items()
            if status.level != b'\0'
        )
        if said:
            self._said.append((now_s, said))
        while self._said and now_s - self._said[0][0] > NAMED_S:
            self._said.popleft()
        named = '|'.join(EVENTS[kind].words for kind in self.open) or 'nothing at all'
        is_named = any(re.search(named, words) for _, words in self._said)
        limits, wrong = self.limits(), False
        for output, off in robot.errors().items():
            limit = limits[output]
            share = float(np.max(np.abs(off) / limit))
            if share <= 1:
                if now_s - self._seen.get(output, now_s) > NAMED_S:
                    self._since.pop(output, None)
                    self._found.discard(output)
                if not self.open:
                    self.worst = max(self.worst, share)
                continue
            wrong, self._seen[output] = True, now_s
            since_s = self._since.setdefault(output, now_s)
            if now_s - since_s > GRACE_S and not is_named and output not in self._found:
                self._found.add(output)
                axis = int(np.argmax(np.abs(off) / limit))
                text = f'{output} {AXES[axis]} off by {off[axis]:.3g} (limit {limit[axis]:.2g})'
                self._note(self.last, f'{text}; statuses: {said or "all OK"}')
        for kind, acted_s in list(self.open.items()):
            if wrong or kind in running or re.search(EVENTS[kind].words, said):
                self.open[kind] = now_s
            elif now_s - acted_s > GRACE_S:
                del self.open[kind]
        self.quiet_s += quiet_s
        text = re.sub(r'[-\d.]+', '#', said)
        if text != self._warned:
            kind = 'false warning' if quiet_s and text else ''
            self._note(kind, f'{self.last if kind else "statuses"}: {said or "all OK"}')
        self._warned = text
        return said


def live(
    robot: Robot, options: argparse.Namespace, note: Callable[..., None], counts: Counter[str]
) -> float:
    """Live a life; give the share of the limit that was reached without an event."""
    kinds = [kind for kind in EVENTS if any(word in kind for word in options.kinds)]
    running: list[tuple[float, str, Iterator[float]]] = []
    oracle, ended_s, begun = Oracle(robot, note), 0.0, False
    robot.start()
    running.append((20.0, '', robot.tare()))
    next_s = 120.0 + float(robot.rng.exponential(options.every))
    while (now_s := robot.elapsed_s) < min(LIFE_S, 3600 * options.hours):
        for entry in [one for one in running if one[0] <= now_s]:
            running.remove(entry)
            robot.fast_until_s = now_s + FAST_S
            _, kind, script = entry
            oracle.last = kind or oracle.last
            try:
                running.append((now_s + next(script), kind, script))
            except StopIteration:
                begun, ended_s = True, now_s if kind else ended_s
            except WristFtCompError as error:
                note(kind, f'refused: {error}')
        if now_s >= next_s:
            busy = {use for _, kind, _ in running if kind for use in EVENTS[kind].uses.split()}
            free = [kind for kind in kinds if busy.isdisjoint(EVENTS[kind].uses.split())]
        if now_s >= next_s and free:
            next_s = now_s + float(robot.rng.exponential(options.every))
            kind = str(robot.rng.choice(free))
            counts[kind] += 1
            note('', kind)
            oracle.open[kind], oracle.last = now_s, kind
            running.append((now_s, kind, EVENTS[kind].script(robot)))
        robot.advance()
        before_s, now_s = now_s, robot.elapsed_s
        if begun and int(now_s) > int(before_s):
            kinds_now = {kind for _, kind, _ in running if kind}
            quiet = not kinds_now and now_s - ended_s > QUIET_S
            said = oracle.judge(now_s, kinds_now, (now_s - before_s) * quiet)
            if '~/tare' in said and robot.asked_s == math.inf:
                robot.asked_s = now_s + OPERATOR_S
            if now_s > robot.asked_s:
                running.append((now_s, '', robot.tare()))
    counts['quiet s'] += round(oracle.quiet_s)
    if robot.node:
        robot.kill()
    return oracle.worst


def main() -> int:
    """Live lives, and print what was found."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--hours', type=float, default=LIFE_S / 3600)
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--every', type=float, default=BETWEEN_S, help='between events, s')
    parser.add_argument('--kinds', nargs='*', default=[''], help='words in the kinds of events')
    parser.add_argument('--dev', action='store_true', help='show every event')
    options = parser.parse_args()
    os.environ.update(ROS_AUTOMATIC_DISCOVERY_RANGE='OFF', ROS_LOG_DIR=tempfile.gettempdir())
    counts, found, worst, hours = Counter[str](), Counter[str](), 0.0, 0.0
    with tempfile.TemporaryDirectory() as name, surroundings() as context:
        folder = Path(name)
        for life in range(max(1, round(options.hours * 3600 / LIFE_S))):
            robot = Robot(options.seed + life, folder / 'models', folder, context)

            def note(kind: str, text: str, robot: Robot = robot) -> None:
                found.update([kind] if kind else [])
                if kind or options.dev:
                    where = f'seed {robot.seed} at {robot.elapsed_s:.0f} s'
                    print(f'{where}: {kind}: {text}', flush=True)

            with robot.around():
                worst = max(worst, live(robot, options, note, counts))
            hours += robot.elapsed_s / 3600
    quiet_h = counts.pop('quiet s', 0) / 3600
    print(f'{"begun":>8} findings  kind')
    for kind in sorted(counts | found):
        print(f'{counts[kind]:8} {found[kind]:8}  {kind}')
    false_per_100_h = 100 * found.pop('false warning', 0) / max(quiet_h, 1)
    print(
        f'{counts.total()} events in {hours:.0f} h, {quiet_h:.0f} of them quiet, '
        f'{time.process_time():.0f} s of processor time; {found.total()} findings; '
        f'{false_per_100_h:.1f} false warnings in 100 quiet hours; '
        f'without an event at most {worst:.2f} of the limit'
    )
    return int(bool(found))


if __name__ == '__main__':
    sys.exit(main())
