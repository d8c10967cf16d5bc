"""A job, and its form as a line of JSON between two processes."""

from collections.abc import Sequence
from dataclasses import dataclass, field
import json
from pathlib import Path

from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.stored.model_store import HistoryEntry
from wrist_ft_comp.stored.own_file import from_plain, parse_json, to_plain


@dataclass(frozen=True)
class Learning:
    """Settings of a job that a node starts by itself; its recordings are days."""

    #: Models that were live, the live one last. Days before a person's last decision are no
    #: evidence for a change any more.
    history: tuple[HistoryEntry, ...] = ()
    #: How large recordings of days may be together, MB.
    max_mb: float = 500.0


@dataclass(frozen=True)
class Minute:
    """A minute of motion, in which a job finds the payload; the job's output is payloads.json."""

    #: Means over cells, as payload/minute_of_motion.py takes them.
    cells: Sequence[tuple[float, ...]]
    #: Length of a cell, s.
    period_s: float
    #: Names of payloads that are in use elsewhere.
    taken: tuple[str, ...] = ()
    #: Bias and scale of the accelerometer where a calibration has found them.
    sensor: tuple[Sequence[float], Sequence[float]] | None = None


@dataclass(frozen=True)
class CalibrationJob:
    """What to calibrate from, how, and where the model goes."""

    #: Bags or CSV files.
    recordings: tuple[Path, ...]
    #: Model file to make or replace.
    output: Path
    settings: CalibrationSettings = field(default_factory=CalibrationSettings)
    #: Thermal period h, s.
    period_s: float = 1.0
    #: Topic names in bags.
    topics: Topics = field(default_factory=Topics)
    #: Leave out, with a warning, recordings that cannot be read, have other thermometers than
    #: topics names, or lack the reference; as long as one is left.
    skip_unusable: bool = False
    #: Where a report goes, if one is wanted.
    report: Path | None = None
    #: For a node that learns by itself: recordings are all days that have ended, oldest first.
    learning: Learning | None = None
    #: For ~/identify_payload: there are no recordings then.
    minute: Minute | None = None


def encode_job(job: CalibrationJob) -> str:
    """Write a job as JSON."""
    return json.dumps(to_plain(job), default=str)


def decode_job(text: str) -> CalibrationJob:
    """Read a job that encode_job wrote."""
    job: CalibrationJob = from_plain(CalibrationJob, parse_json(text))
    return job
