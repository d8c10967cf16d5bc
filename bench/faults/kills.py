"""
Kill the node again and again while it writes, and load every file that it left.

``kills``: each life is ended by SIGKILL in the middle of a recording, of calibrations that follow
each other, of tares and rollbacks, and of a state that is saved ten times a second. ``learning``:
each life finds some days at work that nobody has judged, learns, adopts and tidies up; the first
half of the lives have to be asked to adopt, the others adopt by themselves.

A life ends at a random time, or within WRITING_S of a file of a pattern being written.
"""

import argparse
from collections import Counter
from collections.abc import Callable
from contextlib import closing, suppress
from functools import partial
from pathlib import Path
import shutil
import time
from typing import Any

from geometry_msgs.msg import WrenchStamped
import numpy as np
from sensor_msgs.msg import Imu, Temperature
import stand as stands
from stand import COLD_C, GAINS, HASTE, message, NOISE, Sensor, Stand
from std_srvs.srv import SetBool

from wrist_ft_comp.channels import AXES, GRAVITY
from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.learning.days import DayFiles, DIARY, Diary, load_memory
from wrist_ft_comp.recordings.read import read_recording
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.node_folder import NodeFolder
from wrist_ft_comp.stored.payload_file import load_payloads
from wrist_ft_comp.stored.state_file import load_state
from wrist_ft_comp.stream.thermal_cells import row_channels

#: Longest time from the writing of a file to the kill that aims at it, s.
WRITING_S = 0.2
#: What the lives are killed upon, by turns, as a pattern of files; empty for a random time.
AIMS = ('models/*', '', '*active.json*', '')
LEARNING_AIMS = (
    '', 'models/*', 'days/diary.json', '', 'active.json', 'learning.json', 'days/*.csv',
)  # fmt: skip
#: Longest life that ends at a random time, s, of which the start takes about one.
LONGEST_LIFE_S = 4.0
#: How long a life waits at most for the file it is aimed at, s.
LONGEST_WAIT_S, LONGEST_LEARNING_S = 12.0, 40.0
START_S = 1_700_000_000
#: Thermal cell, day, and time in a pose, s, and how many days a life finds.
CELL_S, DAY_S, POSE_S, DAYS = 10, 9000, 60, 4
#: A node with such cells that keeps three days.
FEW_LONG_DAYS = f"""
from wrist_ft_comp.node import compensator_node
compensator_node.StreamSettings = partial(
    compensator_node.StreamSettings, thermal_period_s={CELL_S:.1f}
)
"""
MASS_KG, CENTRE_M = 1.2, np.array([0.01, -0.02, 0.08])
#: What is loaded: its name, what loads a path, and its pattern in the data directory.
FILES: tuple[tuple[str, Callable[[Path], object], str], ...] = (
    ('models, the last five again after each kill', load_model, 'models/*.yaml'),
    ('payloads', load_payloads, 'models/payloads.json'),
    ('recordings', read_recording, 'recordings/recording_*.csv'),
    ('states', load_state, 'state.json'),
    ('days', read_recording, 'days/*.csv'),
    ('diaries', partial(DIARY.load, Diary), 'days/diary.json'),
    ('memories', lambda path: load_memory(path.parent), 'learning.json'),
)


def written(data: Path, pattern: str) -> set[tuple[str, int]]:
    """Give the files of a pattern, and when each was written."""
    names = set()
    for path in data.glob(pattern or 'none'):
        with suppress(FileNotFoundError):
            names.add((path.name, path.stat().st_mtime_ns))
    return names


