"""The operator of the demonstration, a program of its own: by topics and services only."""

import argparse
from collections.abc import Callable, Sequence
from functools import partial
import json
import os
from pathlib import Path
import re
import sys
import time
from typing import Any

from geometry_msgs.msg import WrenchStamped
import numpy as np
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from sensor_msgs.msg import Temperature
from std_srvs.srv import SetBool, Trigger

from wrist_ft_comp.errors import RecordingError, WristFtCompError
from wrist_ft_comp.node.operate import Operator
from wrist_ft_comp.ros.parameters import NODE_NAME
from wrist_ft_comp.ros.qos import FAST_SENSOR, SLOW_SENSOR
from wrist_ft_comp.signals import AXES, NANOSECONDS
from wrist_ft_comp.stored.demo_log import DemoLog, save_demo_log
from wrist_ft_comp.wire.cdr import locate, TEMPERATURE_DOUBLES, WRENCH_DOUBLES

_WRENCH_TOPICS = ('wrench_raw', 'wrench', 'wrench_reference')
_EXTERNAL_TOPICS = ('wrench_external', 'wrench_external_reference')
#: How the answer of ~/calibrate names the payloads that it learnt, lightest first.
_PAYLOAD = re.compile(r'^payload (\S+):', re.MULTILINE)
_SERVICE_TIMEOUT_S = 60.0
_SILENCE_TIMEOUT_S = 15.0


def tell(event: str, **more: Any) -> None:
    """Write one line for the program that started this one."""
    sys.stdout.write(json.dumps({'event': event, **more}) + '\n')
    sys.stdout.flush()


class DemoClient(Operator):
    """Talks to the compensator and keeps what the topics, one per thermometer, bring."""

    def __init__(self, context: Context, temperature_topics: Sequence[str]) -> None:
        super().__init__(context, 'demo_client')
        topics = (*_WRENCH_TOPICS, *_EXTERNAL_TOPICS)
        self.wrenches: dict[str, dict[int, tuple[float, ...]]] = {topic: {} for topic in topics}
        self.temperatures: list[tuple[int, int, float]] = []
        self.latest_ns = 0
        for topic in topics:
            self.node.create_subscription(
                WrenchStamped, topic, partial(self._on_wrench, topic), FAST_SENSOR, raw=True
            )
        for number, topic in enumerate(temperature_topics):
            heard = partial(self._on_temperature, number)
            self.node.create_subscription(Temperature, topic, heard, SLOW_SENSOR, raw=True)

    def _on_wrench(self, topic: str, data: bytes) -> None:
        stamp_ns, wrench = locate(data, WRENCH_DOUBLES).decode(data)
        self.wrenches[topic][stamp_ns] = wrench
        self.latest_ns = max(self.latest_ns, stamp_ns)

    def _on_temperature(self, number: int, data: bytes) -> None:
        stamp_ns, (value, _) = locate(data, TEMPERATURE_DOUBLES).decode(data)
        self.temperatures.append((stamp_ns, number, value))

    def spin_until(self, done: Callable[[], bool], what: str, timeout_s: float) -> None:
        """Run callbacks until a condition holds."""
        if not self.wait_for(done, timeout_s):
            raise RecordingError(f'{what} did not happen within {timeout_s:.0f} s.')

    def call(self, service_type: Any, name: str, request: Any) -> Any:
        """Call one of the compensator's services."""
        deadline_s = time.monotonic() + _SERVICE_TIMEOUT_S

        def late() -> bool:
            return time.monotonic() > deadline_s

        answer = self.request(service_type, f'/{NODE_NAME}/{name}', request, late)
        if answer is None:
            raise RecordingError(f'{name} was not answered within {_SERVICE_TIMEOUT_S:.0f} s.')
        return answer

    def ask(self, service_type: Any, name: str, request: Any) -> str:
        """Call a service, and report its answer in words; RecordingError when it refuses."""
        response = self.call(service_type, name, request)
        if not response.success:
            raise RecordingError(f'{name} was refused: {response.message}')
        tell('message', text=response.message)
        return str(response.message)

    def hold(self, payload: str) -> None:
        """Choose the payload that is mounted."""
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=payload)
        request = SetParameters.Request(parameters=[Parameter(name='payload.active', value=value)])
        (result,) = self.call(SetParameters, 'set_parameters', request).results
        if not result.successful:
            raise RecordingError(f'payload.active:={payload} was refused: {result.reason}')

    def listen_for(self, first_ns: int, seconds: float, what: str) -> None:
        """Listen until the stamps have moved on by a time, s, reporting the progress."""
        while self.latest_ns < first_ns + int(seconds * NANOSECONDS):
            target_ns = self.latest_ns + int(seconds / 40 * NANOSECONDS)
            reached = partial(lambda at_ns: self.latest_ns > at_ns, target_ns)
            self.spin_until(reached, 'The next message', _SILENCE_TIMEOUT_S)
            done = (self.latest_ns - first_ns) / (seconds * NANOSECONDS)
            tell('progress', what=what, share=min(done, 1.0))

    def log(self, calibrated_ns: int) -> DemoLog:
        """Put together what came on all three wrench topics."""
        by_stamp = [self.wrenches[topic] for topic in _WRENCH_TOPICS]
        stamps = sorted(set.intersection(*map(set, by_stamp)))
        nothing = (np.nan,) * len(AXES)
        raw, compensated, reference, external, external_reference = (
            np.array([wrenches.get(stamp, nothing) for stamp in stamps])
            for wrenches in self.wrenches.values()
        )
        temperatures = np.array(self.temperatures, dtype='i8, i8, f8')
        return DemoLog(
            stamps_ns=np.array(stamps, np.int64), raw=raw, compensated=compensated,
            reference=reference, external=external, external_reference=external_reference,
            temperature_stamps_ns=temperatures['f0'], thermometer=temperatures['f1'],
            temperature_c=temperatures['f2'], calibrated_ns=calibrated_ns)  # fmt: skip


def play(client: DemoClient, wanted: argparse.Namespace) -> None:
    """Record a day, calibrate from it, and listen to what follows."""
    client.ask(SetBool, 'record', SetBool.Request(data=True))
    tell('recording')  # the sensor may start now, cold
    client.spin_until(lambda: client.latest_ns > 0, 'The first wrench', _SERVICE_TIMEOUT_S)
    what = 'at work' if wanted.at_work else 'warm-up'
    client.listen_for(client.latest_ns, wanted.record_s, f'recording, {what}')
    client.ask(SetBool, 'record', SetBool.Request(data=False))
    summary = client.ask(Trigger, 'calibrate', Trigger.Request())
    if wanted.at_work:
        learnt = _PAYLOAD.search(summary)
        if learnt is None:
            raise RecordingError('No payload was learnt; see the answer of ~/calibrate above.')
        client.hold(learnt[1])
    calibrated_ns = client.latest_ns
    client.listen_for(calibrated_ns, wanted.test_s, 'cooling down and warming up differently')
    save_demo_log(wanted.log, client.log(calibrated_ns))
    tell('done')


def main() -> int:
    """Play the demonstration."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--at-work', action='store_true')
    parser.add_argument('log', type=Path)
    parser.add_argument('record_s', type=float)
    parser.add_argument('test_s', type=float)
    parser.add_argument('topics', nargs='+')
    wanted = parser.parse_args()
    context = Context()
    context.init([])
    client = DemoClient(context, wanted.topics)
    try:
        play(client, wanted)
    except WristFtCompError as error:
        tell('failed', text=str(error))
        return 1
    except KeyboardInterrupt:
        return os.EX_TEMPFAIL
    finally:
        client.close()
        context.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
