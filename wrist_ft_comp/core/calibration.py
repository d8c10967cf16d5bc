"""The use case of calibration: from recordings to a model with its evidence, or a refusal."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import get_args

import numpy as np

from wrist_ft_comp import CalibrationRefusedError, SettingsError
from wrist_ft_comp.core.drift import DriftModel
from wrist_ft_comp.core.identification import AxisFit, IdentificationSettings, identify_axis
from wrist_ft_comp.core.problem import (
    Reference,
    cross_validation_blocks,
    noise_level,
    pose_problem,
    stretches,
)
from wrist_ft_comp.core.recording import AXES, BoolArray, FloatArray, Recording, axis_unit

Progress = Callable[[float], None]

#: Fewer cells with a wrench than this cannot be divided into blocks worth holding out.
MIN_SAMPLES = 30
#: A jump between neighbouring cells counts as load when it exceeds this many times the noise …
_JUMP_TO_NOISE = 12.0
#: … and this share of the axis' whole range.
_JUMP_TO_RANGE = 0.2
#: … and this many steps of its resolution.
_JUMP_TO_RESOLUTION = 3.5
#: A model that leaves this many times what no model leaves does harm; less may be chance.
_HARMFUL = 1.05
#: An axis that moves no more often than this may have been loaded and unloaded, and shows none.
_FEW_STEPS = 4


@dataclass(frozen=True)
class CalibrationSettings:
    """
    What a person chose for a calibration.

    Attributes
    ----------
    reference : {'unloaded', 'constant', 'recorded'}
        What the true wrench was: zero, an unknown constant, or recorded beside the raw one.
    min_temperature_span_k : float
        Refuse when no thermometer spans at least this much, K.
    max_gap_s : float
        Warn when temperatures are missing for longer than this, s.
    identification : IdentificationSettings
        Method and structure.

    """

    reference: Reference = 'unloaded'
    min_temperature_span_k: float = 3.0
    max_gap_s: float = 600.0
    identification: IdentificationSettings = field(default_factory=IdentificationSettings)

    def __post_init__(self) -> None:
        """Check the ranges."""
        if self.reference not in get_args(Reference):
            raise SettingsError(
                f'Unknown reference {self.reference!r}; expected one of '
                f'{", ".join(get_args(Reference))}.'
            )
        if not (np.isfinite(self.min_temperature_span_k) and self.min_temperature_span_k >= 0):
            raise SettingsError(
                'The minimum temperature span must be a number of at least 0 K; got '
                f'{self.min_temperature_span_k}.'
            )


@dataclass(frozen=True, eq=False)
class Calibration:
    """
    What a calibration found.

    Attributes
    ----------
    model : DriftModel
        Ready to run.
    fits : dict of str to AxisFit
        By axis: what was chosen and why.
    temperature_range_c : ndarray, shape (J, 2)
        Lowest and highest temperature of each thermometer, °C.
    duration_s : float
        Time covered by all recordings, s.
    warnings : tuple of str
        What a person should know, in sentences.

    """

    model: DriftModel
    fits: dict[str, AxisFit]
    temperature_range_c: FloatArray
    duration_s: float
    warnings: tuple[str, ...]


def calibrate(
    recordings: Sequence[Recording],
    settings: CalibrationSettings,
    progress: Progress | None = None,
) -> Calibration:
    """
    Learn the drift of every axis that was recorded.

    Parameters
    ----------
    recordings : sequence of Recording
        On the same thermal grid, with the same thermometers, each with its own unknown offset.
    settings : CalibrationSettings
        What a person chose.
    progress : callable, optional
        Told the share that is done, 0 to 1.

    Returns
    -------
    Calibration
        The model and its evidence.

    Raises
    ------
    CalibrationRefusedError
        When the recordings do not allow a trustworthy fit; the sentence says what to do.
    TooShortError
        When an ARX does not find enough consecutive samples.

    """
    _check_alike(recordings)
    ranges = _check_temperatures(recordings, settings)
    axes = [
        axis for axis in AXES if any(axis in recording.axes_present for recording in recordings)
    ]
    if not axes:
        names = ', '.join(recording.name for recording in recordings)
        raise CalibrationRefusedError(
            f'{names} holds no wrench on the thermal cells that have a temperature. '
            'Record wrench and temperature at the same time.'
        )
    _check_wrenches(recordings, axes, settings)
    blocks = cross_validation_blocks(recordings)
    fits: dict[str, AxisFit] = {}
    for number, axis in enumerate(axes):
        problem = pose_problem(recordings, axis, settings.reference, blocks)
        if problem.samples < MIN_SAMPLES or len(problem.block_numbers) < 2:
            raise CalibrationRefusedError(
                f'{axis} has {problem.samples} thermal cells with both wrench and reference; at '
                f'least {MIN_SAMPLES} in 2 blocks are needed. Record longer.'
            )
        fits[axis] = identify_axis(problem, settings.identification)
        if progress is not None:
            progress((number + 1) / len(axes))
    model = DriftModel(
        period_ns=recordings[0].period_ns,
        thermometers=recordings[0].thermometers,
        axes={axis: fit.model for axis, fit in fits.items() if fit.model is not None},
        deviation={axis: fit.rms_after for axis, fit in fits.items()},
    )
    duration_s = sum(recording.duration_s for recording in recordings)
    return Calibration(model, fits, ranges, duration_s, _warnings(recordings, fits, settings))


def _check_alike(recordings: Sequence[Recording]) -> None:
    """Refuse recordings that cannot be fitted together."""
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


def _check_temperatures(
    recordings: Sequence[Recording], settings: CalibrationSettings
) -> FloatArray:
    """Refuse too small a span; return lowest and highest per thermometer, shape (J, 2)."""
    everything = np.concatenate([recording.temperature_c for recording in recordings])
    ranges = np.stack((everything.min(axis=0), everything.max(axis=0)), axis=1)
    span = float(np.max(ranges[:, 1] - ranges[:, 0]))
    if span < settings.min_temperature_span_k:
        names = ', '.join(recording.name for recording in recordings)
        raise CalibrationRefusedError(
            f'Temperature in {names} spans {span:.1f} K; at least '
            f'{settings.min_temperature_span_k:.1f} K are needed. Record a warm-up from cold.'
        )
    return ranges


def _check_wrenches(
    recordings: Sequence[Recording], axes: Sequence[str], settings: CalibrationSettings
) -> None:
    """Refuse a missing reference, and a load that moves although it was declared not to."""
    if settings.reference == 'recorded':
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
                    f'{axis} of {recording.name} jumps by {steps.max():.3g} {axis_unit(axis)} '
                    f'after {cell * recording.period_s:.0f} s, although the load was declared '
                    f'{settings.reference}. Record again without contact or payload change, or '
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


def _warnings(
    recordings: Sequence[Recording], fits: dict[str, AxisFit], settings: CalibrationSettings
) -> tuple[str, ...]:
    """Collect what a person should know."""
    found = [warning for recording in recordings for warning in recording.warnings]
    for recording in recordings:
        for j in range(recording.thermometers):
            gap_s = _longest_gap(recording.measured[:, j]) * recording.period_s
            if gap_s > settings.max_gap_s:
                found.append(
                    f'Thermometer {j + 1} of {recording.name} is silent for {gap_s:.0f} s; its '
                    'last value was held.'
                )
        slowest = max(
            (tau for fit in fits.values() for tau in fit.time_constants_s[-1:]), default=0.0
        )
        if slowest > recording.duration_s / 2:
            found.append(
                f'The slowest time constant, {slowest:.0f} s, is more than half of '
                f'{recording.name} ({recording.duration_s:.0f} s); record longer to be sure of it.'
            )
    found += [
        f'{axis}: {fit.chosen} leaves more drift than no compensation; choose the method auto.'
        for axis, fit in fits.items()
        if fit.rms_after > _HARMFUL * fit.rms_before
    ]
    return tuple(found)


def _longest_gap(measured: BoolArray) -> int:
    """Longest run of False, in cells."""
    edges = np.flatnonzero(np.diff(np.concatenate(([True], measured, [True])).astype(int)))
    return int(np.max(edges[1::2] - edges[::2], initial=0))
