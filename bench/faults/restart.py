"""
What a killed node subtracts when it is back: ``restart``.

A node is killed at a random moment of a warm-up, is away for up to ten seconds, and goes on from
the state that it saved, which is up to five seconds old. What it subtracts then is compared with
that of a node that was never killed, and of one that begins anew; time is simulated.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from robot import Robot, surroundings
from stand import keep

from wrist_ft_comp.series import FloatArray

#: When the node may be killed, how long it is away at most, and is watched then, s.
KILLED_S, AWAY_S, WATCHED_S = (120, 900), 10, 60
#: The first cells after it is back, s, are those of a ramp.
RAMP_S = 10
#: Largest deviation that is allowed, as a share of the drift since the warm-up began.
LIMIT = 0.02


def subtracted(robot: Robot, killed_s: int, away_s: int, *, anew: bool = False) -> FloatArray:
    """Kill a node, or none for 0 s away; give the drift of force z first and after that, N."""
    drift = []
    with robot.around():
        robot.start()
        for second in range(killed_s + AWAY_S + WATCHED_S):
            if away_s and second == killed_s:
                robot.kill(forget=anew)
            if away_s and second == killed_s + away_s:
                robot.start()
            robot.step(1.0)
            if second == 2 * RAMP_S or second >= killed_s + AWAY_S + RAMP_S:
                drift.append(robot.node.compensator.compensation.zero[2])
        robot.kill()
    return np.array(drift)


def kill_once(
    seed: int, killed_s: int, away_s: int, folder: Path, **shared: Any
) -> dict[str, float]:
    """Give the drift so far, and the largest deviations as shares of it."""
    lives = {'never': (0, False), 'again': (away_s, False), 'anew': (away_s, True)}
    never, again, anew = (
        subtracted(Robot(seed, folder=folder / name, **shared), killed_s, away, anew=begins)
        for name, (away, begins) in lives.items()
    )
    grown_n = float(np.abs(never - never[0]).max())
    return {
        'killed_s': killed_s, 'away_s': away_s, 'drift_n': grown_n,
        'deviation': float(np.abs(again - never).max()) / grown_n,
        'deviation_anew': float(np.abs(anew - never)[1:].max()) / grown_n,
    }  # fmt: skip


def compare_drift(arguments: argparse.Namespace, folder: Path) -> bool:
    """Kill, compare, tell; whether every deviation is within LIMIT."""
    rng, measured = np.random.default_rng(arguments.seed), []
    with surroundings() as context:
        for number in range(arguments.kills):
            killed_s, away_s = int(rng.integers(*KILLED_S)), int(rng.integers(1, AWAY_S + 1))
            figures = kill_once(
                number, killed_s, away_s, folder, models=folder / 'models', context=context
            )
            measured.append(figures)
            print(json.dumps({k: round(v, 5) for k, v in measured[-1].items()}), flush=True)
    for what, key in (('restarted', 'deviation'), ('begun anew', 'deviation_anew')):
        percent = [100 * figures[key] for figures in measured]
        print(f'{what}: off by {np.median(percent):.3f} % (median), {max(percent):.3f} % at most')
    keep('restart.json', measured)
    return max(figures['deviation'] for figures in measured) <= LIMIT
