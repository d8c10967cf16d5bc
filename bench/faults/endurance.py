"""
``endurance``: minutes of operation with a random fault every second, and everything that came out.

Faults are those of processes and of the graph; those of messages are in ``truth.py``.

The sensor is not loaded and drifts by the lagged law that the model has learnt, so an output is
wrong by more than LIMIT_N, not a number, with another header than was sent, or twice. Nothing may
be wrong, no traceback may be in the log, and the stream has to come back within BACK_S. With
``--fault 'node killed'`` it shows how soon a node is back, and whether one is ever deaf.
"""

import argparse
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
import struct
import sys
import threading
import time
from typing import Any

from geometry_msgs.msg import WrenchStamped
import numpy as np
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Temperature
from stand import keep, make_model, message, NODE, Sensor, Stand, tell, write_warm_up
from std_srvs.srv import SetBool

#: An unloaded, compensated force may read this much, N; a torque a tenth. Drift reaches 4 N.
LIMIT_N = 1.0
TEMPERATURE_HZ = 10
#: The stream is back when an output comes within this time after a fault, s.
BACK_S = 10.0
#: Without an output for this time, the stream is away, s.
AWAY_S = 0.2
#: What is done to the node: it is killed, or a service is called.
FAULTS = ('node killed', 'calibrate', 'record', 'tare', 'rollback')


class Endurance:
    """One run; ``stand`` has a node that was not started, ``faults`` are some of FAULTS."""

    def __init__(
        self, stand: Stand, rate_hz: float, faults: Sequence[str], rng: np.random.Generator
    ) -> None:
        self._stand, self._rng, self._rate_hz = stand, rng, rate_hz
        self._possible = faults
        self._sensor = Sensor(1)
        self.counts: Counter[str] = Counter()
        self._faults: Counter[str] = Counter()
        self._worst = np.zeros(6)
        #: Longest time without an output after each fault, s.
        self.silence_s: dict[str, float] = {}
        #: How often each header was sent and has not come back.
        self._pending: Counter[bytes] = Counter()
        self._lock = threading.Lock()
        self._last_output_s = time.monotonic()
        self._last_fault = ''
        profile: Any = QoSProfile
        stand.node.create_subscription(
            WrenchStamped, 'wrench', self._on_output, profile(depth=5000), raw=True
        )
        talker = stand.talker
        self._raw = talker.create_publisher(WrenchStamped, 'wrench_raw', 1000)
        self._heat = talker.create_publisher(Temperature, 'temperature', 100)

    def _on_output(self, data: bytes) -> None:
        header, values = data[:-48], np.array(struct.unpack('<6d', data[-48:]))
        with self._lock:
            self._last_output_s = time.monotonic()
            self.counts['arrived'] += 1
            if header not in self._pending:
                self.counts['wrong: header was never sent'] += 1
            elif self._pending[header] == 0:
                self.counts['wrong: came twice'] += 1
            else:
                self._pending[header] -= 1
            self._worst = np.fmax(self._worst, np.abs(values))
            if not (np.abs(values) / LIMIT_N * [1, 1, 1, 10, 10, 10]).max() <= 1:  # nor NaN
                self.counts[f'wrong: value after {self._last_fault}'] += 1

    def _send(self, data: bytes) -> None:
        """Send one wrench that has to come back."""
        with self._lock:
            self._pending[data[:-48]] += 1
            self.counts['sent'] += 1
            if time.monotonic() - self._last_output_s > AWAY_S:
                self.counts['sent while the node was away'] += 1
        self._raw.publish(data)

    def _warm(self) -> None:
        self._heat.publish(message(time.time_ns(), (self._sensor.celsius, 0.0)))

    def settle(self) -> None:
        """Start the node and tare it: a model does not know where the sensor's zero is."""
        self._stand.start_node()
        self._stand.wait(lambda: NODE in self._stand.node.get_node_names(), 'the node')
        self._stand.wait(lambda: self._raw.get_subscription_count() > 0, 'its subscription')
        self._stand.wait(lambda: self._stand.call('reset_tare'), 'its services')
        for tick in range(500):
            if tick % 10 == 0:
                self._warm()
            self._send(message(time.time_ns(), self._sensor.raw()))
            if tick == 350:
                self._stand.call('tare')
            time.sleep(0.01)
        self.counts.clear()
        self._worst[:] = 0.0

    def run(self, seconds: float) -> None:
        """Send, and inject a fault every second."""
        start = time.monotonic()
        wrenches, temperatures, last_fault_s = 0, 0, 0
        while (now := time.monotonic() - start) < seconds:
            if self._stand.process is None or self._stand.process.poll() is not None:
                self._stand.start_node()
            self._sensor.advance(now)
            if temperatures < now * TEMPERATURE_HZ:
                temperatures += 1
                self._warm()
            while wrenches < now * self._rate_hz:
                wrenches += 1
                self._send(message(time.time_ns(), self._sensor.raw()))
            if int(now) > last_fault_s and now < seconds - min(BACK_S, seconds / 4):
                last_fault_s = int(now)
                self._inject()
            with self._lock:
                away_s = time.monotonic() - self._last_output_s
                longest_s = self.silence_s.get(self._last_fault, 0.0)
                self.silence_s[self._last_fault] = max(longest_s, away_s)
            time.sleep(0.001)
        time.sleep(0.5)

    def _inject(self) -> None:
        """Do one wrong thing; a node that is starting is not killed again."""
        with self._lock:
            is_away = time.monotonic() - self._last_output_s > AWAY_S
            fault = str(self._rng.choice(self._possible))
            if is_away and fault == 'node killed':
                return
            if not is_away:
                self._last_fault = fault
        self._faults[fault] += 1
        if fault == 'node killed':
            self._stand.end_node()
        elif fault == 'record':
            on = bool(self._rng.integers(2))
            self._stand.call('record', SetBool, SetBool.Request(data=on))
        else:
            self._stand.call(fault)

    def result(self) -> dict[str, Any]:
        """Sum up."""
        return {
            'rate_hz': self._rate_hz,
            'counts': {**self.counts, 'lost': self.counts['sent'] - self.counts['arrived']},
            'faults': dict(sorted(self._faults.items())),
            'drift_at_the_end_n': self._sensor.zero.round(3).tolist(),
            'worst_output_n': self._worst.round(3).tolist(),
            'longest_silence_s': {k: round(v, 2) for k, v in sorted(self.silence_s.items())},
        }


def endure(arguments: argparse.Namespace, folder: Path) -> bool:
    """Run, print, judge."""
    seconds = 60.0 * arguments.minutes
    faults = [fault for fault in FAULTS if arguments.fault in {None, fault}]
    if not faults:
        sys.exit(f'--fault is one of {", ".join(FAULTS)}; got {arguments.fault}.')
    recording = write_warm_up(folder / 'warm_up.csv')
    model = make_model(recording, folder / 'models/first.yaml')
    given = f'model_file:={model}', f'calibration.recordings:=[{recording}]', 'tare.duration:=0.2'
    with closing(Stand(folder, *given)) as stand:
        run = Endurance(stand, arguments.rate, faults, np.random.default_rng(arguments.seed))
        run.settle()
        run.run(seconds)
    log = stand.log.read_text('utf-8', 'replace')
    tracebacks = log.count('Traceback')
    tell('endurance', {'seconds': seconds, **run.result(), 'tracebacks': tracebacks})
    keep('endurance.log', log)
    wrong = any(what.startswith('wrong') for what in run.counts)
    silent = max(run.silence_s.values(), default=0.0) > BACK_S
    return not (wrong or silent or tracebacks) and run.counts['arrived'] > 0