class Victim:
    """A node that is kept busy and killed, when ``rng`` says so, and what its files held."""

    def __init__(self, data: Path, rng: np.random.Generator) -> None:
        self.data, self.rng = data, rng
        self.seen: Counter[str] = Counter()
        self.broken: list[str] = []
        self._models: set[Path] = set()

    def live(self, stand: Stand, life_s: float, aim: str, keep_busy: Callable[[int], None]) -> int:
        """Start the node, keep it busy a hundred times a second, kill it; count the ticks."""
        before = written(self.data, aim)
        stand.start_node()
        end, ticks = time.monotonic() + life_s, 0
        while time.monotonic() < end:
            if aim and written(self.data, aim) != before:
                aim, end = '', time.monotonic() + self.rng.uniform(0.0, WRITING_S)
            keep_busy(ticks)
            ticks += 1
            time.sleep(0.01)
        stand.end_node()
        return ticks

    def check_files(self) -> None:
        """Load everything, and count it."""
        models = set((self.data / 'models').glob('*.yaml'))
        self.seen['calibrations that made a model'] += len(models - self._models)
        self._models |= models
        for kind, load, pattern in FILES:
            for path in sorted(self.data.glob(pattern)):
                self._attempt(kind, path, load)
        try:
            for entry in NodeFolder(self.data).history()[-1:]:
                if entry.path is not None:
                    load_model(entry.path)
                    self.seen['lives that end with a model'] += 1
        except WristFtCompError as error:
            self.broken.append(str(error))
        leftovers = list(self.data.rglob('.*.tmp'))
        self.seen['temporary files left by kills, swept'] += len(leftovers)
        for path in leftovers:
            path.unlink()

    def _attempt(self, kind: str, path: Path, load: Callable[[Path], object]) -> None:
        """Load a file; a recording of less than two cells may be refused."""
        try:
            load(path)
        except WristFtCompError as error:
            if path.suffix == '.csv' and path.read_bytes().count(b'\n') <= 2:
                self.seen[f'{kind} with no more than one cell'] += 1
            else:
                self.broken.append(str(error))
        else:
            self.seen[kind] += 1

    def tell(self, name: str, kills: int, needed: str) -> bool:
        """Print what was found; whether everything loaded, and something of what is needed."""
        stands.tell(name, {'kills': kills, 'loaded': dict(self.seen), 'broken': self.broken})
        return not self.broken and self.seen[needed] > 0


