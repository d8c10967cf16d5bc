"""The report: one self-contained page that shows what a model does to recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from html import escape
from pathlib import Path

import numpy as np

from wrist_ft_comp import RecordingError
from wrist_ft_comp.core.chamber_fit import ChamberFigures
from wrist_ft_comp.core.evaluation import evaluate, tared_errors
from wrist_ft_comp.core.problem import Reference
from wrist_ft_comp.core.recording import AXES, Recording, axis_unit, temperature_channel
from wrist_ft_comp.files.atomic import replaced_on_success
from wrist_ft_comp.files.model_file import StoredModel
from wrist_ft_comp.files.pictures import DriftSeries, TemperatureSeries, draw_drift, svg_text

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem;
  color: #1a1a1a; background: #fff; }
table { border-collapse: collapse; display: block; overflow-x: auto; }
th, td { text-align: right; padding: .2rem .8rem; border-bottom: 1px solid #ddd; }
th:first-child, td:first-child { text-align: left; }
svg { width: 100%; height: auto; }
"""


@dataclass(frozen=True, eq=False)
class ReportedRecording:
    """
    A recording and what to compare it with.

    Attributes
    ----------
    recording : Recording
        On the model's grid.
    reference : {'unloaded', 'constant', 'recorded'}
        What the true wrench was.
    figures : mapping of str to ChamberFigures
        Of a chamber table, by title.

    """

    recording: Recording
    reference: Reference
    figures: Mapping[str, ChamberFigures] = field(default_factory=dict)


def write_report(
    path: Path, stored: StoredModel, reported: Sequence[ReportedRecording], tare_s: float = 60.0
) -> None:
    """
    Write the page; an existing one is replaced in one step.

    Parameters
    ----------
    path : Path
        Target.
    stored : StoredModel
        The model.
    reported : sequence of ReportedRecording
        Each becomes a section with a picture.
    tare_s : float
        As for evaluate, s.

    Raises
    ------
    RecordingError
        When the page cannot be written, or a recording does not fit the model.

    """
    sections = ''.join(
        _section(stored, each, tare_s, f'p{number}') for number, each in enumerate(reported)
    )
    page = (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f'<title>{escape(stored.path.name)}</title><style>{_STYLE}</style></head><body>'
        f'<h1>{escape(stored.path.name)}</h1>{_model_section(stored)}{sections}'
        f'<p>Model sha256 {stored.sha256}</p></body></html>'
    )
    try:
        with replaced_on_success(path) as neighbour:
            # A file's name may hold bytes that are no text; they are shown as "?".
            neighbour.write_text(page, encoding='utf-8', errors='replace')
    except OSError as error:
        raise RecordingError(
            f'The report {path} cannot be written: {error.strerror}. Choose a folder that can be '
            'written to, or make room.'
        ) from error


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Write a table; its cells are escaped here."""
    lines = [
        ''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in row)
        for tag, row in (('th', header), *(('td', row) for row in rows))
    ]
    return f'<table>{"".join(f"<tr>{line}</tr>" for line in lines)}</table>'


def _list(sentences: Sequence[str]) -> str:
    """Write a list of sentences, nothing when there are none."""
    items = ''.join(f'<li>{escape(sentence)}</li>' for sentence in sentences)
    return f'<ul>{items}</ul>' if items else ''


def _model_section(stored: StoredModel) -> str:
    """Held-out errors before and after, what was chosen, among what, and what to know."""
    axes = stored.document['axes']
    evidence = _table(
        ['axis', 'before', 'after', 'unit', 'time constants, s', 'chosen'],
        [
            [
                axis,
                f'{entry["rms_before"]:.4g}',
                f'{entry["rms_after"]:.4g}',
                axis_unit(axis),
                ', '.join(f'{tau:.0f}' for tau in entry['time_constants_s']) or '-',
                entry['chosen'],
            ]
            for axis, entry in axes.items()
        ],
    )
    candidates = _table(
        ['axis', 'candidate', 'held out', 'unit'],
        [
            [axis, candidate['name'], f'{candidate["rms"]:.4g}', axis_unit(axis)]
            for axis, entry in axes.items()
            for candidate in entry['candidates']
        ],
    )
    notes = [f'{axis}: {note}' for axis, entry in axes.items() for note in entry['notes']]
    return (
        f'<h2>Held-out error of the calibration, root mean square</h2>{evidence}'
        f'{_list([*notes, *stored.document["warnings"]])}'
        f'<details><summary>All candidates</summary>{candidates}</details>'
    )


def _section(stored: StoredModel, reported: ReportedRecording, tare_s: float, name: str) -> str:
    """Show one recording: figures, what is left of the drift, the picture, the warnings."""
    recording, reference = reported.recording, reported.reference
    try:
        judged = evaluate(stored.model, recording, reference, tare_s)
    except RecordingError as error:
        return f'<h2>{escape(recording.name)}</h2><p>{escape(str(error))}</p>'
    errors = _table(
        ['axis', 'unit', 'RMS before', 'after', 'peak before', 'after'],
        [
            [axis, axis_unit(axis), *(f'{value:.4g}' for value in asdict(axis_errors).values())]
            for axis, axis_errors in judged.items()
        ],
    )
    figures = {title: asdict(values) for title, values in reported.figures.items()}
    chamber = _table(
        ['%FS, %FS/°C', *figures],
        [
            [key.replace('_', ' '), *(f'{values[key]:.4f}' for values in figures.values())]
            for key in next(iter(figures.values()), {})
        ],
    )
    return (
        f'<h2>{escape(recording.name)}</h2><p>Reference: {reference}; tared on the first '
        f'{tare_s:g} s.</p>{errors}{chamber if figures else ""}'
        f'{_picture(stored, reported, tare_s, name)}{_list(recording.warnings)}'
    )


def _picture(stored: StoredModel, reported: ReportedRecording, tare_s: float, name: str) -> str:
    """Draw one recording."""
    recording = reported.recording
    before, after = tared_errors(stored.model, recording, reported.reference, tare_s)
    series = []
    for column, axis in enumerate(AXES):
        rows = np.isfinite(before[:, column]) & np.isfinite(after[:, column])
        if rows.any():
            series.append(
                DriftSeries(
                    f'{axis}, {axis_unit(axis)}',
                    recording.elapsed_s[rows],
                    before[rows, column],
                    after[rows, column],
                )
            )
    temperatures = [
        TemperatureSeries(temperature_channel(j), recording.elapsed_s, column)
        for j, column in enumerate(recording.temperature_c.T)
    ]
    return svg_text(draw_drift(series, temperatures), name)
