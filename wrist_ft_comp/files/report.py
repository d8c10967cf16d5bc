"""The report: one self-contained page that shows what a model does to recordings."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np

from wrist_ft_comp import RecordingError
from wrist_ft_comp.core.evaluation import tared_errors
from wrist_ft_comp.core.problem import Reference
from wrist_ft_comp.core.recording import AXES, Recording, axis_unit, temperature_channel
from wrist_ft_comp.files.atomic import replaced_on_success
from wrist_ft_comp.files.model_file import StoredModel
from wrist_ft_comp.files.pictures import DriftSeries, TemperatureSeries, draw_drift, svg_text

_TARE_S = 60.0
_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem;
  color: #1a1a1a; background: #fff; }
table { border-collapse: collapse; display: block; overflow-x: auto; }
th, td { text-align: right; padding: .2rem .8rem; border-bottom: 1px solid #ddd; }
th:first-child, td:first-child { text-align: left; }
svg { width: 100%; height: auto; }
"""


def write_report(
    path: Path, stored: StoredModel, recordings: Sequence[Recording], reference: Reference
) -> None:
    """
    Write the page; an existing one is replaced in one step.

    Parameters
    ----------
    path : Path
        Target.
    stored : StoredModel
        The model.
    recordings : sequence of Recording
        On the model's grid; each becomes a picture.
    reference : {'unloaded', 'constant', 'recorded'}
        What the true wrench was.

    Raises
    ------
    RecordingError
        When the page cannot be written.

    """
    pictures = ''.join(_picture(stored, recording, reference) for recording in recordings)
    page = (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f'<title>{escape(stored.path.name)}</title><style>{_STYLE}</style></head><body>'
        f'<h1>{escape(stored.path.name)}</h1>{_axes_table(stored)}{pictures}'
        f'<p>Model sha256 {stored.sha256}</p></body></html>'
    )
    try:
        with replaced_on_success(path) as neighbour:
            neighbour.write_text(page, encoding='utf-8')
    except OSError as error:
        raise RecordingError(f'{path} cannot be written: {error.strerror}.') from error


def _axes_table(stored: StoredModel) -> str:
    """Held-out errors before and after, and what was chosen."""
    rows = ''.join(
        f'<tr><td>{axis}</td><td>{entry["rms_before"]:.4g}</td><td>{entry["rms_after"]:.4g}</td>'
        f'<td>{axis_unit(axis)}</td><td>{escape(entry["chosen"])}</td></tr>'
        for axis, entry in stored.document['axes'].items()
    )
    warnings = ''.join(f'<li>{escape(text)}</li>' for text in stored.document['warnings'])
    return (
        '<h2>Held-out error, root mean square</h2><table><tr><th>axis</th><th>before</th>'
        f'<th>after</th><th>unit</th><th>chosen</th></tr>{rows}</table><ul>{warnings}</ul>'
    )


def _picture(stored: StoredModel, recording: Recording, reference: Reference) -> str:
    """Draw one recording."""
    before, after = tared_errors(stored.model, recording, reference, _TARE_S)
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
    picture = svg_text(draw_drift(series, temperatures))
    return f'<h2>{escape(recording.name)}</h2>{picture}'
