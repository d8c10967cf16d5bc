"""Whether recordings can be calibrated from: refusals with numbers and a remedy."""

from collections.abc import Sequence

import numpy as np

from wrist_ft_comp import CalibrationRefusedError
from wrist_ft_comp.core.problem import noise_level, Reference, stretches
from wrist_ft_comp.core.recording import AXES, FloatArray, Recording

#: Fewer cells with a wrench than this cannot be divided into blocks worth holding out.
MIN_SAMPLES = 30
#: A jump between neighbouring cells counts as load when it exceeds this many times the noise …
_JUMP_TO_NOISE = 12.0
#: … and this share of the axis' whole range.
_JUMP_TO_RANGE = 0.2
#: … and this many steps of its resolution.
_JUMP_TO_RESOLUTION = 3.5
#: An axis that moves no more often than this may have been loaded and unloaded, and shows none.
_FEW_STEPS = 4


def check_alike(recordings: Sequence[Recording]) -> None:
    """
    Refuse recordings that cannot be fitted together.

    Parameters
    ----------
    recordings : sequence of Recording
        Those of one calibration.

    Raises
    ------
    CalibrationRefusedError
        When there is none, or thermometers, periods or units differ.

    """
    if not recordings:
        raise CalibrationRefusedError('A calibration needs at least one recording; got none.')
    first = recordings[0]
    for other in recordings[1:]:
        if other.thermometers != first.thermometers:
            raise CalibrationRefusedError(
                f'{first.name} has {first.thermometers} thermometers and {other.name} has '
                f'{other.thermometers}; they must be the same. Leave one recording out.'
            )
        if other.period_ns != first.period_ns:
            raise CalibrationRefusedError(
                f'{first.name} is on thermal cells of {first.period_s} s and {other.name} on '
                f'{other.period_s} s; they must be the same. Read them with one period.'
            )
        if other.unit != first.unit:
            raise CalibrationRefusedError(
                f'{first.name} and {other.name} are in different units; they must be the same. '
                'Calibrate chamber tables and other recordings apart.'
            )


def check_temperatures(recordings: Sequence[Recording], min_span_k: float) -> FloatArray:
    """
    Refuse too small a span of temperature.

    Parameters
    ----------
    recordings : sequence of Recording
        Of the same thermometers.
    min_span_k : float
        What at least one thermometer must span, K.

    Returns
    -------
    ndarray, shape (J, 2)
        Lowest and highest temperature of each thermometer, °C.

    Raises
    ------
    CalibrationRefusedError
        When no thermometer spans enough.

    """
    everything = np.concatenate([recording.temperature_c for recording in recordings])
    ranges = np.stack((everything.min(axis=0), everything.max(axis=0)), axis=1)
    span = float(np.max(ranges[:, 1] - ranges[:, 0]))
    if span < min_span_k:
        names = ', '.join(recording.name for recording in recordings)
        raise CalibrationRefusedError(
            f'Temperature in {names} spans {span:.1f} K; at least '
            f'{min_span_k:.1f} K are needed. Record a warm-up from cold.'
        )
    return ranges


def check_loads(
    recordings: Sequence[Recording], axes: Sequence[str], reference: Reference
) -> None:
    """
    Refuse a missing reference, and a load that moves although it was declared not to.

    Parameters
    ----------
    recordings : sequence of Recording
        Those of one calibration.
    axes : sequence of str
        Axes that are calibrated.
    reference : {'unloaded', 'constant', 'recorded'}
        What was declared.

    Raises
    ------
    CalibrationRefusedError
        With the axis, the recording, the time and the size of the jump.

    """
    if reference == 'recorded':
        for recording in recordings:
            if not np.isfinite(recording.reference).any():
                raise CalibrationRefusedError(
                    f'{recording.name} holds no reference wrench, but the reference was declared '
                    'recorded. Record wrench_reference beside the raw wrench, or declare the '
                    'reference unloaded or constant.'
                )
        return
    for recording in recordings:
        for axis in axes:
            raw = recording.wrench[:, AXES.index(axis)]
            at = np.flatnonzero(np.isfinite(raw))
            # A gap is no jump: drift moves on while nothing is recorded.
            joined = np.diff(stretches(np.isfinite(raw), recording.period_s)[at]) == 0
            steps = np.abs(np.diff(raw[at])) * joined
            limit = max(
                _JUMP_TO_NOISE * noise_level([raw]),
                _JUMP_TO_RANGE * _range(raw[at]),
                _JUMP_TO_RESOLUTION * _resolution(raw[at]),
            )
            if len(steps) > MIN_SAMPLES and steps.max() > limit > 0:
                cell = int(at[int(np.argmax(steps)) + 1])
                raise CalibrationRefusedError(
                    f'{axis} of {recording.name} jumps by {steps.max():.3g} '
                    f'{recording.unit_of(axis)} '
                    f'after {cell * recording.period_s:.0f} s, although the load was declared '
                    f'{reference}. Record again without contact or payload change, or '
                    'record the load as reference.'
                )


def _resolution(values: FloatArray) -> float:
    """Smallest step between neighbours, where there are more than a few; else what rounding is."""
    steps = np.abs(np.diff(values))
    rounding = 1e-12 * float(np.max(np.abs(values), initial=0.0))
    real = steps[steps > rounding]
    return float(real.min()) if len(real) > _FEW_STEPS else rounding


def _range(values: FloatArray) -> float:
    """Highest minus lowest, 0 when there is nothing."""
    return float(np.ptp(values)) if len(values) else 0.0
