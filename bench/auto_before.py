"""
Answer for version 0.1.0, which has to be first on PYTHONPATH.

``python bench/auto_before.py QUESTION ANSWER``: both are npz files as world_autos makes and reads
them.
"""

import os
from pathlib import Path
import sys

import numpy as np
from wrist_ft_comp.core.calibration import calibrate, CalibrationSettings
from wrist_ft_comp.core.evaluation import simulate_drift
from wrist_ft_comp.core.recording import AXES, Recording

import wrist_ft_comp


def main() -> None:
    """Calibrate on all recordings but the last, predict the last one's drift."""
    question, answer = map(Path, sys.argv[1:])
    if not Path(wrist_ft_comp.__file__).is_relative_to(os.environ['PYTHONPATH']):
        raise SystemExit(f'{wrist_ft_comp.__file__} is not version 0.1.0.')
    with np.load(question) as file:
        recordings = [
            Recording(
                f'day {number}',
                int(file['period_ns']),
                0,
                file[f'temperature_c_{number}'],
                np.ones(file[f'temperature_c_{number}'].shape, dtype=bool),
                file[f'wrench_{number}'],
                file[f'reference_{number}'],
            )
            for number in range(int(file['count']))
        ]
        settings = CalibrationSettings(reference=str(file['kind']))
    *learn, judge = recordings
    drift: np.ndarray = np.zeros_like(judge.wrench)
    claim: np.ndarray = np.full(len(AXES), np.nan)
    try:
        calibration = calibrate(learn, settings)
        parts = simulate_drift(calibration.model, judge)
        drift = parts.zero + np.where(
            parts.sensitivity == 0, 0, parts.sensitivity * judge.reference
        )
        claim = np.array(
            [calibration.fits[a].rms_after if a in calibration.fits else np.nan for a in AXES]
        )
    except wrist_ft_comp.WristFtCompError as error:
        print(error)
    np.savez(answer, drift=drift, claim=claim)


if __name__ == '__main__':
    main()
