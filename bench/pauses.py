"""
What holds the stream up: how long things take that are done beside correcting wrenches.

``python bench/pauses.py``. A node with six axes and six hours of history. A table on standard
output, figures in ``out/pauses.json``; messages that wait meanwhile are those of 8 kHz, of which
the subscription keeps 1000.
"""

from collections.abc import Callable
import json
from pathlib import Path
import sys
import tempfile
import time
from typing import Any

import numpy as np
from stand import make_model, own_domain, Sensor, write_warm_up

from wrist_ft_comp.stored.model_file import load_model, restore_model
from wrist_ft_comp.stored.state_file import save_state, SavedState

#: Wrenches per second that the last column is for.
RATE_HZ = 8000


def timed(work: Callable[[], object], times: int) -> tuple[float, float]:
    """Run something some times; median and longest, ms."""
    took = []
    for _ in range(times):
        before = time.perf_counter()
        work()
        took.append(1e3 * (time.perf_counter() - before))
    return float(np.median(took)), max(took)


def measure(folder: Path) -> dict[str, tuple[float, float]]:
    """Make a node and time what it does."""
    from rclpy.context import Context  # noqa: PLC0415 -- after the environment is set
    from rclpy.parameter import Parameter  # noqa: PLC0415

    from wrist_ft_comp.node.compensator import CompensatorNode  # noqa: PLC0415

    model_path = make_model(write_warm_up(folder / 'warm_up.csv'), folder / 'models/m.yaml')
    context: Any = Context()
    context.init([])
    untyped: Any = Parameter
    given = {'data_directory': str(folder), 'model_file': str(model_path)}
    node: Any = CompensatorNode(
        context=context,
        parameter_overrides=[untyped(name, value=value) for name, value in given.items()],
    )
    sensor = Sensor(0)
    for second in range(6 * 3600):
        sensor.advance(float(second))
        node.compensator.add_temperature(0, second * 10**9, sensor.celsius)
    stored = node.live.stored
    state = SavedState(1, stored.sha256, np.zeros(6), node.compensator.memory())
    measured = {
        'state: take it and hand it over (callback)': timed(node.state_keeper.save, 200),
        'state: write it, fsync (thread)': timed(
            lambda: save_state(folder / 'other.json', state), 50
        ),
        'model: read and check a file (set at run time)': timed(
            lambda: load_model(model_path), 10
        ),
        'model: restore a calibration (callback)': timed(
            lambda: restore_model(model_path, stored.sha256, stored.document), 50
        ),
        'model: go live with 6 h of history (callback)': timed(
            lambda: node.compensator.go_live(stored.model), 5
        ),
        'model: remember it (callback)': timed(
            lambda: node.store.activate([None, model_path]), 50
        ),
        'housekeeping, 10 times a second': timed(node._keep_house, 200),  # noqa: SLF001
        'diagnostics, once a second': timed(node._diagnose, 200),  # noqa: SLF001
    }
    node.destroy_node()
    context.try_shutdown()
    return measured


def main() -> int:
    """Measure and print."""
    own_domain(96)
    with tempfile.TemporaryDirectory() as name:
        measured = measure(Path(name))
    print(f'{"what":50} median, ms  longest, ms  messages at 8 kHz')
    for what, (median, longest) in measured.items():
        print(f'{what:50}{median:11.2f}{longest:13.2f}{longest * RATE_HZ / 1000:19.0f}')
    out = Path(__file__).resolve().parent.parent / 'out'
    out.mkdir(exist_ok=True)
    (out / 'pauses.json').write_text(json.dumps(measured, indent=1), 'utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
