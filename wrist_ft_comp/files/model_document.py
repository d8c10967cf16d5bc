"""A model as plain values, and back: what model files hold."""

from typing import Any

import numpy as np

from wrist_ft_comp import ModelFileError
from wrist_ft_comp.core.arx import Arx
from wrist_ft_comp.core.arx_pls import ArxPls
from wrist_ft_comp.core.drift import AxisModel, DriftModel
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
        'rms_before': fit.rms_before,
        'rms_after': fit.rms_after,
        'time_constants_s': list(fit.time_constants_s),
        'notes': list(fit.notes),
        'candidates': [{'name': c.name, 'rms': c.rms} for c in fit.candidates],
        'model': None if fit.model is None else _model_document(fit.model),
    }


def _model_document(model: AxisModel) -> Document:
    """Turn what runs into plain values."""
    features, dynamics = model.features, model.dynamics
    return {
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
            'latents': [
                {'a': arx.a.tolist(), 'b': arx.b.tolist(), 'first_lag': arx.first_lag}
                for arx in dynamics.latents
            ],
            'output_loadings': dynamics.output_loadings.tolist(),
            'output_weight': dynamics.output_weight.tolist(),
            'output_mean': dynamics.output_mean.tolist(),
        },
    }


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
    )


def _build_axis(entry: Document, thermometers: int) -> AxisModel:
    """Build one axis from a checked document."""
    features, dynamics = entry['features'], entry['dynamics']
    inputs, latents = len(dynamics['input_mean']), len(dynamics['latents'])
    outputs = len(dynamics['output_mean'])
    per_thermometer = {
        key: _array(key, features[key], (thermometers,))
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
            latents=tuple(
                Arx(
                    _array('a', latent['a'], (len(latent['a']),)),
                    _array('b', latent['b'], (len(latent['b']),)),
                    latent['first_lag'],
                )
                for latent in dynamics['latents']
            ),
            output_loadings=_array(
                'output_loadings', dynamics['output_loadings'], (outputs, latents)
            ),
            output_weight=_array('output_weight', dynamics['output_weight'], (outputs,)),
            output_mean=_array('output_mean', dynamics['output_mean'], (outputs,)),
        ),
    )
