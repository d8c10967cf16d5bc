"""What is kept of a day at work when its recording is gone: one entry of the diary."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.signals import FloatArray

#: Coarse temperatures: of the first thermometer, and what the others differ from it by.
Cell = tuple[int, ...]
#: Under this name stands the drift that is left without any model, and under the other what a
#: challenger left.
NONE, CHALLENGER = 'none', 'challenger'


@dataclass(frozen=True)
class DayEntry:
    """One day."""

    #: Of its file.
    name: str
    #: Stamp of its first cell, and how long its cells last together.
    first_ns: int = 0
    hours: float = 0.0
    #: Lowest and highest temperature of each thermometer, °C, and for how long it stood still, s.
    temperature_c: tuple[tuple[float, float], ...] = ()
    still_s: tuple[float, ...] = ()
    #: Coarse temperatures that it saw.
    known: frozenset[Cell] = frozenset()
    #: By the first twelve digits of a model's SHA-256, NONE or CHALLENGER: RMS of the drift that
    #: it left, tared in the first minute, in the order AXES, N and N m; NaN where an axis says
    #: nothing.
    left: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    #: Which of these was live; empty when none was.
    live: str = ''
    #: Why there is a new model, or none, in a sentence or two.
    verdict: str = ''
    #: What happened to the sensor, with size and time, and its kind (incidents.py); empty when
    #: nothing did.
    incident: str = ''
    kind: str = ''
    #: Whether a challenger was learnt.
    challenged: bool = False
    #: Processor time that the day took, s.
    seconds: float = 0.0
    #: Mass, kg, and centre of mass, m, of each payload; the rotation of the specific force's frame
    #: into the wrench's, row by row; noise of a cell, N and N m. Empty where they are not known.
    payloads: tuple[tuple[float, ...], ...] = ()
    rotation: tuple[float, ...] = ()
    noise: tuple[float, ...] = ()


def forces_left(entry: DayEntry) -> FloatArray:
    """Give RMS of a force, N, without a model, with the live one and the challenger; or NaN."""
    found = []
    for model in (NONE, entry.live, CHALLENGER):
        forces = [value for value in entry.left.get(model, ())[:3] if not np.isnan(value)]
        found.append(np.sqrt(np.mean(np.square(forces))) if forces else np.nan)
    return np.array(found)


class Decision(NamedTuple):
    """A change of the live model, or of whether there is learning: after which day, and why."""

    day: str
    sentence: str


@dataclass(frozen=True)
class Diary:
    """All days, oldest first, also those whose recordings are gone."""

    days: tuple[DayEntry, ...] = ()
    decisions: tuple[Decision, ...] = ()
    #: Why learning has stopped on its own; empty when it has not.
    paused: str = ''
