"""
``fuzz``: tens of thousands of damaged messages and files, and what readers make of them.

Each input is a good one that was cut, flipped, spliced, or had words of its format put in or
repeated. A reader may take it, or refuse it with one of the package's own errors within MAX_S;
anything else is a fault, and its input is kept in ``out/``.
"""

import argparse
from collections import Counter
from collections.abc import Callable
from functools import partial
import math
from pathlib import Path
import signal
import time
import traceback
from types import FrameType
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores
from stand import keep, make_model, message, Sensor, write_warm_up

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.cli.show import days_text
from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.learning import days
from wrist_ft_comp.learning.days import DayEntry, Diary, diary_path, Memory
from wrist_ft_comp.recordings.read import read_recording
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.node_folder import HistoryEntry, NodeFolder
from wrist_ft_comp.stored.state_file import belongs_to, load_state, save_state, SavedState
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings
from wrist_ft_comp.wire.cdr import locate, WRENCH_DOUBLES

#: A reader that takes longer hangs, s.
MAX_S = 5.0
#: What is put into files, because parsers have opinions about it.
WORDS = [
    b'NaN', b'.inf', b'-1e999', b'1' + b'0' * 400, b'null', b'true', b'{}', b'[]', b'[[[[[[[[',
    b'&a [*a]', b'*a', b'!!python/object/apply:os.system [x]', b'!!binary "."', b'<<: *a', b'\0',
    b'\xff\xfe', b'\r\n', b'"', b"'", b'---\n', b'- ', b': ', b'\t', b'2024-01-01',
    b'0x7fffffffffffffff', b'-9223372036854775809', b',' * 50, b'\n' * 50,
]  # fmt: skip


def damaged(good: bytes, rng: np.random.Generator) -> bytes:
    """Damage good bytes in one to five ways."""
    data = bytearray(good)
    for _ in range(rng.integers(1, 6)):
        at, end = sorted(rng.integers(0, len(data) + 1, 2).tolist())
        end = min(end, at + int(rng.integers(1, 64)))
        how = rng.integers(7)
        if how == 0 and data:
            data[at % len(data)] = int(rng.integers(256))
        elif how == 1 and data:
            data[at % len(data)] ^= 1 << int(rng.integers(8))
        elif how == 2:
            del data[at:end]
        elif how == 3:
            data[at:at] = data[at:end] * int(rng.integers(1, 9))
        elif how == 4:
            data[at:end] = WORDS[rng.integers(len(WORDS))]
        elif how == 5:
            data[at:end] = rng.bytes(end - at)
        elif rng.integers(4) == 0:
            del data[at:]
    return bytes(data)


