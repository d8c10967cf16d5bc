"""How many lines there are: what is not needed is not kept."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
#: Most lines of Python. The numbers only go down; where one has to go up, a comment beside it says
#: what a user gets for it.
MOST = {
    'wrist_ft_comp': 22_880,
    # Forty more: of starts, thermometers and sensors whose force was wrong while all was OK.
    'test': 19_545,
    # Sixty more: `worlds.py --before` had compared this version with itself, and `truth.py` has
    # sensors that were off, axes that hang, and hours that a model remembers.
    'bench': 5_265,
}


@pytest.mark.parametrize('folder', MOST)
def test_there_are_no_more_lines_than_there_were(folder):
    lines = sum(
        len(path.read_text('utf-8').splitlines()) for path in (ROOT / folder).rglob('*.py')
    )
    assert lines <= MOST[folder], 'what could go instead?'
    assert lines > 0.95 * MOST[folder], 'fewer than there were: lower the number'
