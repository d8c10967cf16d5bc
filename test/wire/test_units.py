"""Units of temperatures, and factors."""

import pytest

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.wire.temperature_source import split_scale, to_celsius, unit_remedy


@pytest.mark.parametrize(
    ('text', 'parts'),
    [
        ('data[3]', ('data[3]', 1.0, '')),
        ('data[3]*0.1', ('data[3]', 0.1, '')),
        ('temp:F', ('temp', 1.0, 'F')),
        ('data[3]*-1e-1:K', ('data[3]', -0.1, 'K')),
    ],
)
def test_a_name_is_followed_by_a_factor_and_a_unit(text, parts):
    assert split_scale(text) == parts


@pytest.mark.parametrize('text', ['a*', 'a*x', 'a*0', 'a*nan', 'a*inf', 'a*1e999', 'a*:K'])
def test_a_factor_is_a_number_and_not_zero(text):
    with pytest.raises(SettingsError, match=r'A factor is a number'):
        split_scale(text)


def test_a_reading_in_another_unit_gets_its_remedy():
    assert to_celsius(50.0, 'F') == pytest.approx(10.0)
    assert unit_remedy(298.15, '/t:temperature:{}'.format).endswith('name it /t:temperature:K.')
    assert unit_remedy(1e9, str) == 'Check it and its unit.'
