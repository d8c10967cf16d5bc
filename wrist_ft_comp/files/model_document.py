"""A model as plain values, and back: what model files hold."""

from typing import Any

import numpy as np

from wrist_ft_comp import ModelFileError
from wrist_ft_comp.core.arx import Arx
from wrist_ft_comp.core.arx_pls import ArxPls
from wrist_ft_comp.core.axis_model import AxisModel
from wrist_ft_comp.core.drift import DriftModel
from wrist_ft_comp.core.features import Features
from wrist_ft_comp.core.identification import AxisFit
from wrist_ft_comp.core.recording import FloatArray

Document = dict[str, Any]


def axis_document(fit: AxisFit) -> Document:
    """
    Turn one axis into plain values.

    Parameters
    ----------
    fit : AxisFit
        From a calibration.

    Returns
    -------
    dict
        As the schema's "axis".

    """
    return {
        'chosen': fit.chosen,
        'unit': fit.unit,
        'rms_before': fit.rms_before,
        'rms_after': fit.rms_after,
        'reason': fit.reason,
        'time_constants_s': list(fit.time_constants_s),
        'time_constant_errors_s': [_number(error) for error in fit.time_constant_errors_s],
        'terms': [
            {
                'output': term.output,
                'time_constant_s': term.time_constant_s,
                'feature': term.feature,
                'gain': term.gain,
                'error': _number(term.error),
            }
            for term in fit.terms
        ],
        'notes': list(fit.notes),
        'candidates': [{'name': c.name, 'rms': c.rms} for c in fit.candidates],
        'model': None if fit.model is None else _model_document(fit.model),
    }


def _number(value: float) -> float | None:
    """Write an unknown number as none: JSON and schemas know no NaN."""
    return value if np.isfinite(value) else None


def _model_document(model: AxisModel) -> Document:
    """Turn what runs into plain values."""
    features, dynamics = model.features, model.dynamics
    return {
        'filters': [_arx_document(each) for each in model.filters],
        'features': {
            'kind': features.kind,
            'reference_c': features.reference_c.tolist(),
            'lower_c': features.lower_c.tolist(),
            'upper_c': features.upper_c.tolist(),
            'degree': features.degree,
            'knots_c': [knots.tolist() for knots in features.knots_c],
        },
        'dynamics': {
            'input_mean': dynamics.input_mean.tolist(),
            'input_weight': dynamics.input_weight.tolist(),
            'rotations': dynamics.rotations.tolist(),
            'latents': [_arx_document(each) for each in dynamics.latents],
            'output_loadings': dynamics.output_loadings.tolist(),
            'output_weight': dynamics.output_weight.tolist(),
            'output_mean': dynamics.output_mean.tolist(),
        },
    }


def _arx_document(arx: Arx) -> Document:
    """Turn one filter or latent into plain values."""
    return {'a': arx.a.tolist(), 'b': arx.b.tolist(), 'first_lag': arx.first_lag}


def _build_arx(entry: Document) -> Arx:
    """Build one filter or latent."""
    return Arx(
        _array('a', entry['a'], (len(entry['a']),)),
        _array('b', entry['b'], (len(entry['b']),)),
        entry['first_lag'],
    )


def _array(name: str, values: Any, shape: tuple[int, ...]) -> FloatArray:
    """Turn nested lists into a finite array of a given shape."""
    try:
        array = np.array(values, dtype=float)
    except (ValueError, OverflowError) as error:
        raise ModelFileError(f'{name} must have shape {shape}; restore the file.') from error
    if array.shape != shape:
        raise ModelFileError(
            f'{name} must have shape {shape}; got {array.shape}. Restore the file.'
        )
    if not np.isfinite(array).all():
        raise ModelFileError(f'{name} must hold finite numbers only; restore the file.')
    return array


def build_model(document: Document) -> DriftModel:
    """
    Build what runs.

    Parameters
    ----------
    document : dict
        Checked against the schema.

    Returns
    -------
    DriftModel
        Able to run.

    Raises
    ------
    ModelFileError
        When the parts do not fit together, or numbers are not finite.
    SettingsError
        When the features are impossible.

    """
    thermometers = len(document['thermometers'])
    return DriftModel(
        period_ns=document['period_ns'],
        thermometers=thermometers,
        axes={
            axis: _build_axis(entry['model'], thermometers)
            for axis, entry in document['axes'].items()
            if entry['model'] is not None
        },
        deviation={axis: entry['rms_after'] for axis, entry in document['axes'].items()},
    )


def _build_axis(entry: Document, thermometers: int) -> AxisModel:
    """Build one axis from a checked document."""
    features, dynamics = entry['features'], entry['dynamics']
    inputs, latents = len(dynamics['input_mean']), len(dynamics['latents'])
    outputs = len(dynamics['output_mean'])
    filtered = thermometers * max(len(entry['filters']), 1)
    per_thermometer = {
        key: _array(key, features[key], (filtered,))
        for key in ('reference_c', 'lower_c', 'upper_c')
    }
    return AxisModel(
        Features(
            kind=features['kind'],
            degree=features['degree'],
            knots_c=tuple(_array('knots_c', k, (len(k),)) for k in features['knots_c']),
            **per_thermometer,
        ),
        ArxPls(
            input_mean=_array('input_mean', dynamics['input_mean'], (inputs,)),
            input_weight=_array('input_weight', dynamics['input_weight'], (inputs,)),
            rotations=_array('rotations', dynamics['rotations'], (inputs, latents)),
            latents=tuple(_build_arx(latent) for latent in dynamics['latents']),
            output_loadings=_array(
                'output_loadings', dynamics['output_loadings'], (outputs, latents)
            ),
            output_weight=_array('output_weight', dynamics['output_weight'], (outputs,)),
            output_mean=_array('output_mean', dynamics['output_mean'], (outputs,)),
        ),
        tuple(_build_arx(each) for each in entry['filters']),
    )
