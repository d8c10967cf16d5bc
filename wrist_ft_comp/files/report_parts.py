"""What the views of a calibration and of an evaluation have in common."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wrist_ft_comp.core.axis_model import AxisModel
from wrist_ft_comp.core.recording import FloatArray, NANOSECONDS, Recording
from wrist_ft_comp.files.model_file import StoredModel
from wrist_ft_comp.files.report_view import Source, ThermometerSeries


def drifts_removed(model: AxisModel | None) -> str:
    """Say which drifts an axis' model removes."""
    if model is None:
        return 'none'
    return 'zero and gain' if len(model.dynamics.output_mean) == 2 else 'zero'


def recording_starts_h(recordings: Sequence[Recording]) -> FloatArray:
    """
    Put recordings one after the other.

    Parameters
    ----------
    recordings : sequence of Recording
        In order.

    Returns
    -------
    ndarray, shape (recordings,)
        Where each begins, h.

    """
    ends_h = np.cumsum([recording.duration_s / 3600 for recording in recordings])
    return np.concatenate(([0.0], ends_h[:-1]))


def thermometer_series(recordings: Sequence[Recording]) -> tuple[ThermometerSeries, ...]:
    """
    Lay temperatures out over time.

    Parameters
    ----------
    recordings : sequence of Recording
        With the same thermometers.

    Returns
    -------
    tuple of ThermometerSeries
        One per thermometer.

    """
    starts = recording_starts_h(recordings)
    hours = np.concatenate(
        [start + each.elapsed_s / 3600 for start, each in zip(starts, recordings, strict=True)]
    )
    part = np.concatenate([np.full(len(each), i) for i, each in enumerate(recordings)])
    columns = np.concatenate([each.temperature_c for each in recordings]).T
    return tuple(
        ThermometerSeries(f'thermometer {j + 1}', hours, column, part)
        for j, column in enumerate(columns)
    )


def model_sources(stored: StoredModel) -> tuple[Source, ...]:
    """
    List what a model was made from; people may have edited its provenance.

    Parameters
    ----------
    stored : StoredModel
        The model.

    Returns
    -------
    tuple of Source
        Without lengths, which a model file does not hold.

    """
    recordings = stored.document['provenance'].get('recordings')
    if not isinstance(recordings, list):
        return ()
    return tuple(
        Source(str(each.get('path', '?')), float('nan'), str(each.get('sha256', '')))
        for each in recordings
        if isinstance(each, dict)
    )


def model_provenance(stored: StoredModel) -> dict[str, str]:
    """
    Say where a model came from, for people.

    Parameters
    ----------
    stored : StoredModel
        The model.

    Returns
    -------
    dict of str to str
        By what it says.

    """
    provenance = stored.document['provenance']
    ranges = (each['range_c'] for each in stored.document['thermometers'])
    return {
        'model file': str(stored.path),
        'SHA-256': stored.sha256,
        'made': str(provenance.get('created', 'at an unknown time')),
        'recorded': f'{stored.document["duration_s"] / 3600:.2f} h',
        'temperatures': ', '.join(f'{low:.1f} to {high:.1f} °C' for low, high in ranges),
        'thermal period': f'{stored.model.period_ns / NANOSECONDS:g} s',
        'versions': _listed(provenance.get('versions')),
        'settings': _listed(provenance.get('settings')),
    }


def _listed(values: Any) -> str:
    """Write nested plain values on one line."""
    if isinstance(values, Mapping):
        return ', '.join(
            f'{key} ({_listed(value)})'
            if isinstance(value, Mapping)
            else f'{key} {_listed(value)}'
            for key, value in values.items()
        )
    if isinstance(values, list):
        return ' '.join(_listed(value) for value in values) or 'none'
    return 'none' if values is None else str(values)
