import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from wrist_ft_comp.report import pictures
from wrist_ft_comp.report.view import ErrorSeries, ThermometerSeries

XLINK = '{http://www.w3.org/1999/xlink}href'
COLOURS = re.compile(r'#[0-9a-fA-F]{6}\b')


def series(points=300, parts=1):
    t = np.linspace(0, 3, points)
    part = np.arange(points) * parts // points
    return ErrorSeries(t, 20 + 5 * t, np.sin(t), 0.1 * np.cos(9 * t), part)


def thermometers(count):
    t = np.linspace(0, 3, 50)
    return tuple(
        ThermometerSeries(f'thermometer {j}', t, 20 + j + t, np.zeros(50, dtype=int))
        for j in range(count)
    )


def drawn():
    return pictures.errors_over_time(series(), 'N')


def xml(text):
    return ET.fromstring(text)  # noqa: S314 -- our own text


def test_a_line_keeps_its_peaks_when_it_is_thinned_out():
    x = np.arange(100_000.0)
    y = np.random.default_rng(1).normal(0, 1, len(x))
    y[[777, 55_555]] = 50.0, -50.0
    kept_x, kept_y = pictures.thin_out(x, y, 240)
    assert len(kept_x) <= 480
    assert (np.diff(kept_x) > 0).all()
    assert {50.0, -50.0} <= set(kept_y.tolist())
    np.testing.assert_array_equal(y[kept_x.astype(int)], kept_y)


def test_a_short_line_stays_as_it_is():
    x, y = np.arange(480.0), np.arange(480.0)[::-1]
    kept_x, kept_y = pictures.thin_out(x, y, 240)
    np.testing.assert_array_equal(kept_x, x)
    np.testing.assert_array_equal(kept_y, y)


def test_lines_break_between_parts_and_at_gaps():
    whole = pictures.errors_over_time(series(), 'N').axes[0].lines[0].get_xdata()
    parted = pictures.errors_over_time(series(parts=3), 'N').axes[0].lines
    assert np.isnan(whole).sum() == 1
    data = max((line.get_xdata() for line in parted), key=len)
    assert np.isnan(data).sum() == 3
    one = series()
    gap = ErrorSeries(
        one.hours + (one.hours > 1) * 2, one.temperature_c, one.before, one.after, one.part
    )
    assert np.isnan(pictures.errors_over_time(gap, 'N').axes[0].lines[0].get_xdata()).sum() == 2


def test_both_lines_differ_without_colour():
    before, after = pictures.errors_over_time(series(), 'N').axes[0].lines
    assert before.get_linestyle() != after.get_linestyle()
    before, after = pictures.errors_over_temperature(series(), 'N').axes[0].lines
    assert before.get_marker() != after.get_marker()
    first, second = pictures.temperatures_over_time(thermometers(2)).axes[0].lines
    assert first.get_linestyle() != second.get_linestyle()


def test_axes_have_units():
    panel = pictures.errors_over_time(series(), 'N m').axes[0]
    assert (panel.get_xlabel(), panel.get_ylabel()) == ('time, h', 'error, N m')
    panel = pictures.errors_over_temperature(series(), 'N').axes[0]
    assert panel.get_xlabel() == 'temperature, °C'


@pytest.mark.parametrize('points', [1, 2, 3])
def test_a_handful_of_points_is_drawn(points):
    few = series(points)
    for figure in (
        pictures.errors_over_time(few, 'N'),
        pictures.errors_over_temperature(few, 'N'),
    ):
        assert '<svg' in pictures.svg_text(figure, 'p', 'few')


def test_more_thermometers_than_styles_are_all_drawn():
    assert len(pictures.temperatures_over_time(thermometers(9)).axes[0].lines) == 9


def test_every_colour_is_the_page_s():
    text = pictures.svg_text(drawn(), 'p0', 'x')
    found = set(COLOURS.findall(text))
    assert not found
    assert {'var(--ink)', 'var(--with)', 'var(--without)', 'var(--grid)'} <= set(
        re.findall(r'var\(--[a-z]+\)', text)
    )


def test_text_stays_text_in_the_page_s_font():
    root = xml(pictures.svg_text(drawn(), 'p0', 'x'))
    words = [node.text for node in root.iter('{http://www.w3.org/2000/svg}text')]
    assert {'time, h', 'error, N', 'with'} <= set(words)
    assert 'DejaVu' not in pictures.svg_text(drawn(), 'p0', 'x')


def test_references_end_inside_the_picture():
    root = xml(pictures.svg_text(drawn(), 'p0', 'x'))
    ids = [node.get('id') for node in root.iter() if node.get('id')]
    assert ids
    assert len(set(ids)) == len(ids)
    targets = [node.get(XLINK)[1:] for node in root.iter() if node.get(XLINK)]
    clips = [node.get('clip-path')[5:-1] for node in root.iter() if node.get('clip-path')]
    assert targets
    assert clips
    assert {*targets, *clips} <= set(ids)


def test_two_pictures_share_no_id():
    roots = [xml(pictures.svg_text(drawn(), name, 'x')) for name in ('p0', 'p1')]
    one, other = ({n.get('id') for n in root.iter() if n.get('id')} for root in roots)
    assert one
    assert not one & other


def test_the_same_picture_is_the_same_text():
    assert pictures.svg_text(drawn(), 'p0', 'x') == pictures.svg_text(drawn(), 'p0', 'x')


def test_a_description_is_text():
    root = xml(pictures.svg_text(drawn(), 'p0', '<b> & "x"'))
    assert root.get('aria-label') == '<b> & "x"'
