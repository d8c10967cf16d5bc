"""
Sensor and node on two hosts, which are two network namespaces of this machine, and a cut between.

``python bench/faults/two_hosts.py [CUT_S]``, as root, with iproute2. The sensor publishes a
kilohertz and temperatures in one namespace; the compensator and a listener run in the other, over
a virtual cable and UDP only (shared memory would go past the cable). The cable loses packets: by
chance where the kernel has netem, else because it is too narrow for all of them. It is pulled for
CUT_S seconds. Figures on standard output and in ``out/two_hosts.json``; exit code 1 when the
stream does not come back.
"""

import argparse
from collections.abc import Iterator
from contextlib import closing, contextmanager
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time
from typing import Any

from geometry_msgs.msg import WrenchStamped
import numpy as np
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Temperature
from stand import make_model, message, Sensor, Stand, tell, TIMEOUT_S, write_warm_up

RATE_HZ = 1000
#: The cable is pulled this long after the sensor was started, s.
CUT_AFTER_S = 8.0
NAMES = ('wfc_sensor', 'wfc_node')
CABLE = ('wfc_cable_s', 'wfc_cable_n')
#: How packets get lost, the first that the kernel can do. The narrow cable holds a datagram of
#: the discovery whole, or nobody would ever meet.
LOSSES = ('netem loss 5%', 'tbf rate 1900kbit burst 16kb limit 16kb')


def ip(*words: str) -> None:
    """Run iproute2."""
    subprocess.run(['ip', *words], check=True)  # noqa: S607 -- the system's


def netns(name: str, *words: str) -> list[str]:
    """Write a command that runs in a namespace."""
    return ['ip', 'netns', 'exec', name, *words]


def loses(end: str, loss: str) -> bool:
    """Let a cable lose packets; tell whether the kernel can."""
    words = netns(NAMES[0], 'tc', 'qdisc', 'add', 'dev', end, 'root', *loss.split())
    return subprocess.run(words, check=False, stderr=subprocess.DEVNULL).returncode == 0


@contextmanager
def cable() -> Iterator[str]:
    """Make two namespaces with a cable; tell how it loses packets."""
    for name in NAMES:
        ip('netns', 'add', name)
    try:
        one, other = CABLE
        ip('link', 'add', one, 'netns', NAMES[0], 'type', 'veth', 'peer', other, 'netns', NAMES[1])
        for number, (name, end) in enumerate(zip(NAMES, CABLE, strict=True), start=1):
            ip('-n', name, 'addr', 'add', f'10.77.0.{number}/24', 'dev', end)
            for link in (end, 'lo'):
                ip('-n', name, 'link', 'set', link, 'up')
            ip('-n', name, 'route', 'add', '224.0.0.0/4', 'dev', end)
        yield next((loss for loss in LOSSES if loses(one, loss)), 'not at all')
    finally:
        for name in NAMES:
            ip('netns', 'del', name)


def sense(seconds: float, folder: Path) -> None:
    """Be the sensor: publish, and print what was sent."""
    with closing(Stand(folder)) as stand:
        raw = stand.talker.create_publisher(WrenchStamped, 'wrench_raw', qos_profile_sensor_data)
        heat = stand.talker.create_publisher(Temperature, 'temperature', qos_profile_sensor_data)
        sensor, begun, sent = Sensor(0), time.monotonic(), 0
        while (now := time.monotonic() - begun) < seconds:
            sensor.advance(now)
            while sent < now * RATE_HZ:
                raw.publish(message(time.time_ns(), sensor.raw()))
                if sent % 100 == 0:
                    heat.publish(message(time.time_ns(), (sensor.celsius, 0.0)))
                sent += 1
            time.sleep(0.001)
    print(sent)


def receive(seconds: float, folder: Path) -> None:
    """Be the node's host: run it, listen, and print when outputs came."""
    came: list[float] = []
    model = make_model(write_warm_up(folder / 'warm_up.csv'), folder / 'm.yaml')
    with closing(Stand(folder / 'data', f'model_file:={model}')) as stand:
        stand.start_node()
        stand.node.create_subscription(
            WrenchStamped, 'wrench', lambda _: came.append(time.monotonic()), 1000, raw=True
        )
        stand.wait(lambda: stand.ready('tare'), 'the node')
        print('ready', flush=True)
        time.sleep(seconds)
    print(json.dumps([round(at - came[0], 4) for at in came]))
    print(stand.log.read_text('utf-8'), file=sys.stderr)


def end(name: str, role: str, seconds: float, folder: str) -> 'subprocess.Popen[str]':
    """Start one of the two ends in its namespace."""
    words = [sys.executable, str(Path(__file__).resolve()), '--role', role, str(seconds), folder]
    return subprocess.Popen(netns(name, *words), stdout=subprocess.PIPE, text=True)


def run(cut_s: float) -> dict[str, Any]:
    """Run both hosts and pull the cable between them."""
    seconds = cut_s + 20.0
    with tempfile.TemporaryDirectory() as folder, cable() as loss:
        listening = end(NAMES[1], 'receive', seconds + 2, folder)
        if listening.stdout is None or listening.stdout.readline() != 'ready\n':
            sys.exit('the node did not start')
        sensing = end(NAMES[0], 'sense', seconds, folder)
        time.sleep(CUT_AFTER_S)
        ip('-n', NAMES[1], 'link', 'set', CABLE[1], 'down')
        time.sleep(cut_s)
        ip('-n', NAMES[1], 'link', 'set', CABLE[1], 'up')
        ip('-n', NAMES[1], 'route', 'add', '224.0.0.0/4', 'dev', CABLE[1])
        sent = int(sensing.communicate(timeout=seconds + TIMEOUT_S)[0])
        came_s = np.array(
            json.loads(listening.communicate(timeout=seconds + TIMEOUT_S)[0].splitlines()[-1])
        )
    pauses_s = np.sort(np.diff(came_s))[::-1]
    return {
        'cut_s': cut_s,
        'packets_are_lost': loss,
        'sent': sent,
        'arrived': len(came_s),
        'median_rate_hz': float(np.median(np.bincount(came_s.astype(int))))
        if len(came_s)
        else 0.0,
        'longest_pauses_s': pauses_s[:3].round(2).tolist(),
        'came_after_the_cut': int((came_s > CUT_AFTER_S + cut_s).sum()),
    }


def main() -> int:
    """Run, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1] if __doc__ else '')
    parser.add_argument('cut', nargs='?', type=float, default=5.0)
    parser.add_argument('--role', nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SUBNET'
    os.environ['FASTDDS_BUILTIN_TRANSPORTS'] = 'UDPv4'
    os.environ.setdefault('ROS_DOMAIN_ID', '97')
    if arguments.role:
        role, seconds, folder = arguments.role
        {'sense': sense, 'receive': receive}[role](float(seconds), Path(folder))
        return 0
    if os.geteuid() != 0:
        sys.exit('Network namespaces need root.')
    result = run(arguments.cut)
    tell('two_hosts', result)
    return int(not result['came_after_the_cut'])


if __name__ == '__main__':
    sys.exit(main())
