"""What is printed: tables of at most 80 columns, bars on a terminal only, colours where wanted."""

from contextlib import redirect_stdout
from io import StringIO
import re

from hypothesis import given
from hypothesis import strategies as st
import pytest

from wrist_ft_comp.cli.terminal import filled, print_words, table

word = st.text(st.characters(categories=['Ll', 'Nd'], max_codepoint=127), min_size=1, max_size=18)
cell = st.lists(word, min_size=1, max_size=6).map(' '.join)


def drawn(*parts):
    with redirect_stdout(StringIO()) as out:
        print_words([table(*parts)])
    return out.getvalue()


@given(st.lists(st.lists(cell, min_size=4, max_size=4), min_size=1, max_size=6))
def test_every_table_fits_and_loses_nothing(rows):
    text = drawn(rows[0], rows[1:] or [rows[0]])
    assert max(map(len, text.splitlines())) <= 80
    every = [*rows, *([] if rows[1:] else [rows[0]])]
    letters = ''.join(''.join(row) for row in every)
    assert sorted(''.join(text.split())) == sorted(''.join(letters.split()))


def test_a_table_that_fits_with_less_space_has_no_second_line():
    row = ['torque_z', 'N m', 'not calibrated', *['0.0000737'] * 3, '–', 'x' * 12]
    assert len(drawn(['x'] * 8, [row]).splitlines()) == 2


@pytest.mark.parametrize(('variable', 'coloured'), [('FORCE_COLOR', True), ('NO_COLOR', False)])
def test_colours_are_those_that_the_environment_asks_for(variable, coloured, monkeypatch, capsys):
    for name in ('FORCE_COLOR', 'NO_COLOR'):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(variable, '1')
    print_words(['ERROR   input', table(['axis', 'verdict'], [['force_x', 'good']])])
    out = capsys.readouterr().out
    assert (re.search('\x1b\\[[^m]*3[12]', out) is not None) == coloured
    assert 'good' in out


def test_what_can_be_copied_is_never_broken(capsys):
    assert filled(f'{"word " * 14}x --ros-args').endswith('\n--ros-args')
    command = 'wrist_ft_comp calibrate ' + 'x' * 100
    print_words([command, table(['topic', 'N'], [['/' + 'y' * 90, '1']])])
    out = capsys.readouterr().out
    assert command in out
    assert '/' + 'y' * 90 in out
