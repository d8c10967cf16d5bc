"""Days that do not go with the others: of exchanged thermometers, or of another sensor or unit."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.fit.folds import assign_folds
from wrist_ft_comp.fit.result import AxisFit
from wrist_ft_comp.fit.thermometer_prediction import predict_each_other
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.stream.drift_of_recordings import exchange_doubts

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
    recordings: Sequence[Recording],
    fits: Mapping[str, AxisFit],
    learn: Callable[[Sequence[Recording]], Mapping[str, AxisFit]],
) -> Iterator[str]:
    """Name each recording without which less than half as much of an axis' drift is left."""
    few = recordings if len(recordings) <= _MOST_DAYS else ()
    for recording, others in _beside_others(few):
        without: Mapping[str, AxisFit] = {}
        with suppress(WristFtCompError):
            without = learn(others)
        for axis, fit in without.items():
            if 2 * fit.share_left < fits[axis].share_left:
                share = f'{100 * fit.share_left:.0f} %'
                yield (
                    f'Without {recording.name} {share} of the drift of {axis} is '
                    'left. Is it of another sensor, unit or direction? Mend or leave it out.'
                )
                break
