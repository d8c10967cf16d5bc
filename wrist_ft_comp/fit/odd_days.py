"""Days that do not go with the others: of exchanged thermometers, or of another unit."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.fit.folds import assign_folds
from wrist_ft_comp.fit.result import AxisFit
from wrist_ft_comp.fit.thermometer_prediction import predict_each_other
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.stream.drift_of_recordings import exchange_doubts

#: Of newtons: millinewtons, kilonewtons, pounds, kilograms and back; and all of them turned round.
_UNITS = 1e-3, 0.102, 0.2248, 4.448, 9.807, 1e3
_FACTORS = np.array([*_UNITS, -1.0, *(-factor for factor in _UNITS)])
_FACTOR_TOLERANCE = 0.15
#: An odd day is looked for among up to this many, because each takes a fit without it.
_MOST_DAYS = 10


def _beside_others(
    recordings: Sequence[Recording],
) -> Iterator[tuple[Recording, list[Recording]]]:
    """Give each recording and the others, of which two can agree."""
    for i, recording in enumerate(recordings if len(recordings) > 2 else ()):
        yield recording, [*recordings[:i], *recordings[i + 1 :]]


def exchanged_days(recordings: Sequence[Recording], model: DriftModel) -> Iterator[str]:
    """Name thermometers that read what those of the other days expect of each other."""
    for recording, others in _beside_others(recordings):
        judge = replace(model, prediction=predict_each_other(others, assign_folds(others)))
        yield from (f'In {recording.name}, {said}.' for said in exchange_doubts(judge, recording))


def unlike_days(
    recordings: Sequence[Recording], learn: Callable[[Sequence[Recording]], Mapping[str, AxisFit]]
) -> Iterator[str]:
    """
    Name days that drift by the factor of another unit or direction of what the others expect.

    Another factor is none of theirs: a day that is heated otherwise has one, too.
    """
    few = recordings if len(recordings) <= _MOST_DAYS else ()
    for recording, others in _beside_others(few):
        fits: Mapping[str, AxisFit] = {}
        with suppress(WristFtCompError):
            fits = learn(others)
        for axis, fit in fits.items():
            read = recording.wrench[:, AXES.index(axis)]
            at = np.flatnonzero(np.isfinite(read))
            if fit.model is None or not len(at):
                continue
            temperature_c = recording.temperature_c
            expected = fit.model.run(fit.model.start(temperature_c[0]), temperature_c)[1][at, 0]
            slope = np.polyfit(expected, read[at], 1)[0] if np.ptp(expected) else 1.0
            if (np.abs(slope / _FACTORS - 1) < _FACTOR_TOLERANCE).any():
                yield (
                    f'{axis} of {recording.name} drifts {slope:.3g} times as much as the other '
                    'days let expect. Is it in another unit or direction? Mend that.'
                )
                break
