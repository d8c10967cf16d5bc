"""
Is an axis' compensation good? One table of thresholds, one sentence with the numbers.

| level | when |
|---|---|
| good | at most 25 % of the drift is left, or what is left is below 1.5 times the noise |
| weak | more is left; or a part of the data got worse and keeps 25 % of the axis' drift or more; |
| | or no limit of another day's errors can be promised; or an error is above that limit |
| harmful | more is left than without, and than the noise; here as of a part, 5 % may be chance |
| uncalibrated | no compensation: nothing that was tried was better, or there is no drift |
| unjudged | no thermometer moved by 0.5 K within a recording while the axis was read |
"""

from dataclasses import dataclass
import math
from typing import Literal

import numpy as np

from wrist_ft_comp.fit.folds import averaged_s
from wrist_ft_comp.fit.result import Calibration, FoldErrors
from wrist_ft_comp.report.evaluation import AxisEvaluation
from wrist_ft_comp.series import rounded

Level = Literal['good', 'weak', 'harmful', 'uncalibrated', 'unjudged']
#: The levels in words for people, the best first.
LEVEL_NAMES: dict[Level, str] = {
    'good': 'good', 'weak': 'weak', 'harmful': 'harmful', 'uncalibrated': 'not calibrated',
    'unjudged': 'not judged',
}  # fmt: skip
#: A model that leaves this many times what no model leaves does harm; less may be chance.
HARMFUL_RATIO = 1.05
#: Largest share of the drift that a good axis leaves.
GOOD_REMAINDER = 0.25
#: What is no larger than this many times the noise counts as noise.
NOISE_MARGIN = 1.5
#: A model predicts the same drift all the time where its thermometers move by less, K: their noise
#: and quanta are up to 0.2 K, and a calibration wants 3 K.
SMALLEST_CHANGE_K = 0.5


@dataclass(frozen=True)
class Evidence:
    """The numbers that the verdict on one axis rests on."""

    #: N or N m; so are all errors.
    unit: str
    #: Without and with compensation, the latter as they are stated.
    errors: AxisEvaluation
    #: Standard deviation of what no model of temperature can explain; 0 if unknown.
    noise: float
    #: Whether there is a model for the axis.
    compensated: bool
    #: The errors part by part: held-out blocks of a calibration, recordings of an evaluation.
    parts: FoldErrors
    #: How many times as much is stated with compensation as was measured: drift goes further in a
    #: day than in a block, and noise does not.
    widening: float = 1.0
    #: How far a thermometer moved within a recording while the axis was read, at most, K.
    moved_k: float = math.inf
    #: Whether another day stays below a limit that is smaller than the drift, as far as is known.
    promised: bool = True
    #: What the largest error with compensation stays below on 9 of 10 days; NaN if unknown.
    limit: float = math.nan
    #: Why an axis that drifts was not learnt, without a full stop; empty when it was.
    refusal: str = ''


@dataclass(frozen=True)
class Verdict:
    """A level of the module's table, and a sentence that says why, with numbers."""

    level: Level
    sentence: str


def judge(evidence: Evidence) -> Verdict:
    """Judge one axis by the table above."""
    before, after = evidence.errors.rms_before, evidence.errors.rms_after
    noise = NOISE_MARGIN * evidence.noise
    if not evidence.compensated:
        why = evidence.refusal or 'No model was clearly better than none'
        if before <= noise and not evidence.refusal:
            why = 'There is nothing to remove: the drift is no more than the noise of the sensor'
        passed = f'It passes unchanged, with its drift of {before:.3g} {evidence.unit} RMS.'
        return Verdict('uncalibrated', f'{why}. {passed}')
    if evidence.moved_k < SMALLEST_CHANGE_K:
        return Verdict(
            'unjudged',
            f'The thermometers moved by {evidence.moved_k:.2g} K only; at least '
            f'{SMALLEST_CHANGE_K:g} K are needed. Evaluate a recording of a warm-up.',
        )
    figures = f'{rounded(before)} → {rounded(after)} {evidence.unit} RMS'
    if after > max(HARMFUL_RATIO * before, noise * evidence.widening):
        return Verdict('harmful', f'The model leaves more drift than no compensation: {figures}.')
    share = rounded(100 * after / before, 2) if before > 0 else '0'
    remainder = f'{share} % of the drift is left ({figures})'
    is_noise = after <= noise * evidence.widening
    doubts = []
    if not is_noise and after > GOOD_REMAINDER * before:
        doubts.append(f'a good axis leaves at most {100 * GOOD_REMAINDER:g} %')
    part_before, part_after = evidence.parts
    # In a part that hardly drifts, more of it may be left and still be little.
    little = max(noise, GOOD_REMAINDER * before)
    worse = (part_after > HARMFUL_RATIO * part_before) & (part_after > little)
    if worse.any():
        doubts.append(
            f'in {np.count_nonzero(worse)} of {len(worse)} parts it leaves more than no '
            'compensation'
        )
    if not evidence.promised:
        doubts.append('the limit for another day is not known, so record one more day')
    if evidence.errors.max_after > evidence.limit:
        peak, limit = rounded(evidence.errors.max_after), rounded(evidence.limit)
        doubts.append(f'its largest error, {peak} {evidence.unit}, is above the limit of {limit}')
    if doubts:
        return Verdict('weak', f'{remainder}; {"; ".join(doubts)}.')
    if is_noise:
        remainder += '; as measured, no more than the noise of the sensor'
    return Verdict('good', f'{remainder}.')


def conditions_of_another_day(calibration: Calibration) -> str:
    """Say under which conditions the limits of another day hold; nothing of a chamber test."""
    if all(np.isnan(fit.largest_drift) for fit in calibration.fits.values()):
        return ''
    low_c, high_c = max(calibration.temperature_range_c.tolist(), key=np.ptp)
    return (
        f'limit: largest error on 9 of 10 other days, tared, between {low_c:.0f} and '
        f'{high_c:.0f} °C, in means over {averaged_s(calibration.model):g} s.'
    )
