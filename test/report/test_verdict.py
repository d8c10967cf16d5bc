"""The table of verdicts, at both sides of every threshold."""

import numpy as np
import pytest

from wrist_ft_comp.fit.result import FoldErrors
from wrist_ft_comp.report import verdict
from wrist_ft_comp.report.evaluation import AxisEvaluation
from wrist_ft_comp.report.verdict import HARMFUL_RATIO

JUST = 1e-9
#: Two blocks, of which the first gets worse by what may be noise.
SMALL = FoldErrors(np.array([0.01, 1.0]), np.array([0.014, 0.1]))
BEFORE = np.array([1.0, 3.0, 1.0])
WORSE = FoldErrors(BEFORE, np.array([0.1, 3.2, 0.1]))
HARDLY_WORSE = FoldErrors(BEFORE, np.array([0.1, 3.1, 0.1]))
#: A block that hardly drifts, and of which little is left.
WORSE_OF_LITTLE = FoldErrors(BEFORE, np.array([10 * verdict.GOOD_REMAINDER - JUST, 0.1, 0.1]))


def judge(before=10.0, after=1.0, peak=0.0, **known):
    whole = FoldErrors(np.array([before]), np.array([after]))
    known = {'unit': 'N', 'noise': 0.01, 'compensated': True, 'parts': whole, **known}
    errors = AxisEvaluation(before, after, np.nan, peak)
    return verdict.judge(verdict.Evidence(errors=errors, **known))


@pytest.mark.parametrize(('changes', 'expected'), [
    ({'after': 10 * verdict.GOOD_REMAINDER - JUST}, 'good'),
    ({'after': 10 * verdict.GOOD_REMAINDER + JUST}, 'weak'),
    ({'after': 10 * HARMFUL_RATIO - JUST}, 'weak'),
    ({'after': 10 * HARMFUL_RATIO + JUST}, 'harmful'),
    ({'after': 12.0, 'noise': 12.0 / verdict.NOISE_MARGIN + JUST}, 'good'),
    ({'after': 8.0, 'noise': 8.0 / verdict.NOISE_MARGIN + JUST}, 'good'),
    ({'after': 8.0, 'noise': 8.0 / verdict.NOISE_MARGIN - JUST}, 'weak'),
    ({'promised': False}, 'weak'), ({'promised': False, 'noise': 1.0}, 'weak'),
    ({'compensated': False, 'after': 10.0}, 'uncalibrated'),
    ({'moved_k': verdict.SMALLEST_CHANGE_K}, 'good'),
    ({'moved_k': verdict.SMALLEST_CHANGE_K - JUST}, 'unjudged'),
    ({'after': 8.0, 'noise': 4.0 / verdict.NOISE_MARGIN + JUST, 'widening': 2.0}, 'good'),
    ({'after': 8.0, 'noise': 4.0 / verdict.NOISE_MARGIN - JUST, 'widening': 2.0}, 'weak'),
    ({'before': 0.0, 'after': 0.0, 'noise': 0.0}, 'good'),
    ({'before': 0.05, 'after': 0.01, 'parts': SMALL, 'noise': 0.01}, 'good'),
    ({'before': 0.05, 'after': 0.01, 'parts': SMALL, 'noise': 0.009}, 'weak'),
    ({'peak': 0.5, 'limit': 0.5}, 'good'), ({'peak': 0.5 + JUST, 'limit': 0.5}, 'weak'),
    ({'peak': 0.5}, 'good'), ({'parts': WORSE}, 'weak'), ({'parts': HARDLY_WORSE}, 'good'),
    ({'parts': WORSE_OF_LITTLE}, 'good'),
])  # fmt: skip
def test_every_level_begins_where_the_table_says(changes, expected):
    assert judge(**changes).level == expected


def test_a_sentence_holds_its_numbers():
    assert judge().sentence == '10 % of the drift is left (10 → 1 N RMS).'
    assert judge(after=0.01).sentence.endswith('the noise of the sensor.')
    weak = judge(unit='N m', after=5.0)
    assert weak.sentence.startswith('50 % of the drift is left (10 → 5 N m RMS)')
    assert 'at most 25 %' in weak.sentence
    assert 'in 1 of 3 parts it leaves more' in judge(parts=WORSE).sentence


def test_an_axis_without_a_model_has_its_reason():
    bare = {'compensated': False, 'after': 10.0}
    passes = 'It passes unchanged, with its drift of 10 N RMS.'
    assert judge(**bare).sentence == f'No model was clearly better than none. {passes}'
    refused = judge(**bare, refusal='It drifts too slowly').sentence
    assert refused == f'It drifts too slowly. {passes}'
    quiet = judge(**bare, noise=10.0).sentence
    assert quiet.startswith('There is nothing to remove')
