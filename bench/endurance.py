"""
Minutes of operation with a random fault every second: what was sent, arrived, and was wrong.

``python bench/endurance.py [MINUTES] [--rate HZ] [--seed N]``. The sensor is not loaded and drifts
by the lagged law that the model has learnt, so what comes out beyond noise is wrong: by more than
LIMIT_N, not a number, with another header than was sent, or twice. Figures on standard output and
in ``out/endurance.json``; exit code 1 when anything was wrong, or the stream did not come back.
"""

import argparse
from collections import Counter
import json
from pathlib import Path
import struct
import sys
import tempfile
import threading
import time
from typing import Any

import numpy as np
from stand import make_model, message, NODE, own_domain, Sensor, Stand, write_warm_up

#: An unloaded, compensated force may read this much, N; a torque a tenth. Drift reaches 4 N.
LIMIT_N = 1.0
TEMPERATURE_HZ = 10
#: The stream is back when an output comes within this time after a fault, s.
BACK_S = 10.0
#: Without an output for so long, the stream is away, s.
AWAY_S = 0.2
FAULTS = (
    'node killed', 'sensor dies for 0.5 s', 'thermometer stops for 3 s', 'temperature 5 h ahead',
    'temperature 5 h back', 'temperature NaN', 'temperature 0 K', 'temperature jumps 15 K',
    'wrench NaN', 'wrench too short', 'wrench without stamp', 'wrench 5 h ahead',
    'another publisher for 0.3 s', 'frame changes', 'calibration', 'recording', 'tare',
    'rollback', 'file outside the folder is named',
)  # fmt: skip


