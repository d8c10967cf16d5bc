"""The drift of a whole recording at once, offline, and the correction of its wrenches."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from wrist_ft_comp.channels import temperature_channel
from wrist_ft_comp.drift.drift_model import correct, Drift, DriftModel, run_from_rest
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import BoolArray, FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.stream import exchanged_thermometers, failed_thermometers
from wrist_ft_comp.stream.failed_thermometers import ThermometerState
from wrist_ft_comp.stream.gaps_and_restarts import longest_gap_s, reporting_cells

#: Ends of a recording's cells, and of the one after the last, ns, (N + 1,), and the drift at them,
#: (N + 1, 6); it is linear between them.
DriftTrack = tuple[IntArray, Drift]


def simulate_drift(
    model: DriftModel, recording: Recording, before: Recording | None = None
) -> Drift:
    """
    Run the model freely over a recording, from rest and over gaps (``gaps_and_restarts``): (N, 6).

    It starts from rest in the recording ``before``, of the same thermometers and period, where
    this one goes on with that.
    RecordingError when thermometers or thermal period differ, ModelFileError when the unit does.
    """
    if recording.thermometers != model.thermometers:
        absent = temperature_channel(recording.thermometers)
        empty = [f' {warning}' for warning in recording.warnings if warning.startswith(absent)]
        raise RecordingError(
            f'{recording.name} has {recording.thermometers} thermometers, the model expects '
            f'{model.thermometers}.{"".join(empty)} Name the topics, or keep the columns, that it '
            'was calibrated with.'
        )
    if recording.period_ns != model.period_ns:
        raise RecordingError(
            f'{recording.name} is on thermal cells of {recording.period_s} s, the model runs on '
            f'{model.period_ns / 1e9} s. Read it with the period of the model.'
        )
    temperature_c, measured = recording.temperature_c, recording.measured
    if before is not None:
        between = max(recording.first_cell - before.first_cell - len(before), 0)
        line_c = np.linspace(before.temperature_c[-1], temperature_c[0], between + 2)[1:-1]
        temperature_c = np.concatenate((before.temperature_c, line_c, temperature_c))
        silent = np.zeros(line_c.shape, dtype=bool)
        measured = np.concatenate((before.measured, silent, measured))

    cells = reporting_cells(measured, model.period_ns)
    believed_c = [state.believed_c for state in judge(model, temperature_c, measured)]
    if believed_c:
        columns, every = np.stack(believed_c, axis=1), np.arange(len(measured))
        temperature_c = np.stack([np.interp(every, cells, column) for column in columns], axis=1)
    longest = longest_gap_s(model) * NANOSECONDS / model.period_ns
    soaked = cells[1:][np.diff(cells) - 1 > longest].tolist()
    parts = [
        run_from_rest(model, temperature_c[begin:end])[1]
        for begin, end in pairwise([0, *soaked, len(measured)])
    ]
    zero, sensitivity = map(np.concatenate, zip(*parts, strict=True))
    return Drift(zero[-len(recording) :], sensitivity[-len(recording) :])


def thermometer_doubts(model: DriftModel, recording: Recording) -> dict[str, float]:
    """Give what a node would have said of replaced thermometers, and in which share of cells."""
    said, judged = Counter[str](), 0
    for state in judge(model, recording.temperature_c, recording.measured):
        # Why it was replaced; how long it has agreed since then changes with every cell.
        said.update(replace(state, agreed_s=np.zeros_like(state.agreed_s)).sentences)
        judged += 1
    return {sentence: count / judged for sentence, count in said.items()}


def exchange_doubts(model: DriftModel, recording: Recording) -> dict[str, float]:
    """Give what a node would have said of exchanged thermometers, and how often, in shares."""
    if (prediction := model.prediction) is None:
        return {}
    every = max(round(60 / recording.period_s), 1)  # a look once a minute is enough
    time_s, readings_c = every * recording.period_s, recording.temperature_c[::every]
    heard = np.ones(recording.thermometers, dtype=bool)
    state, said = failed_thermometers.start(prediction, readings_c[0]), Counter[str]()
    known = dict[tuple[int, int], str]()
    for reading_c in readings_c:
        state = failed_thermometers.step(
            prediction, state, reading_c, heard, time_s, 0.0, model.stands_s
        )
        known = exchanged_thermometers.exchanged(prediction, state, known)
        said.update(known.values())
    return {sentence: count / len(readings_c) for sentence, count in said.items()}


def judge(
    model: DriftModel, temperature_c: FloatArray, measured: BoolArray
) -> Iterator[ThermometerState]:
    """
    Judge the thermometers of a file after every cell in which one reports.

    Takes temperatures, °C, held where they were not measured, and where they were, (N, J). Yields
    nothing where nobody predicts them, or where none reads the same for long.
    """
    prediction, period_s = model.prediction, model.period_ns / NANOSECONDS
    still_s = max(failed_thermometers.stands_s(one, period_s).max() for one in temperature_c.T)
    if prediction is None or still_s < failed_thermometers.STILL_S:
        return
    cells = reporting_cells(measured, model.period_ns)
    longest = longest_gap_s(model) * NANOSECONDS / model.period_ns
    state = failed_thermometers.start(prediction, temperature_c[cells[0]])
    last = int(cells[0]) - 1
    for cell in cells.tolist():
        reading_c, missing = temperature_c[cell], cell - last - 1
        if missing > longest:
            state, missing = failed_thermometers.start(prediction, reading_c, state), 0
        gap_s = missing * period_s
        state = failed_thermometers.step(
            prediction, state, reading_c, measured[cell], period_s, gap_s, model.stands_s
        )
        last = cell
        yield state


def track_drift(model: DriftModel, recording: Recording) -> DriftTrack:
    """Lay ``simulate_drift`` out over time as the stream does: a cell's drift comes one later."""
    cell = np.arange(len(recording) + 1)
    last = np.maximum(cell - 1, 0)
    drift = Drift(*(part[last] for part in simulate_drift(model, recording)))
    return (recording.first_cell + 1 + cell) * recording.period_ns, drift


def streamed_drift(
    model: DriftModel, recording: Recording, before: Recording | None = None
) -> Drift:
    """Give the means over cells of what the stream subtracts in them, (N, 6): see track_drift."""
    cell = np.arange(len(recording))
    earlier, last = np.maximum(cell - 2, 0), np.maximum(cell - 1, 0)
    simulated = simulate_drift(model, recording, before)
    return Drift(*((part[earlier] + part[last]) / 2 for part in simulated))


def correct_many(
    track: DriftTrack, stamps_ns: IntArray, raw: FloatArray, tare: FloatArray | float = 0.0
) -> FloatArray:
    """Correct a block of wrenches, N and N m, (n, 6), of stamps, ns, (n,), by drift and tare."""
    # Relative to the first stamp, so that nanoseconds since 1970 keep their precision as floats.
    ends_ns, drift = track
    at, knots = stamps_ns - ends_ns[0], ends_ns - ends_ns[0]
    zero, sensitivity = (
        np.stack([np.interp(at, knots, column) for column in part.T], axis=1) for part in drift
    )
    return correct(raw, Drift(zero, sensitivity), tare)
