"""
A hostile robot: whatever can come to the node comes, in any order; after every step it is judged.

``python bench/faults/hostile.py [--steps N] [--seed N]``. Good, damaged, late and foreign
messages; services in any order, also while others run; parameters right and wrong; files broken,
removed or replaced; a full disk; clocks that leap; temperatures that no body has; parts that are
sabotaged; kills and restarts. After every step: nothing has left a callback, every good wrench in
was one wrench out, finite, within the limits, its header untouched, no part has stopped that was
not sabotaged, and the diagnostics name what is wrong. Prints what was done; a finding is a
traceback with the shortest way to it, and exit code 1.
"""

import argparse
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
import errno
import faulthandler
from functools import wraps
import math
import os
from pathlib import Path
import shutil
import struct
import tempfile
import time
from typing import Any
from unittest import mock

from hypothesis import HealthCheck, settings
from hypothesis import seed as with_seed
from hypothesis import strategies as st
from hypothesis.stateful import (
    initialize,
    invariant,
    precondition,
    rule,
    RuleBasedStateMachine,
    run_state_machine_as_test,
)
from rclpy.context import Context
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.logging import set_logger_level
from rclpy.node import Node
from rclpy.parameter import Parameter
from stand import make_model, message, write_warm_up
from std_srvs.srv import SetBool, Trigger

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.node.compensator_node import CompensatorNode

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
#: Largest zero drift of a force, N, and of a torque, N m: the node's defaults.
LIMITS = (200.0,) * 3 + (20.0,) * 3
#: Steps between one fresh start and the next.
STEPS_PER_LIFE = 100
#: A step that takes longer hangs, s; where, is printed.
HANG_S = 20.0
WARN = 1
#: Verbs of a part that are sabotaged.
VERBS = (
    'on_model', 'on_wrench', 'on_cells', 'on_specific_force', 'check_parameters',
    'apply_parameters', 'poll', 'statuses',
)  # fmt: skip
SERVICES = (
    'calibrate', 'tare', 'reset_tare', 'identify_payload', 'record', 'rollback', 'adopt',
)  # fmt: skip
PARAMETERS: tuple[tuple[str, tuple[Any, ...]], ...] = (
    ('uncalibrated', ('passthrough', 'silent', 'loud', 3)),
    ('model_file', ('models/m.yaml', 'models/none.yaml', '/etc/passwd', '', 'models', 7)),
    ('payload.active', ('', 'manual', 'nail', 5)),
    ('payload.mass', (0.0, 1.5, -1.0, math.nan, 'heavy')),
    ('payload.center_of_mass', ([0.0, 0.0, 0.1], [0.0, 0.1], [math.inf, 0.0, 0.0], 'here')),
    ('gravity.timeout', (0.2, 10.0, 0.0)),
    ('tare.duration', (0.01, 60.0, -1.0)),
    ('tare.max_deviation', (1e6, 0.001, math.nan)),
    ('calibration.recordings', (['recordings/a.csv'], [], ['/etc/passwd'])),
    ('calibration.reference', ('payload', 'unloaded', 'none')),
    ('max_drift', (2.0,)),
)
FILES = (
    'models/m.yaml', 'models/payloads.json', 'state.json', 'active.json', 'learning.json',
    'days/day_00001.csv', 'days/diary.json', 'recordings/a.csv', 'days/stray.csv',
)  # fmt: skip
RUBBISH = (
    b'', b'{', b'[]', b'null', b'\xff\xfe\0', b'[' * 2000, b'{"a": ' + b'9' * 5000 + b'}',
    b'format: wrist_ft_comp drift model\nversion: 2\n', b'stamp_s,force_z\n1,x\n', b'NaN\n' * 100,
)  # fmt: skip
#: What is put in a file's place, if anything.
REPLACEMENTS = ('nothing', 'folder', 'link', 'pipe') * 2
numbers = st.floats(-500.0, 500.0)
celsius = st.floats(15.0, 60.0)
odd_celsius = st.sampled_from([math.nan, math.inf, 1e10, -273.15, 3276.7, 300.0, -1e308])
steps_ns = st.sampled_from([0, 1, SECOND // 1000, SECOND, 5 * SECOND, 70 * SECOND])
#: Half of the times are those that are due.
leaps_ns = st.sampled_from(
    [0] * 7 + [-1, -SECOND, -3600 * SECOND, 3600 * SECOND, 8 * 3600 * SECOND, 10**18, -START]
)


def step(**drawn: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a method a step that may be taken, and count how often it was by its name."""

    def decorate(method: Callable[..., None]) -> Callable[..., None]:
        @wraps(method)
        def counted(self: 'HostileRobot', **values: Any) -> None:
            self.done[method.__name__.replace('_', ' ')] += 1
            method(self, **values)

        untyped: Any = rule(**drawn)
        decorated: Callable[..., None] = untyped(counted)
        return decorated

    return decorate


class FakeProcess:
    """Stands for the process of a job: it takes its time, then it refuses."""

    pid = 0

    def __init__(self, _job: Any) -> None:
        self._polls = 0

    def poll(self) -> dict[str, Any] | None:
        """Refuse at the fourth look."""
        self._polls += 1
        if self._polls < 4:
            return None
        return {'success': False, 'message': 'Refused by the bench; nothing is wrong.'}

    def end(self) -> None:
        """Nothing runs."""


class HostileRobot(RuleBasedStateMachine):
    """One life of a data directory; the node in it is killed and started again."""

    #: What all lives share: where they live, a model, a ROS context, and a count of what was done.
    folder: Path
    model: Path
    context: Any
    done: Counter[str]
    lives: int

    @initialize()
    def begin(self) -> None:
        """Start a node with a model in a fresh folder."""
        HostileRobot.lives += 1
        self.stack = ExitStack()
        self.data = self.folder / 'data'
        for module in ('jobs', 'learner'):
            patched = f'wrist_ft_comp.node.{module}.start_job'
            self.stack.enter_context(mock.patch(patched, FakeProcess))
        self.stack.enter_context(mock.patch('os.fsync', self._fsync))
        self.full = False
        self.node: Any = None
        self.now_ns = START
        self.answers: list[Any] = []
        self._fresh()

    def _fsync(self, _handle: int) -> None:
        """Write to the disk, unless it is full."""
        if self.full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def _fresh(self) -> None:
        """Start in a folder with a model, where a start may not be refused."""
        shutil.rmtree(self.data, ignore_errors=True)
        (self.data / 'models').mkdir(parents=True)
        (self.data / 'days').mkdir()
        shutil.copy(self.model, self.data / 'models/m.yaml')
        self._start()

    def _start(self) -> None:
        """Start the node; WristFtCompError when it refuses."""
        given = {
            'data_directory': str(self.data), 'model_file': 'models/m.yaml',
            'temperature_topics': ['temperature'],
            'gravity.source': 'imu', 'calibration.reference': 'payload', 'learning.mode': 'auto',
        }  # fmt: skip
        untyped: Any = Parameter
        overrides = [untyped(name, value=value) for name, value in given.items()]
        self.node = CompensatorNode(context=self.context, parameter_overrides=overrides)
        set_logger_level('wrist_ft_comp', LoggingSeverity.FATAL)
        self.out: list[bytes] = []
        self.external: list[bytes] = []
        self.expected: dict[str, int] = {}
        self.sabotaged: set[str] = set()
        self.node._output.publish = self.out.append
        self.node.external.publish = self.external.append
        self.node._diagnostics.publish = self._judge_report
        for service in self.node._offered:
            service._send = lambda response, answers: answers.append(response)

    def _at(self, leap: int) -> int:
        """Give the stamp of now, ns, or one that leaps."""
        return max(self.now_ns + leap, 0) % (2**31 * SECOND) if leap else self.now_ns

    # What comes in

    def _wrench(self, values: list[float], stamp_ns: int, frame: bytes = b'tool0\0\0\0') -> None:
        """Send a good wrench; one comes out."""
        data = message(stamp_ns, values, frame)
        before = len(self.out)
        # As it is before: the wrench that completes a tare is corrected by the tare of before.
        drift = self.node.compensator.compensation_at(stamp_ns or self.node.now_ns())
        tare = self.node.compensator.tare
        self.node._on_wrench(data)
        if self.node.silent:
            assert len(self.out) == before
            return
        assert len(self.out) == before + 1, 'a good wrench in is one wrench out'
        out = self.out.pop()
        assert out[:-48] == data[:-48], 'the header is untouched'
        corrected = struct.unpack('<6d', out[-48:])
        assert all(map(math.isfinite, corrected))
        assert all(abs(zero) <= limit for zero, limit in zip(drift.zero, LIMITS, strict=True))
        for raw, value, zero, gain, offset in zip(values, corrected, *drift, tare, strict=True):
            expected = (raw - zero - offset) / (1 + gain)
            assert math.isclose(value, expected, rel_tol=1e-9, abs_tol=1e-6)
        for data in self.external:
            assert all(map(math.isfinite, struct.unpack('<6d', data[-48:])))
        self.external.clear()

    @step(values=st.lists(numbers, min_size=6, max_size=6), step=steps_ns, leap=leaps_ns)
    def good_wrench(self, values: list[float], step: int, leap: int) -> None:
        """Send a wrench as drivers send them, or of another time and frame."""
        self.now_ns += step
        self._wrench(values, self._at(leap), b'other\0\0\0' if leap else b'tool0\0\0\0')

    @step(cut=st.integers(0, 95), values=st.sampled_from([math.nan, math.inf, -math.inf, 1e308]))
    def damaged_wrench(self, cut: int, values: float) -> None:
        """Send a wrench that is cut off, or holds no numbers."""
        before = len(self.out)
        good = message(self.now_ns, [values] * 6)
        self.node._on_wrench(good[:cut])
        self.node._on_wrench(good)
        assert len(self.out) == before, 'a damaged wrench is dropped'
        self.expected['input'] = WARN

    @step(data=st.binary(max_size=200))
    def noise(self, data: bytes) -> None:
        """Send bytes that are nothing, on every topic."""
        before = len(self.out)
        self.node._on_wrench(data)
        self.node.inputs.on_temperature(0, data)
        self.node.recording.on_reference(data)
        self.node.do(self.node.gravity, self.node.gravity.on_imu, data)
        self.out[before:] = []

    def _temperature(self, value: float, stamp_ns: int) -> None:
        """Give a temperature to what reads them."""
        inputs = self.node.inputs
        self.node.do(inputs, inputs.on_temperature, 0, message(stamp_ns, [value, 0.0]))

    @step(value=celsius, step=steps_ns, leap=leaps_ns)
    def temperature(self, value: float, step: int, leap: int) -> None:
        """Send a temperature as thermometers send them, or one of another time."""
        self.now_ns += step
        self._temperature(value, self._at(leap))

    @step(value=celsius, cells=st.integers(2, 20))
    def warm_cells(self, value: float, cells: int) -> None:
        """Send some seconds of a steady temperature, and wrenches."""
        for _ in range(cells):
            self.now_ns += SECOND
            self._temperature(value, self.now_ns)
            self._wrench([1.0] * 6, self.now_ns)

    @step(value=odd_celsius)
    def odd_temperature(self, value: float) -> None:
        """Send a temperature that no body has."""
        self._temperature(value, self.now_ns)
        if 'temperature' not in self.sabotaged:
            self.expected['temperature'] = WARN

    @step(leap=leaps_ns)
    def clock(self, leap: int) -> None:
        """Let all clocks leap; what comes goes on from there."""
        self.now_ns = min(max(self.now_ns + leap, SECOND), 2**31 * SECOND - 10**17)

    def _imu(self, force: Sequence[float]) -> None:
        """Give a specific force to what reads them: an Imu, the other numbers of which are 0."""
        doubles = [*[0.0] * 25, *force, *[0.0] * 9]
        source = self.node.specific_force
        self.node.do(source, source.on_imu, message(self.now_ns, doubles))

    @step(
        force=st.lists(st.floats(-20.0, 20.0), min_size=3, max_size=3),
        odd=st.sampled_from([0.0, 0.0, 0.0, math.nan, 1e300]),
    )
    def imu(self, force: list[float], odd: float) -> None:
        """Send a specific force, mostly good."""
        self._imu([force[0] + odd, *force[1:]])

    @step(force=st.sampled_from([(0.0, 0.0, 9.807), (0.0, 0.0, 0.0)]), noisy=st.booleans())
    def minute_at_rest(self, force: tuple[float, float, float], noisy: bool) -> None:
        """Send more than a minute of a robot that stands still, perhaps without any noise."""
        for k in range(130):
            self.now_ns += SECOND // 2
            self._imu(force)
            self._wrench([float(noisy and k % 3)] * 6, self.now_ns)

    # What people ask for

    @step(name=st.sampled_from(SERVICES), flag=st.booleans())
    def service(self, name: str, flag: bool) -> None:
        """Call a service, whatever else runs."""
        full = f'/wrist_ft_comp/{name}'
        (served,) = (service for service in self.node.services if service.service_name == full)
        kind: Any = SetBool if name == 'record' else Trigger
        request = SetBool.Request(data=flag) if name == 'record' else Trigger.Request()
        response = served.callback(request, kind.Response())
        (deferred,) = (offered for offered in self.node._offered if offered.service is served)
        deferred._on_header(response, self.answers)
        assert all(answer.message for answer in self.answers), 'every answer is a sentence'
        self.answers.clear()

    @step(row=st.sampled_from(PARAMETERS), which=st.integers(0, 5))
    def parameter(self, row: tuple[str, tuple[Any, ...]], which: int) -> None:
        """Set a parameter, rightly or wrongly."""
        name, values = row
        untyped: Any = Parameter
        verdict = self.node.set_parameters([untyped(name, value=values[which % len(values)])])[0]
        assert verdict.successful or verdict.reason

    # What happens around it

    @step(name=st.sampled_from(FILES), content=st.sampled_from((*RUBBISH, *REPLACEMENTS)))
    def broken_file(self, name: str, content: bytes | str) -> None:
        """Break a file that the node may read, remove it, or put what is none in its place."""
        path = self.data / name
        with suppress(OSError):
            if path.is_dir():
                shutil.rmtree(path)
            path.unlink(missing_ok=True)
            path.parent.mkdir(exist_ok=True)
            if isinstance(content, bytes):
                path.write_bytes(content)
            elif content == 'folder':
                path.mkdir()
            elif content == 'link':
                path.symlink_to('/nowhere/at/all')
            elif content == 'pipe':
                os.mkfifo(path)

    @step(full=st.booleans())
    def disk(self, full: bool) -> None:
        """Fill the disk, or make room."""
        self.full = full

    @step(die=st.booleans())
    def restart(self, die: bool) -> None:
        """End the node, or kill it, and start it again; a refusal is mended by a fresh folder."""
        self._end(die=die)
        try:
            self._start()
        except WristFtCompError as error:
            self.refusal = str(error)
            self.done['refused starts'] += 1
            self._end(die=True)
            self._fresh()

    @precondition(lambda self: len(self.sabotaged) < 2)
    @step(data=st.data(), verb=st.sampled_from(VERBS), really=st.integers(0, 9))
    def sabotage(self, data: Any, verb: str, really: int) -> None:
        """Let a part throw what nobody expects."""
        if really:
            return
        part = data.draw(st.sampled_from(self.node.parts))

        def throw(*_: object, **__: object) -> None:
            raise ZeroDivisionError('by the bench')

        setattr(part, verb, throw)
        self.node.do(part, getattr(part, verb))
        self.sabotaged.add(part.title)
        self.expected.pop(part.title, None)

    @step()
    def housekeeping(self) -> None:
        """Do what the node does ten times a second."""
        self.node.broadcast('poll')

    # What must hold

    def _judge_report(self, array: Any) -> None:
        """Compare a report with what was done since the one before."""
        levels = {status.name.split(': ')[1]: status.level[0] for status in array.status}
        assert all(status.message for status in array.status)
        for name, level in self.expected.items():
            assert levels[name] >= level, f'{name} says nothing of what is wrong'
        for title in self.sabotaged:
            assert levels[title] > WARN, f'{title} does not say that it has stopped'
        self.expected.clear()

    @invariant()
    def stands(self) -> None:
        """Look after the node, and at what it says of itself."""
        faulthandler.dump_traceback_later(HANG_S, exit=True)  # until the next step
        if getattr(self, 'node', None) is None:
            return
        self.node._diagnose()
        stopped = {part.title: part.stopped for part in self.node.parts if part.stopped}
        assert stopped.keys() == self.sabotaged, stopped

    def _end(self, *, die: bool) -> None:
        """End the node, or drop it as a kill does."""
        node, self.node = self.node, None
        if node is None:
            return
        if die:
            Node.destroy_node(node)  # type: ignore[no-untyped-call]
        else:
            node.destroy_node()

    def teardown(self) -> None:
        """Take the node down."""
        if getattr(self, 'stack', None) is not None:
            self.full = False
            self._end(die=False)
            self.stack.close()


def run(steps: int, seed: int) -> None:
    """Take steps."""
    robot = HostileRobot
    take: Any = run_state_machine_as_test
    context: Any = Context()
    with (
        tempfile.TemporaryDirectory() as folder,
        mock.patch('wrist_ft_comp.ros.hub.FAREWELL_S', 0.0),
    ):
        context.init([])
        robot.context, robot.folder, robot.lives = context, Path(folder), 0
        robot.model = make_model(
            write_warm_up(robot.folder / 'w.csv', 1800), robot.folder / 'm.yaml'
        )
        robot.done = Counter()
        try:
            # A life may end early; then other lives follow, until there were enough steps.
            while (missing := steps - robot.done.total()) > 0:
                chosen = settings(
                    max_examples=max(1, missing // STEPS_PER_LIFE),
                    stateful_step_count=STEPS_PER_LIFE, deadline=None, database=None,
                    suppress_health_check=list(HealthCheck), print_blob=False,
                )  # fmt: skip
                take(with_seed(seed)(robot), settings=chosen)
                seed += 1
        finally:
            context.try_shutdown()


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--steps', type=int, default=5000)
    parser.add_argument('--seed', type=int, default=0)
    options = parser.parse_args()
    os.environ.update(
        ROS_AUTOMATIC_DISCOVERY_RANGE='OFF', ROS_LOG_DIR=tempfile.gettempdir(),
    )  # fmt: skip
    begun = time.monotonic()
    run(options.steps, options.seed)
    for what, count in sorted(HostileRobot.done.items()):
        print(f'{count:8d} {what}')
    print(
        f'{HostileRobot.done.total()} steps in {HostileRobot.lives} lives, '
        f'{time.monotonic() - begun:.0f} s; no finding'
    )


if __name__ == '__main__':
    main()
