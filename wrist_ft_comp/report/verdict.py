"""
Is an axis' compensation good? One table of thresholds, one sentence with the numbers.

| level | when |
|---|---|
| good | at most 25 % of the drift is left, or what is left is below 1.5 times the noise |
| weak | more is left; or a held-out block got worse; or the slowest time constant is above half |
| | of the longest recording, so that it can't be told from a trend |
| harmful | more is left than without compensation |
| uncalibrated | no compensation: nothing that was tried was better, or there is no drift |
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from wrist_ft_comp.calibration.result import FoldErrors

Level = Literal['good', 'weak', 'harmful', 'uncalibrated']


#: For people, the best first.
LEVEL_NAMES: dict[Level, str] = {
    'good': 'good',
    'weak': 'weak',
    'harmful': 'harmful',
    'uncalibrated': 'not calibrated',
}


@dataclass(frozen=True)
class Thresholds:
    """
    Where one level ends and the next begins; all are ratios.

    Attributes
    ----------
    good_remainder : float
        Largest share of the drift that a good axis leaves.
    noise_margin : float
        What is no larger than this many times the noise counts as noise.
    harmful : float
        Leaving more than this many times the drift is harm; less may be chance.
    long_time_constant : float
        A time constant longer than this share of the longest recording is not sure.

    """

    good_remainder: float = 0.25
    noise_margin: float = 1.5
    harmful: float = 1.05
    long_time_constant: float = 0.5


THRESHOLDS = Thresholds()


@dataclass(frozen=True)
class Evidence:
    """
    What is known about one axis.

    Attributes
    ----------
    unit : str
        N or N m.
    before, after : float
        Root mean square error without and with compensation, in the unit.
    noise : float
        Standard deviation of what no model of temperature can explain, in the unit; 0 if unknown.
    compensated : bool
        Whether there is a model for the axis.
    best_candidate : float or None
        Smallest error among the candidates that were refused, in the unit.
    blocks : FoldErrors or None
        The errors block by block.
    block_name : str
        What a block is.
    slowest_s, longest_s : float
        Slowest time constant, and longest recording, s; 0 if unknown.
    refusal : str
        Why an axis that drifts was not learnt, without a full stop; empty when it was.

    """

    unit: str
    before: float
    after: float
    noise: float
    compensated: bool
    best_candidate: float | None = None
    blocks: FoldErrors | None = None
    block_name: str = 'held-out block'
    slowest_s: float = 0.0
    longest_s: float = 0.0
    refusal: str = ''


@dataclass(frozen=True)
class Verdict:
    """
    A judgement.

    Attributes
    ----------
    level : {'good', 'weak', 'harmful', 'uncalibrated'}
        As in the module's table.
    sentence : str
        Why, with numbers.

    """

    level: Level
    sentence: str


def judge(evidence: Evidence, thresholds: Thresholds = THRESHOLDS) -> Verdict:
    """
    Judge one axis.

    Parameters
    ----------
    evidence : Evidence
        What is known.
    thresholds : Thresholds
        The table.

    Returns
    -------
    Verdict
        Level and sentence.

    """
    if not evidence.compensated:
        return Verdict('uncalibrated', _why_uncalibrated(evidence, thresholds))
    figures = f'{evidence.before:.3g} → {evidence.after:.3g} {evidence.unit} RMS'
    if evidence.after > thresholds.harmful * evidence.before:
        return Verdict(
            'harmful', f'The model leaves more drift than no compensation would: {figures}.'
        )
    left = f'{_percent(evidence)} % of the drift is left ({figures})'
    noise = _is_noise(evidence.after, evidence, thresholds)
    doubts = _doubts(evidence, thresholds)
    if not noise and evidence.after > thresholds.good_remainder * evidence.before:
        limit = f'{100 * thresholds.good_remainder:g} %'
        doubts.insert(0, f'a good axis leaves at most {limit}')
    if doubts:
        return Verdict('weak', f'{left}; {"; ".join(doubts)}.')
    return Verdict('good', f'{left}{", no more than the noise of the sensor" if noise else ""}.')


def _percent(evidence: Evidence) -> str:
    """Share of the drift that is left, in %."""
    return f'{100 * evidence.after / evidence.before:.2g}' if evidence.before > 0 else '0'


def _is_noise(error: float, evidence: Evidence, thresholds: Thresholds) -> bool:
    """Tell whether an error is no larger than noise makes it."""
    return bool(error <= thresholds.noise_margin * evidence.noise)


def _why_uncalibrated(evidence: Evidence, thresholds: Thresholds) -> str:
    """Say why an axis is passed through."""
    drift = f'{evidence.before:.3g} {evidence.unit} RMS'
    if evidence.refusal:
        return f'{evidence.refusal}. It is passed through, with a drift of {drift}.'
    if _is_noise(evidence.before, evidence, thresholds):
        return (
            f'There is nothing to remove: its drift of {drift} is no more than the noise of the '
            'sensor. It is passed through.'
        )
    if evidence.best_candidate is None:
        return f'The model does not compensate this axis; its drift is {drift}.'
    return (
        f'Nothing that was tried is clearly better than no compensation: the drift is {drift}, '
        f'the best candidate leaves {evidence.best_candidate:.3g} {evidence.unit}. It is passed '
        'through.'
    )


def _doubts(evidence: Evidence, thresholds: Thresholds) -> list[str]:
    """List what speaks against trusting the figures."""
    found = []
    blocks = evidence.blocks
    if blocks is not None:
        worse = (blocks.after > thresholds.harmful * blocks.before) & (
            blocks.after > thresholds.noise_margin * evidence.noise
        )
        count = int(np.count_nonzero(worse))
        if count:
            found.append(
                f'in {count} of {len(worse)} {evidence.block_name}s it leaves more than no '
                'compensation'
            )
    if evidence.slowest_s > thresholds.long_time_constant * evidence.longest_s > 0:
        found.append(
            f'its slowest time constant, {evidence.slowest_s:.0f} s, is not sure after '
            f'{evidence.longest_s:.0f} s of recording'
        )
    return found
