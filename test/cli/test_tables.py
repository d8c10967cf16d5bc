from hypothesis import given
from hypothesis import strategies as st
import pytest

from wrist_ft_comp.cli.tables import table_text, verdict_text, verdicts_json
from wrist_ft_comp.report.verdict import Verdict

word = st.text(st.characters(categories=['Ll', 'Nd'], max_codepoint=127), min_size=1, max_size=60)


@given(st.lists(st.lists(word, min_size=4, max_size=4), min_size=1, max_size=6))
def test_every_table_fits_and_loses_nothing(rows):
    text = table_text(rows[0], rows[1:])
    assert max(map(len, text.splitlines())) <= 80
    assert sorted(''.join(text.split())) == sorted(''.join(''.join(row) for row in rows))


def test_a_narrow_table_has_a_line_per_row():
    text = table_text(['axis', 'N'], [['force_z', '1'], ['torque_x', '23']])
    assert text == 'axis       N\nforce_z    1\ntorque_x  23'


def test_a_long_list_is_broken_between_its_words():
    taus = ', '.join(f'{tau}' for tau in range(1000, 1015))
    lines = table_text(['axis', 'time constants'], [['force_z', taus]]).splitlines()
    assert len(lines) == 3
    assert all(part.isdigit() for part in ' '.join(lines[1:]).replace(',', '').split()[1:])


@pytest.mark.parametrize('level', ['good', 'weak', 'harmful', 'uncalibrated'])
def test_verdicts_fit_the_screen(level):
    text = verdict_text({'force_z': Verdict(level, 'Many words make a long sentence. ' * 5)})
    assert max(map(len, text.splitlines())) <= 80
    assert text.startswith('force_z: ')


def test_verdicts_are_plain_values_for_scripts():
    plain = verdicts_json({'force_z': Verdict('good', 'Why.')})
    assert plain == {'force_z': {'level': 'good', 'why': 'Why.'}}