class Targets:
    """Readers, each with a good input; files are made in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        recording = write_warm_up(folder / 'good.csv', 1200, 10)
        model = make_model(recording, folder / 'good.yaml')
        self._model = load_model(model).model
        self._compensator = Compensator(1, StreamSettings(), self._model)
        for second in range(100):
            self._compensator.add_temperature(0, second * 10**9, 25.0)
        state = SavedState(1, 'a' * 64, np.zeros(6), self._compensator.memory())
        save_state(folder / 'good.json', state)
        history = [HistoryEntry(None), HistoryEntry(model, 'b' * 64, why='It is better.')]
        NodeFolder(folder).activate(history, 'b' * 64)
        left = {'none': (3.0,) * 6, 'c' * 12: (0.3,) * 6}
        days.save_diary(
            folder, Diary((DayEntry('day_00001.csv', 1, 2.0, ((20.0, 30.0),), left=left),))
        )
        mcap, sqlite = map(self._bag, (StoragePlugin.MCAP, StoragePlugin.SQLITE3))
        lines = recording.read_bytes().splitlines(keepends=True)
        self.readers: dict[str, tuple[bytes, Callable[[bytes], None]]] = {
            'wire': (message(10**18, (1, 2, 3, 4, 5, 6.0)), self.wire),
            'model file': (model.read_bytes(), partial(self.file, 'm.yaml', load_model)),
            'state file': ((folder / 'good.json').read_bytes(), self.state),
            'list of models': ((folder / 'active.json').read_bytes(), self.store),
            'diary': (diary_path(folder).read_bytes(), self.diary),
            'CSV': (b''.join(lines[:40]), partial(self.file, 'r.csv', read_recording)),
            'mcap': (mcap, partial(self.file, 'b.mcap', read_recording)),
            'sqlite': (sqlite, partial(self.file, 'b.db3', read_recording)),
        }  # fmt: skip

    def _bag(self, storage: StoragePlugin) -> bytes:
        """Write a small bag and read its storage file."""
        store: Any = get_typestore(Stores.ROS2_JAZZY)
        path, sensor = self._folder / storage.name, Sensor(1)
        with Writer(path, version=9, storage_plugin=storage) as writer:
            for topic, kind, doubles in (
                ('/wrench_raw', 'geometry_msgs/msg/WrenchStamped', 6),
                ('/temperature', 'sensor_msgs/msg/Temperature', 2),
            ):
                connection = writer.add_connection(topic, kind, typestore=store)
                for second in range(1, 31):
                    values = sensor.raw() if doubles == len(AXES) else (20.0 + second / 10, 0.0)
                    writer.write(connection, second * 10**9, message(second * 10**9, values))
        return next(p for p in path.iterdir() if p.suffix in {'.mcap', '.db3'}).read_bytes()

    def wire(self, data: bytes) -> None:
        """Do what the node does with a message."""
        layout = locate(data, WRENCH_DOUBLES)
        stamp_ns, raw = layout.decode(data)
        if math.isfinite(sum(raw)):
            sent = layout.encode(data, self._compensator.correct(stamp_ns, raw))
            if sent[: layout.offset] != data[: layout.offset] or len(sent) != len(data):
                raise AssertionError('the header changed')
        layout.frame_id(data)

    def file(self, name: str, load: Callable[[Path], object], data: bytes) -> None:
        """Load a file; what loads must run."""
        path = self._folder / name
        path.write_bytes(data)
        loaded: Any = load(path)
        if name == 'm.yaml':
            Compensator(loaded.model.thermometers, StreamSettings(), loaded.model)

    def state(self, data: bytes) -> None:
        """Load a state; one that fits the model must run."""
        path = self._folder / 's.json'
        path.write_bytes(data)
        state = load_state(path)
        if state and state.thermal and belongs_to(self._model, state.thermal):
            compensator = Compensator(1, StreamSettings(), self._model)
            compensator.resume(state.thermal, 0.0)
            for second in range(3):
                compensator.add_temperature(0, second * 10**9, 25.0)
            if not np.isfinite(compensator.correct(0, [0.0] * 6)).all():
                raise AssertionError('the output is not finite')

    def store(self, data: bytes) -> None:
        """Read the list of models."""
        (self._folder / 'active.json').write_bytes(data)
        store = NodeFolder(self._folder)
        store.given()
        store.history()

    def diary(self, data: bytes) -> None:
        """Show a diary."""
        diary_path(self._folder).write_bytes(data)
        if days.load_diary(self._folder).days:
            days_text(self._folder, days.survey(self._folder), Memory())


class TooSlow(BaseException):
    """A reader hangs; no reader's own ``except Exception`` may hide it."""


def too_slow(_number: int, _frame: FrameType | None) -> None:
    """Interrupt a reader that hangs."""
    raise TooSlow(f'longer than {MAX_S} s')


def feed(name: str, targets: Targets, inputs: int, seed: int) -> dict[str, Any]:
    """Feed one reader; count what it took and refused, and its faults."""
    good, read = targets.readers[name]
    read(good)
    rng = np.random.default_rng(seed)
    counts: Counter[str] = Counter()
    slowest_s = 0.0
    for number in range(inputs):
        data = damaged(good, rng)
        before = time.perf_counter()
        signal.setitimer(signal.ITIMER_REAL, MAX_S)
        try:
            read(data)
        except WristFtCompError:
            counts['refused'] += 1
        except (Exception, TooSlow):
            counts['FAULTS'] += 1
            keep(f'fuzz_{name.replace(" ", "_")}_{number}', data)
            print(f'{name}, input {number}:\n{traceback.format_exc()}')
        else:
            counts['taken'] += 1
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
        slowest_s = max(slowest_s, time.perf_counter() - before)
    return {'inputs': inputs, **counts, 'slowest_ms': round(1e3 * slowest_s, 1)}


def fuzz(arguments: argparse.Namespace, folder: Path) -> bool:
    """Feed every reader, print a table; whether there was no fault."""
    signal.signal(signal.SIGALRM, too_slow)
    targets, results = Targets(folder), {}
    columns = ('inputs', 'taken', 'refused', 'FAULTS', 'slowest_ms')
    print(f'{"reader":16}' + ''.join(f'{column:>12}' for column in columns))
    for name in targets.readers:
        tally = results[name] = feed(name, targets, arguments.inputs, arguments.seed)
        cells = ''.join(f'{tally.get(column, 0):12}' for column in columns)
        print(f'{name:16}{cells}', flush=True)
    keep('fuzz.json', results)
    return not any('FAULTS' in tally for tally in results.values())
