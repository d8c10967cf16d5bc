"""
Kill the node again and again while it learns, adopts and tidies up, and load every file.

``python bench/learning_kills.py [KILLS] [--seed N]``, 20 unless told; 200 take half an hour. Each
life of the node finds some days at work that nobody has judged, and is ended by SIGKILL: at a
random time, or a moment after a model, the list of models, the diary or what the node remembers
was written. The first half of the lives have to be asked to adopt, the others adopt by themselves.
After each, every file is loaded, and the live model has to be the one from before or a new one.
Figures on standard output and in ``out/learning_kills.json``; exit code 1 when one does not load.
"""

import argparse
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
import shutil
import sys
import tempfile
import time

from kills import check_files, tell, WRITING_S, written
import numpy as np
from stand import GAINS, message, NOISE, own_domain, Stand

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.learning.day_files import DayFiles
from wrist_ft_comp.learning.diary import diary_path, KIND
from wrist_ft_comp.learning.memory import load_memory
from wrist_ft_comp.recordings.recordings import read_recording
from wrist_ft_comp.signals import AXES, GRAVITY, NANOSECONDS
from wrist_ft_comp.stored.model_store import ModelStore
from wrist_ft_comp.stored.payload_file import load_payloads
from wrist_ft_comp.stream.cell_averager import row_channels

#: Lengths of a thermal cell, of a day and of a pose, s, and number of the days that are found.
CELL_S, DAY_S, POSE_S, DAYS = 10, 9000, 60, 4
START_S = 1_700_000_000
#: What is held: kg, and where its centre is, m.
MASS_KG, CENTRE_M = 1.2, np.array([0.01, -0.02, 0.08])
#: What a life is killed upon, as a pattern; nothing is a random time. How long it may take, s.
AIMS = ('', 'models/*', 'days/diary.json', '', 'active.json', 'learning.json', 'days/*.csv')
LONGEST_S = 40.0


