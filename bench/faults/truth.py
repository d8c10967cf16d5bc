"""
A machine of truth: a simulated robot beside the wired node, events of every kind, and one oracle.

``python bench/faults/truth.py [--hours N] [--seed N] [--kinds WORDS] [--dev]``. A life is twelve
simulated hours. Drivers, clocks, thermometers, disk and operator do what EVENTS says, at random
times, and may overlap; ``--kinds`` takes those that hold one of some words, ``--dev`` shows every
event and what the statuses said.

The oracle: what comes out is within what the node itself states (three deviations of its drift, or
its limit for a day, and the noise of a tare), or within GRACE_S a status is not OK and names the
cause, by the words in EVENTS. In quiet hours, an hour after the last event, no status warns, but
of what a model remembers of missing temperatures. A finding is a line that its seed, with the same
words, brings back. Exit code 1 where there was one.
"""

import argparse
from collections import Counter, deque
from collections.abc import Callable, Iterator
import math
import os
from pathlib import Path
import re
import sys
import tempfile
import time
from typing import Any

from events import EVENTS
import numpy as np
from robot import FAST_S, IMU_NOISE, LIFE_S, NOISE, Robot, surroundings

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.errors import WristFtCompError

#: A status has to name the cause within this time, and what was named stays named for this, s.
GRACE_S, NAMED_S = 60.0, 30.0
#: Hours are quiet this long after the last event, s.
QUIET_S = 3600.0
#: For this long behind events that touch these, s, a status may say what a model remembers of
#: them, by these words: five of its slowest time constants, as after a jump of 50 K.
REMEMBERED_S = 15000.0
REMEMBERING = {'thermometer', 'clock', 'node'}
REMEMBERED = 'thermal state|model remembers|until it came back'
#: What is said, and true, of a tare that was taken in contact.
PRESSED = 'rests at # N in all directions|free the tool'
#: Mean time between events, s.
BETWEEN_S = 2400.0
#: An operator tares this long after a status asked for it by such words, s.
OPERATOR_S = 300.0
ASKED = '~/tare|tare where it is to stay'


class Oracle:
    """Judges a life, second by second; ``note`` takes what it finds."""

    def __init__(self, robot: Robot, note: Callable[..., None]) -> None:
        self._robot, self._note = robot, note
        #: Kinds that may still act, and when they did so last; and the kind that acted last.
        self.open: dict[str, float] = {}
        self.last = 'nothing'
        #: When the last event ended of which a model remembers something.
        self.remembers_s = -math.inf
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
        if any('zeroed' in kind for kind in self.open):  # found from here on (docs/reliability.md)
            wrench = np.maximum(3 * wrench, np.repeat([0.4, 0.04], 3))
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
            self.worst = max(self.worst, share if share <= 1 and not self.open else 0.0)
            rests = f'{output} rests'  # another fault than that it is wrong when it comes back
            fault = '' if share <= 1 else rests if math.isinf(share) else output
            for over in {output, rests} - {fault}:
                if now_s - self._seen.get(over, now_s) > NAMED_S:
                    self._since.pop(over, None)
                    self._found.discard(over)
            if not fault:
                continue
            wrong, self._seen[fault] = True, now_s
            since_s = self._since.setdefault(fault, now_s)
            if now_s - since_s > GRACE_S and not is_named and fault not in self._found:
                self._found.add(fault)
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
            remembers = now_s - self.remembers_s < REMEMBERED_S
            kind = ''
            for sentence in text.split('; ') if quiet_s and text else []:
                is_remembered = remembers and re.search(REMEMBERED, sentence)
                is_pressed = robot.pushed.any() and re.search(PRESSED, sentence)
                if sentence not in self._warned and not (is_remembered or is_pressed):
                    kind = 'false warning'
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
                begun = True
                if kind:
                    ended_s = now_s
                if kind and REMEMBERING.intersection(EVENTS[kind].uses.split()):
                    oracle.remembers_s = now_s
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
            if re.search(ASKED, said) and robot.asked_s == math.inf:
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
