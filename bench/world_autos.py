"""What ``auto`` makes of a world: this tree's, and version 0.1.0's from a tree of its own."""

from dataclasses import dataclass
import hashlib
import os
import subprocess
import sys

from baseline import baseline, ROOT
import numpy as np
from worlds_drawn import World

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.signals import AXES, FloatArray
from wrist_ft_comp.stream.offline import simulate_drift

#: 0.1.0 answers the same question the same way for ever, so its answers are kept here.
ANSWERS = ROOT / 'build' / 'worlds'


@dataclass(frozen=True, eq=False)
class Answer:
    """Drift of the judged day (N, 6), and the RMS that is said to be left (6,), NaN for none."""

    drift: FloatArray
    claim: FloatArray


def auto_here(world: World) -> Answer:
    """Calibrate with this tree; a refusal leaves the sensor as it is and claims nothing."""
    drift, claim = np.zeros_like(world.judge.wrench), np.full(len(AXES), np.nan)
    settings = CalibrationSettings(reference=world.reference)
    try:
        calibration = calibrate(world.learn, settings)
    except WristFtCompError:
        return Answer(drift, claim)
    zero, gain = simulate_drift(calibration.model, world.judge)
    drift = zero + np.where(gain == 0.0, 0.0, gain * world.judge.reference)
    deviation = calibration.model.uncertainty(world.judge.temperature_c)
    return Answer(drift, np.sqrt(np.mean(deviation**2, axis=0)))


def auto_before(world: World) -> Answer:
    """Ask version 0.1.0 in a process of its own."""
    recordings = [*world.learn, world.judge]
    arrays: dict[str, FloatArray] = {}
    for number, each in enumerate(recordings):
        arrays[f'temperature_c_{number}'] = each.temperature_c
        arrays[f'wrench_{number}'] = each.wrench
        arrays[f'reference_{number}'] = each.reference
    digest = hashlib.sha256(world.reference.encode())
    for array in arrays.values():
        digest.update(array.tobytes())
    ANSWERS.mkdir(parents=True, exist_ok=True)
    answer = ANSWERS / f'{digest.hexdigest()[:20]}.npz'
    if not answer.exists():
        question, part = (answer.with_suffix(f'.{os.getpid()}.{kind}.npz') for kind in 'qa')
        np.savez(
            question,
            count=len(recordings),
            period_ns=world.judge.period_ns,
            kind=world.reference,
            **arrays,  # type: ignore[arg-type] # none of them is called allow_pickle
        )
        script = str(ROOT / 'bench' / 'auto_before.py')
        environment = {**os.environ, 'PYTHONPATH': str(baseline())}
        subprocess.run(
            [sys.executable, script, str(question), str(part)],
            env=environment,
            check=True,
            stdout=subprocess.DEVNULL,
        )
        question.unlink()
        part.replace(answer)
    with np.load(answer) as file:
        return Answer(file['drift'], file['claim'])
