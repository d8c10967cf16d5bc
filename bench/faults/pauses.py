"""
``pauses``: what holds the stream up, by how long things take beside correcting wrenches.

A node with six axes and six hours of history, on a disk whose fsync takes FSYNC_S. Messages that
wait meanwhile are those of 8 kHz, of which the subscription keeps 1000.
"""

import argparse
from collections.abc import Callable, Iterator
from functools import partial
from itertools import cycle
import os
from pathlib import Path
import time
from typing import Any

import numpy as np
from stand import keep, make_model, node_here, Sensor, write_warm_up

from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stored.model_file import load_model, restore_model
from wrist_ft_comp.stored.node_folder import HistoryEntry, MAX_HISTORY

#: Wrenches per second that the last column is for.
RATE_HZ = 8000
HISTORY_S = 6 * 3600
#: How long the disk takes for each file, s.
FSYNC_S = 0.5


def took_ms(work: Callable[[], object], times: int) -> tuple[float, float]:
    """Run something some times; median and longest, ms."""
    took = []
    for _ in range(times):
        before = time.perf_counter()
        work()
        took.append(1e3 * (time.perf_counter() - before))
    return float(np.median(took)), max(took)


def work_of(node: Any, model_path: Path, seed: int) -> dict[str, tuple[Callable[[], object], int]]:
    """Let a node live for hours; what it does beside correcting wrenches, and how often."""
    sensor = Sensor(seed)
    for second in range(HISTORY_S):
        sensor.advance(float(second))
        node.compensator.add_temperature(0, second * NANOSECONDS, sensor.celsius)
    tracker, last_s = node.compensator.tracker, HISTORY_S

    def report_after(pauses_s: Iterator[int]) -> None:
        nonlocal last_s
        last_s += 1 + next(pauses_s)
        node.compensator.add_temperature(0, last_s * NANOSECONDS, sensor.celsius)

    stored = node.live.stored
    node.live.history = [HistoryEntry(model_path, stored.sha256, why='Better.')] * MAX_HISTORY
    return {
        'state: take it and hand it over': (node.state_keeper.save, 200),
        'recording: begin and end': (lambda: (node.recorder.begin(), node.recorder.end()), 20),
        'tare: reset it': (node.tare.reset, 50),
        'learning: remember what was judged': (node.learning._remember, 50),  # noqa: SLF001
        'model: read and check a file': (lambda: load_model(model_path), 10),
        'model: restore a calibration': (
            lambda: restore_model(model_path, stored.sha256, stored.document), 50,
        ),
        'model: go live with 6 h of history': (lambda: node.compensator.go_live(stored.model), 5),
        **{
            # The second shows that the first was no stray, the third ends a cell.
            f'temperature: the end of a gap of {gap_s} s': (
                partial(report_after, cycle((gap_s, 0, 0))), 15,
            )
            for gap_s in (60, 3600, 12 * 3600)
        },
        'temperature: one that was loose is back': (lambda: tracker._doubt_loose(0, 5, 47), 20),  # noqa: SLF001
        'housekeeping, 10 times a second': (node.housekeep, 200),
        'diagnostics, once a second': (node._diagnose, 200),  # noqa: SLF001
    }  # fmt: skip


def measure(arguments: argparse.Namespace, folder: Path) -> bool:
    """Make a node, time what it does, and print a table."""
    model_path = make_model(write_warm_up(folder / 'warm_up.csv'), folder / 'models/m.yaml')
    with node_here(folder, model_path) as node:
        os.fsync = lambda _: time.sleep(FSYNC_S)  # type: ignore[assignment]
        print(f'{"what a callback does":60} median, ms  longest, ms  messages at 8 kHz')
        measured = {}
        for what, (do, times) in work_of(node, model_path, arguments.seed).items():
            median, longest = measured[what] = took_ms(do, times * arguments.times)
            print(f'{what:60}{median:11.2f}{longest:13.2f}{longest * RATE_HZ / 1000:19.0f}')
    keep('pauses.json', measured)
    return True