class Endurance:
    """
    One run.

    Parameters
    ----------
    stand : Stand
        With a node that was not started.
    rate_hz : float
        Of wrenches.
    rng : numpy Generator
        Chooses the faults.

    """

    def __init__(self, stand: Stand, rate_hz: float, rng: np.random.Generator) -> None:
        from geometry_msgs.msg import WrenchStamped  # noqa: PLC0415 -- after the environment is set
        from rclpy.qos import QoSProfile  # noqa: PLC0415
        from sensor_msgs.msg import Temperature  # noqa: PLC0415

        self.stand, self.rng, self._rate_hz = stand, rng, rate_hz
        self.counts: Counter[str] = Counter()
        self.faults: Counter[str] = Counter()
        self.worst = np.zeros(6)
        self.slowest_back: dict[str, float] = {}
        self.sensor = Sensor(1)
        self._types = WrenchStamped, Temperature
        self._sent: dict[bytes, int] = {}
        self._lock = threading.Lock()
        self._last_output = time.monotonic()
        self._pending = ''
        self._until: dict[str, float] = {}
        self._extra: Any = None
        profile: Any = QoSProfile
        stand.node.create_subscription(
            WrenchStamped, 'wrench', self._on_output, profile(depth=5000), raw=True
        )
        self._raw: Any = None
        self._warm: Any = None
        self._begin_ns = time.time_ns()
        self._make_publishers()

    def _make_publishers(self) -> None:
        """Come to life."""
        wrench, temperature = self._types
        if self._raw is None:
            self._raw = self.stand.talker.create_publisher(wrench, 'wrench_raw', 1000)
        if self._warm is None:
            self._warm = self.stand.talker.create_publisher(temperature, 'temperature', 100)

    def is_heard(self) -> bool:
        """Whether somebody listens to the sensor."""
        return self._raw is not None and self._raw.get_subscription_count() > 0

    def _on_output(self, data: bytes) -> None:
        """Judge one output."""
        values = np.array(struct.unpack('<6d', data[-48:]))
        with self._lock:
            self._last_output = time.monotonic()
            self.counts['arrived'] += 1
            pending = self._sent.get(data[:-48])
            if pending is None:
                self.counts['wrong: header was never sent'] += 1
            elif pending == 0:
                self.counts['wrong: came twice'] += 1
            else:
                self._sent[data[:-48]] = pending - 1
            if not np.isfinite(values).all():
                self.counts['wrong: not a number'] += 1
                return
            self.worst = np.maximum(self.worst, np.abs(values))
            scaled = np.abs(values) / LIMIT_N * [1, 1, 1, 10, 10, 10]
            if scaled.max() > 1:
                self.counts['wrong: value'] += 1
                self.counts[f'  wrong value after {self._pending}'] += 1

    def _send(self, data: bytes) -> None:
        """Send one wrench that has to come back."""
        with self._lock:
            self._sent[data[:-48]] = self._sent.get(data[:-48], 0) + 1
            self.counts['sent'] += 1
            if time.monotonic() - self._last_output > AWAY_S:
                self.counts['sent while the node was away'] += 1
        self._raw.publish(data)

    def settle(self) -> None:
        """Let the node start, and tare it: a model does not know where the sensor's zero is."""
        from std_srvs.srv import Trigger  # noqa: PLC0415 -- after the environment is set

        for tick in range(500):
            if tick % 10 == 0:
                self._heat(0.0)
            self._raw.publish(message(time.time_ns(), self.sensor.raw()))
            if tick == 350:
                self.stand.call('tare', Trigger, Trigger.Request())
            time.sleep(0.01)
        self.counts.clear()
        self.worst[:] = 0.0

    def run(self, seconds: float) -> None:
        """Send, and inject a fault every second."""
        start = time.monotonic()
        sent, heated, last_fault = 0, 0, 0
        while (now := time.monotonic() - start) < seconds:
            self._recover(now)
            self.sensor.advance(now)
            if heated < now * TEMPERATURE_HZ:
                heated += 1
                self._heat(now)
            while sent < now * self._rate_hz:
                sent += 1
                if self._raw is not None:
                    self._send(message(time.time_ns(), self.sensor.raw()))
                else:
                    self.counts['not sent: sensor dead'] += 1
            if int(now) > last_fault and now < seconds - min(BACK_S, seconds / 4):
                last_fault = int(now)
                self._inject(self._choose(), now)
            self._watch_for_return()
            time.sleep(0.001)
        time.sleep(0.5)

    def _heat(self, now: float) -> None:
        """Send a temperature, right or wrong."""
        if self._warm is None or now < self._until.get('temperature', 0):
            return
        jump = 15.0 if now < self._until.get('jump', 0) else 0.0
        self._warm.publish(message(time.time_ns(), (self.sensor.celsius + jump, 0.0)))

    def _recover(self, now: float) -> None:
        """Bring back what is due."""
        if now >= self._until.get('sensor', 0):
            self._make_publishers()
        if self._extra is not None and now >= self._until.get('extra', 0):
            self.stand.talker.destroy_publisher(self._extra)
            self._extra = None
        if self.stand.process is None or self.stand.process.poll() is not None:
            self.stand.start_node()

    def _watch_for_return(self) -> None:
        """Measure how long the stream was away after a fault."""
        with self._lock:
            away = time.monotonic() - self._last_output
            self.slowest_back[self._pending] = max(self.slowest_back.get(self._pending, 0.0), away)

    def _choose(self) -> str:
        """Choose a fault; a node that is starting is not killed again."""
        with self._lock:
            away = time.monotonic() - self._last_output > AWAY_S
            fault = str(self.rng.choice(FAULTS[1:] if away else FAULTS))
            if not away:
                self._pending = fault
        return fault

    def _inject(self, fault: str, now: float) -> None:
        """Do one wrong thing."""
        from std_srvs.srv import SetBool, Trigger  # noqa: PLC0415 -- after the environment is set

        self.faults[fault] += 1
        services = {'calibration': 'calibrate', 'tare': 'tare', 'rollback': 'rollback'}
        if fault.startswith(('temperature', 'thermometer')):
            self._wrong_heat(fault, now)
        elif fault == 'node killed':
            self.stand.end_node()
        elif fault == 'sensor dies for 0.5 s':
            self._until['sensor'] = now + 0.5
            for publisher in (self._raw, self._warm):
                self.stand.talker.destroy_publisher(publisher)
            self._raw = self._warm = None
        elif fault in services:
            self.stand.call(services[fault], Trigger, Trigger.Request())
        elif fault == 'recording':
            on = bool(self.rng.integers(2))
            self.stand.call('record', SetBool, SetBool.Request(data=on))
        elif fault == 'file outside the folder is named':
            self._name_a_file()
        elif self._raw is not None:
            self._wrong_wrench(fault, now)

    def _wrong_heat(self, fault: str, now: float) -> None:
        """Do something strange with the thermometer."""
        hours = 5 * 3600 * 10**9
        stamp, celsius = time.time_ns(), self.sensor.celsius
        readings = {
            'temperature 5 h ahead': (stamp + hours, celsius),
            'temperature 5 h back': (stamp - hours, celsius),
            'temperature NaN': (stamp, float('nan')),
            'temperature 0 K': (stamp, -273.15),
        }
        if fault == 'temperature jumps 15 K':
            self._until['jump'] = now + 0.3
        elif fault == 'thermometer stops for 3 s':
            self._until['temperature'] = now + 3.0
        elif self._warm is not None:
            at, value = readings[fault]
            self._warm.publish(message(at, (value, 0.0)))

    def _name_a_file(self) -> None:
        """Ask for a model outside the data folder."""
        from rcl_interfaces.srv import SetParameters  # noqa: PLC0415
        from rclpy.parameter import Parameter  # noqa: PLC0415

        untyped: Any = Parameter
        named = untyped('model_file', value='/etc/passwd').to_parameter_msg()
        self.stand.call('set_parameters', SetParameters, SetParameters.Request(parameters=[named]))

    def _wrong_wrench(self, fault: str, now: float) -> None:
        """Send something strange on the sensor's topic."""
        stamp, raw = time.time_ns(), self.sensor.raw()
        if fault == 'wrench NaN':
            self._raw.publish(message(stamp, [*raw[:5], float('nan')]))
        elif fault == 'wrench too short':
            self._raw.publish(message(stamp, raw)[:-8])
        elif fault == 'wrench without stamp':
            self._send(message(0, raw))
        elif fault == 'wrench 5 h ahead':
            self._send(message(stamp + 5 * 3600 * 10**9, raw))
        elif fault == 'frame changes':
            self._send(message(stamp, raw, b'tool1\0\0\0'))
        elif fault == 'another publisher for 0.3 s':
            self._until['extra'] = now + 0.3
            self._extra = self.stand.talker.create_publisher(self._types[0], 'wrench_raw', 10)

    def result(self, seconds: float) -> dict[str, Any]:
        """Sum up."""
        counts = dict(self.counts)
        counts['lost'] = counts.get('sent', 0) - counts.get('arrived', 0)
        return {
            'seconds': seconds,
            'rate_hz': self._rate_hz,
            'counts': counts,
            'faults': dict(sorted(self.faults.items())),
            'drift_at_the_end_n': [round(float(value), 3) for value in self.sensor.zero],
            'worst_output_n': [round(float(value), 3) for value in self.worst],
            'longest_silence_s': {k: round(v, 2) for k, v in sorted(self.slowest_back.items())},
        }


