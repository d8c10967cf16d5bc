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

from wrist_ft_comp.calibration.result import FoldErrors, HARMFUL_RATIO, SURE_SHARE
from wrist_ft_comp.model.ranges import rounded

Level = Literal['good', 'weak', 'harmful', 'uncalibrated']
#: For people, the best first.
LEVEL_NAMES: dict[Level, str] = {
    'good': 'good', 'weak': 'weak', 'harmful': 'harmful', 'uncalibrated': 'not calibrated',
}  # fmt: skip
#: Largest share of the drift that a good axis leaves.
GOOD_REMAINDER = 0.25
#: What is no larger than this many times the noise counts as noise.
NOISE_MARGIN = 1.5


@dataclass(frozen=True)
class Evidence:
    """What is known about one axis."""

    #: N, N m, or what the recordings are in; so are all errors.
    unit: str
    #: Root mean square error without and with compensation.
    before: float
    after: float
    #: Standard deviation of what no model of temperature can explain; 0 if unknown.
    noise: float
    #: Whether there is a model for the axis.
    compensated: bool
    #: Smallest error among the candidates that were refused.
    best_candidate: float | None = None
    #: The errors block by block, and what a block is.
    blocks: FoldErrors | None = None
    block_name: str = 'held-out block'
    #: How many recordings a calibration rests on; 0 if it is not one.
    recordings: int = 0
    #: Slowest time constant, and longest recording; 0 if unknown.
    slowest_s: float = 0.0
    longest_s: float = 0.0
    #: Why an axis that drifts was not learnt, without a full stop; empty when it was.
    refusal: str = ''


@dataclass(frozen=True)
class Verdict:
    """A level of the module's table, and a sentence that says why, with numbers."""

    level: Level
    sentence: str


def judge(evidence: Evidence) -> Verdict:
    """Judge one axis by what is known of it."""
    before, after = evidence.before, evidence.after
    if not evidence.compensated:
        return Verdict('uncalibrated', _why_uncalibrated(evidence))
    figures = f'{rounded(before)} → {rounded(after)} {evidence.unit} RMS'
    if after > HARMFUL_RATIO * before:
        return Verdict(
            'harmful',
            f'The model leaves more drift than no compensation would: {figures}'
            f'{_rests_on(evidence, harmful=True)}.',
        )
    share = rounded(100 * after / before, 2) if before > 0 else '0'
    remainder = f'{share} % of the drift is left ({figures}){_rests_on(evidence)}'
    is_noise = after <= NOISE_MARGIN * evidence.noise
    doubts = _doubts(evidence)
    if not is_noise and after > GOOD_REMAINDER * before:
        doubts.insert(0, f'a good axis leaves at most {100 * GOOD_REMAINDER:g} %')
    if doubts:
        return Verdict('weak', f'{remainder}; {"; ".join(doubts)}.')
    noise = ', no more than the noise of the sensor' if is_noise else ''
    return Verdict('good', f'{remainder}{noise}.')


def _rests_on(evidence: Evidence, *, harmful: bool = False) -> str:
    """Say when it was too few recordings to know how they differ; and on what one is condemned."""
    if evidence.recordings in {1, 2}:
        few = 'judged on parts of a single recording', 'which rests on two recordings'
        return f', {few[evidence.recordings - 1]}'
    count = len(evidence.blocks[0]) if harmful and evidence.blocks is not None else 0
    return f', in {count} {evidence.block_name}{"s" * (count > 1)}' if count else ''


def _why_uncalibrated(evidence: Evidence) -> str:
    """Say why an axis is passed through."""
    drift = f'{evidence.before:.3g} {evidence.unit} RMS'
    if evidence.refusal:
        return f'{evidence.refusal}. It is passed through, with a drift of {drift}.'
    if evidence.before <= NOISE_MARGIN * evidence.noise:
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


def _doubts(evidence: Evidence) -> list[str]:
    """List what speaks against trusting the figures."""
    doubts = []
    if evidence.blocks is not None:
        before, after = evidence.blocks
        worse = (after > HARMFUL_RATIO * before) & (after > NOISE_MARGIN * evidence.noise)
        if worse.any():
            doubts.append(
                f'in {np.count_nonzero(worse)} of {len(worse)} {evidence.block_name}s it leaves '
                'more than no compensation'
            )
    if evidence.slowest_s > SURE_SHARE * evidence.longest_s > 0:
        doubts.append(
            f'its slowest time constant, {evidence.slowest_s:.0f} s, is not sure after '
            f'{evidence.longest_s:.0f} s of recording'
        )
    return doubts