def write_days(
    data: Path, rng: np.random.Generator, days: int = DAYS, cell_s: int = CELL_S
) -> None:
    """Write days at work of a sensor that lags its thermometer."""
    names, cells = row_channels(1, with_force=True), DAY_S // cell_s
    for day in range(days):
        files = DayFiles(data, names, 1e9)
        heat = np.repeat(rng.uniform(0.0, 20.0, 5), cells // 5)
        celsius, lagged, warmth, lag = [], [], float(heat[0]), float(heat[0])
        for each in heat:
            warmth += (each - warmth) * cell_s / 400.0
            lag += (warmth - lag) * cell_s / 300.0
            celsius.append(20.0 + warmth + 2.0 * day)
            lagged.append(lag + 2.0 * day)
        tilts = rng.normal((0.0, 0.0, 1.0), 0.6, (DAY_S // POSE_S, 3))
        tilts = np.repeat(tilts, POSE_S // cell_s, axis=0)
        force = GRAVITY * tilts / np.linalg.norm(tilts, axis=1, keepdims=True)
        push = -MASS_KG * force
        wrench = np.column_stack([push, np.cross(CENTRE_M, push)])
        wrench += np.outer(lagged, GAINS) + rng.normal(0.0, 1.0, wrench.shape) * NOISE
        for cell in range(cells):
            stamp_ns = (START_S + 86_400 * day + cell_s * cell) * NANOSECONDS
            absent = [np.nan] * len(AXES)
            files.append(stamp_ns, [*wrench[cell], *absent, celsius[cell], *force[cell], 0.01])
        files.close()


def live_a_life(stand: Stand, first_s: int, rng: np.random.Generator, aim: str) -> int:
    """Start the node, let it learn and adopt, kill it; return the newest stamp, s."""
    from geometry_msgs.msg import WrenchStamped  # noqa: PLC0415 -- after the environment is set
    from sensor_msgs.msg import Imu, Temperature  # noqa: PLC0415
    from std_srvs.srv import Trigger  # noqa: PLC0415

    ends = [
        stand.talker.create_publisher(kind, topic, 100)
        for kind, topic in ((Imu, 'imu'), (WrenchStamped, 'wrench_raw'))
    ]
    imu, wrenches = ends
    heats = stand.talker.create_publisher(Temperature, 'temperature', 100)
    inertial = [0.0] * 37
    inertial[25:28] = 0.0, 0.0, GRAVITY
    before = written(stand.data, aim)
    stand.start_node()
    end, ticks = time.monotonic() + (LONGEST_S if aim else rng.uniform(0.5, LONGEST_S / 2)), 0
    while time.monotonic() < end:
        if aim and written(stand.data, aim) != before:
            aim, end = '', time.monotonic() + rng.uniform(0.0, WRITING_S)
        stamp_ns = (first_s + CELL_S * ticks) * NANOSECONDS
        imu.publish(message(stamp_ns, inertial))
        wrenches.publish(message(stamp_ns, [0.0, 0.0, -MASS_KG * GRAVITY, 0.0, 0.0, 0.0]))
        heats.publish(message(stamp_ns, (25.0 + np.sin(ticks / 100), 0.0)))
        if ticks % 20 == 19:
            stand.call('adopt', Trigger, Trigger.Request())
        if ticks % 900 == 899:
            stand.call('rollback', Trigger, Trigger.Request())
        ticks += 1
        time.sleep(0.01)
    stand.end_node()
    for each in (*ends, heats):
        stand.talker.destroy_publisher(each)
    return first_s + CELL_S * ticks


def check_days(data: Path, seen: Counter[str]) -> list[str]:
    """Load what a node that learns has kept; return the sentences of what does not load."""
    broken = []
    loads: list[tuple[str, Path, Callable[[Path], object]]] = [
        ('diaries', diary_path(data), KIND.load_json),
        ('memories', data, load_memory),
        ('payloads', data / 'models/payloads.json', load_payloads),
    ]
    loads += [('days', path, read_recording) for path in (data / 'days').glob('*.csv')]
    for kind, path, load in loads:
        if path.suffix == '.csv' and path.read_bytes().count(b'\n') <= 2:
            seen['days with no more than one cell'] += 1
            continue
        try:
            seen[kind] += path.exists() and load(path) is not None
        except WristFtCompError as error:
            broken.append(str(error))
    return broken


def main() -> int:
    """Kill, check, tell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1] if __doc__ else '')
    parser.add_argument('kills', nargs='?', type=int, default=20)
    parser.add_argument('--seed', type=int, default=0)
    arguments = parser.parse_args()
    own_domain(93)
    rng = np.random.default_rng(arguments.seed)
    seen: Counter[str] = Counter()
    broken: list[str] = []
    known: set[Path] = set()
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        found, data = Path(name) / 'found', Path(name) / 'data'
        write_days(found, rng)
        for number in range(arguments.kills):
            mode = 'propose' if number < arguments.kills / 2 else 'auto'
            shutil.rmtree(data / 'days', ignore_errors=True)
            shutil.copytree(found / 'days', data / 'days')
            for each in ('learning.json', *(['active.json'] if number % 3 else [])):
                (data / each).unlink(missing_ok=True)
            before = ModelStore(data).history()[-1:]
            stand = Stand(
                data,
                f'learning:={mode}',
                'calibration.reference:=payload',
                'gravity.source:=imu',
                'learning.keep_days:=3',
                'calibration.method:=pls',
                f'thermal_period:={float(CELL_S)}',
                'save_period:=0.1',
            )
            try:
                live_a_life(stand, START_S + 86_400 * (DAYS + 2), rng, AIMS[number % len(AIMS)])
            finally:
                stand.close()
            broken += check_files(data, seen, known) + check_days(data, seen)
            with suppress(WristFtCompError):
                live = ModelStore(data).history()[-1:]
                seen['lives that changed the live model'] += live != before
            left = [(data / 'days' / each.name).exists() for each in (found / 'days').iterdir()]
            seen['lives in which days were removed'] += not all(left)
    result = {'kills': arguments.kills, 'loaded': dict(seen), 'broken': broken}
    tell('learning_kills', begun, result)
    return 1 if broken or not seen['days'] else 0


if __name__ == '__main__':
    sys.exit(main())
