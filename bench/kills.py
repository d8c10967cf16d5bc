"""
Kill the node again and again while it records, calibrates and saves, and load every file.

``python bench/kills.py [KILLS] [--seed N]``. Each life of the node is ended by SIGKILL, in the
middle of a recording, of calibrations that follow each other, of tares and rollbacks, and of a
state that is saved ten times a second: half of them after a random time, a quarter a moment after
a model begins to be written, a quarter after the list of models was. After each, every file it
left is loaded. Figures on standard output and in ``out/kills.json``; exit code 1 when one does not
load.
"""

import argparse
from collections import Counter
from contextlib import suppress
import json
from pathlib import Path
import sys
import tempfile
import time

import numpy as np
from stand import COLD_C, message, own_domain, Sensor, Stand, write_warm_up

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.recordings.recordings import read_recording
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.model_store import ModelStore
from wrist_ft_comp.stored.state_file import load_state

#: Longest life of a node after its start, s; starting takes about a second of it.
LONGEST_LIFE_S = 4.0
#: What every fourth life and the one after the next are killed upon, as a pattern.
AIMS = ('', 'models/*', '', '*active.json*')
#: Longest life of one that waits for that, s, and how long it may write, s.
LONGEST_WAIT_S = 12.0
WRITING_S = 0.2


def written(data: Path, pattern: str) -> set[tuple[str, int]]:
    """Give the files of a pattern, and when each was written."""
    names = set()
    for path in data.glob(pattern or 'none'):
        with suppress(FileNotFoundError):
            names.add((path.name, path.stat().st_mtime_ns))
    return names


def live_a_life(
    stand: Stand, life_s: float, start_ns: int, rng: np.random.Generator, aim: str
) -> int:
    """Start the node, keep it busy, kill it; return the newest stamp."""
    from geometry_msgs.msg import WrenchStamped  # noqa: PLC0415 -- after the environment is set
    from sensor_msgs.msg import Temperature  # noqa: PLC0415
    from std_srvs.srv import SetBool, Trigger  # noqa: PLC0415

    wrenches = stand.talker.create_publisher(WrenchStamped, 'wrench_raw', 100)
    heats = stand.talker.create_publisher(Temperature, 'temperature', 100)
    sensor = Sensor(1)
    stand.start_node()
    end, ticks = time.monotonic() + life_s, 0
    recording = False
    before = written(stand.data, aim)
    while time.monotonic() < end:
        if aim and written(stand.data, aim) != before:
            aim, end = '', time.monotonic() + rng.uniform(0.0, WRITING_S)
        # A second of stamps every 10 ms, so that cells complete all the time.
        stamp = start_ns + ticks * 10**9
        heats.publish(message(stamp, (COLD_C + 5 * np.sin(ticks / 100), 0.0)))
        for part in range(4):
            wrenches.publish(message(stamp + part * 250_000_000, sensor.raw()))
        if ticks % 5 == 0:
            stand.call('calibrate', Trigger, Trigger.Request())
        if ticks % 20 == 0:
            recording = not recording
            stand.call('record', SetBool, SetBool.Request(data=recording))
        if ticks % 7 == 0:
            stand.call(str(rng.choice(['tare', 'reset_tare'])), Trigger, Trigger.Request())
        if ticks % 300 == 299:
            stand.call('rollback', Trigger, Trigger.Request())
        ticks += 1
        time.sleep(0.01)
    stand.end_node()
    stand.talker.destroy_publisher(wrenches)
    stand.talker.destroy_publisher(heats)
    return start_ns + ticks * 10**9


def check_files(data: Path, seen: Counter[str], known: set[Path]) -> list[str]:
    """Load everything; return the sentences of what does not load."""
    store, broken = ModelStore(data), []

    def attempt(kind: str, path: Path, load: object) -> None:
        try:
            load(path)  # type: ignore[operator] # one of the loaders below
        except WristFtCompError as error:
            if path.suffix == '.csv' and path.read_bytes().count(b'\n') <= 2:
                seen[f'{kind} with no more than one cell'] += 1
                return
            broken.append(str(error))
        else:
            seen[kind] += 1

    for path in sorted((data / 'models').glob('*.yaml')):
        seen['calibrations that made a model'] += path not in known
        known.add(path)
        attempt('models, the last five again after each kill', path, load_model)
    for path in sorted((data / 'recordings').glob('recording_*.csv')):
        attempt('recordings', path, read_recording)
    attempt('states', data / 'state.json', load_state)
    try:
        live = store.history()[-1:]
        if live and live[0] is not None:
            load_model(live[0])
            seen['lives that end with a model'] += 1
    except WristFtCompError as error:
        broken.append(str(error))
    leftovers = list(data.rglob('.*.tmp'))
    seen['temporary files left by kills, swept'] += len(leftovers)
    for path in leftovers:
        path.unlink()
    return broken


def tell(name: str, begun: float, result: dict[str, object]) -> None:
    """Print what was found since a monotonic time, s, and keep it in out/."""
    minutes = round((time.monotonic() - begun) / 60, 1)
    text = json.dumps({'minutes': minutes, **result}, indent=1)
    print(text)
    out = Path(__file__).resolve().parent.parent / 'out'
    out.mkdir(exist_ok=True)
    (out / f'{name}.json').write_text(text, 'utf-8')


def main() -> int:
    """Kill, check, tell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1] if __doc__ else '')
    parser.add_argument('kills', nargs='?', type=int, default=200)
    parser.add_argument('--seed', type=int, default=0)
    arguments = parser.parse_args()
    own_domain(94)
    rng = np.random.default_rng(arguments.seed)
    seen: Counter[str] = Counter()
    broken: list[str] = []
    known: set[Path] = set()
    newest_ns, begun = 1_700_000_000 * 10**9, time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        data = Path(name) / 'data'
        warm_up = write_warm_up(data / 'warm_up.csv', 1800, 10)
        stand = Stand(
            data,
            f'calibration.recordings:=[{warm_up}]',
            'calibration.method:=pls',
            'thermal_period:=1.0',
            'save_period:=0.1',
            'tare.duration:=0.5',
        )
        try:
            for number in range(arguments.kills):
                aim = AIMS[number % len(AIMS)]
                life_s = LONGEST_WAIT_S if aim else float(rng.uniform(0.2, LONGEST_LIFE_S))
                newest_ns = live_a_life(stand, life_s, newest_ns + 5 * 10**9, rng, aim)
                broken += check_files(data, seen, known)
                for path in sorted((data / 'models').glob('*.yaml'))[:-5]:
                    path.unlink()
                for path in (data / 'recordings').glob('recording_*.csv'):
                    path.unlink()
        finally:
            stand.close()
    tell('kills', begun, {'kills': arguments.kills, 'loaded': dict(seen), 'broken': broken})
    return 1 if broken or not seen['states'] else 0


if __name__ == '__main__':
    sys.exit(main())