def busy_recording(
    stand: Stand, ends: tuple[Any, Any], begun_ns: int, rng: np.random.Generator
) -> Callable[[int], None]:
    """Record, calibrate, tare and roll back; stamps run a second in every tick."""
    wrenches, temperatures = ends
    sensor = Sensor(1)

    def keep_busy(tick: int) -> None:
        stamp_ns = begun_ns + tick * NANOSECONDS
        temperatures.publish(message(stamp_ns, (COLD_C + 5 * np.sin(tick / 100), 0.0)))
        for quarter in range(4):
            wrenches.publish(message(stamp_ns + quarter * NANOSECONDS // 4, sensor.raw()))
        if tick % 20 == 0:
            stand.call('record', SetBool, SetBool.Request(data=tick % 40 == 0))
        tare = str(rng.choice(['tare', 'reset_tare']))
        for name, period in (('calibrate', 5), (tare, 7), ('rollback', 300)):
            if tick % period == period - 1:
                stand.call(name)

    return keep_busy


def kill_recording(arguments: argparse.Namespace, folder: Path) -> bool:
    """Kill a node that records, calibrates and saves."""
    data = folder / 'data'
    warm_up = stands.write_warm_up(data / 'warm_up.csv', 1800, 10)
    victim = Victim(data, np.random.default_rng(arguments.seed))
    newest_ns = START_S * NANOSECONDS
    given = f'calibration.recordings:=[{warm_up}]', 'tare.duration:=0.5'
    with closing(Stand(data, *given, source=HASTE)) as stand:
        ends = (
            stand.talker.create_publisher(WrenchStamped, 'wrench_raw', 100),
            stand.talker.create_publisher(Temperature, 'temperature', 100),
        )
        for number in range(arguments.kills):
            aim = AIMS[number % len(AIMS)]
            life_s = LONGEST_WAIT_S if aim else float(victim.rng.uniform(0.2, LONGEST_LIFE_S))
            newest_ns += 5 * NANOSECONDS
            busy = busy_recording(stand, ends, newest_ns, victim.rng)
            newest_ns += victim.live(stand, life_s, aim, busy) * NANOSECONDS
            victim.check_files()
            old_models = sorted((data / 'models').glob('*.yaml'))[:-5]
            for path in (*old_models, *(data / 'recordings').glob('recording_*.csv')):
                path.unlink()
    return victim.tell('kills', arguments.kills, 'states')


def write_days(
    data: Path, rng: np.random.Generator, days: int = DAYS, cell_s: int = CELL_S
) -> None:
    """Write days at work of a sensor that lags its thermometer."""
    names, cells = row_channels(1, with_force=True), DAY_S // cell_s
    for day in range(days):
        files = DayFiles(data, names, 1e9)
        room_k = np.repeat(rng.uniform(0.0, 20.0, 5), cells // 5)
        celsius, lagged, warmth_k, lag_k = [], [], float(room_k[0]), float(room_k[0])
        for level_k in room_k:
            warmth_k += (level_k - warmth_k) * cell_s / 400.0
            lag_k += (warmth_k - lag_k) * cell_s / 300.0
            celsius.append(20.0 + warmth_k + 2.0 * day)
            lagged.append(lag_k + 2.0 * day)
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


def busy_learning(stand: Stand) -> Callable[[int], None]:
    """Work, adopt and roll back; stamps run a thermal cell in every tick."""
    kinds = {'imu': Imu, 'wrench_raw': WrenchStamped, 'temperature': Temperature}
    imu, wrenches, temperatures = (
        stand.talker.create_publisher(kind, topic, 100) for topic, kind in kinds.items()
    )
    at_rest = [0.0] * 37
    at_rest[25:28] = 0.0, 0.0, GRAVITY

    def keep_busy(tick: int) -> None:
        stamp_ns = (START_S + 86_400 * (DAYS + 2) + CELL_S * tick) * NANOSECONDS
        imu.publish(message(stamp_ns, at_rest))
        wrenches.publish(message(stamp_ns, [0.0, 0.0, -MASS_KG * GRAVITY, 0.0, 0.0, 0.0]))
        temperatures.publish(message(stamp_ns, (25.0 + np.sin(tick / 100), 0.0)))
        if tick % 20 == 19:
            stand.call('adopt')
        if tick % 900 == 899:
            stand.call('rollback')

    return keep_busy


def kill_learning(arguments: argparse.Namespace, folder: Path) -> bool:
    """Kill a node that learns; the live model has to be the one from before or a new one."""
    found, data = folder / 'found', folder / 'data'
    victim = Victim(data, np.random.default_rng(arguments.seed))
    write_days(found, victim.rng)
    for number in range(arguments.kills):
        shutil.rmtree(data / 'days', ignore_errors=True)
        shutil.copytree(found / 'days', data / 'days')
        (data / 'learning.json').unlink(missing_ok=True)
        if number % 3:
            (data / 'active.json').unlink(missing_ok=True)
        live_before = NodeFolder(data).history()[-1:]
        mode = 'propose' if number < arguments.kills / 2 else 'auto'
        given = f'learning.mode:={mode}', 'calibration.reference:=payload', 'gravity.source:=imu'
        aim = LEARNING_AIMS[number % len(LEARNING_AIMS)]
        longest_s = LONGEST_LEARNING_S
        life_s = longest_s if aim else float(victim.rng.uniform(0.5, longest_s / 2))
        with closing(Stand(data, *given, source=f'{HASTE}{FEW_LONG_DAYS}')) as stand:
            victim.live(stand, life_s, aim, busy_learning(stand))
        victim.check_files()
        with suppress(WristFtCompError):
            changed = NodeFolder(data).history()[-1:] != live_before
            victim.seen['lives that changed the live model'] += changed
        kept = [(data / 'days' / path.name).exists() for path in (found / 'days').iterdir()]
        victim.seen['lives in which days were removed'] += not all(kept)
    return victim.tell('learning_kills', arguments.kills, 'days')