def main() -> int:
    """Run, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1] if __doc__ else '')
    parser.add_argument('minutes', nargs='?', type=float, default=10.0)
    parser.add_argument('--rate', type=float, default=1000.0)
    parser.add_argument('--seed', type=int, default=0)
    arguments = parser.parse_args()
    own_domain(95)
    seconds = 60.0 * arguments.minutes
    with tempfile.TemporaryDirectory() as name:
        data = Path(name) / 'data'
        recording = write_warm_up(data / 'warm_up.csv')
        model = make_model(recording, data / 'models/first.yaml')
        stand = Stand(
            data,
            f'model_file:={model}',
            f'calibration.recordings:=[{recording}]',
            'tare.duration:=0.2',
        )
        try:
            run = Endurance(stand, arguments.rate, np.random.default_rng(arguments.seed))
            stand.start_node()
            stand.wait(lambda: NODE in stand.node.get_node_names(), 'the node')
            stand.wait(run.is_heard, 'its subscription')
            stand.wait(lambda: stand.ready('tare'), 'its services')
            run.settle()
            run.run(seconds)
        finally:
            stand.close()
        result = run.result(seconds)
        log = stand.log.read_text('utf-8', 'replace')
        result['tracebacks'] = log.count('Traceback')
    print(json.dumps(result, indent=1))
    out = Path(__file__).resolve().parent.parent / 'out'
    out.mkdir(exist_ok=True)
    (out / 'endurance.log').write_text(log, 'utf-8')
    (out / 'endurance.json').write_text(json.dumps(result, indent=1), 'utf-8')
    wrong = sum(count for what, count in run.counts.items() if what.startswith('wrong'))
    silent = max(run.slowest_back.values(), default=0.0) > BACK_S
    return 1 if wrong or silent or result['tracebacks'] or not run.counts['arrived'] else 0


if __name__ == '__main__':
    sys.exit(main())
