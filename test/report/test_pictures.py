"""The report's pictures, SVG in the page's colours."""

from dataclasses import replace
import re

import numpy as np
import pytest

from wrist_ft_comp.report import pictures
from wrist_ft_comp.report.report_content import ErrorSeries


def series(points=300, parts=1):
    t = np.linspace(0, 3, points)
    part = np.arange(points) * parts // points
    return ErrorSeries(t, 3600 * t, np.sin(t), 0.1 * np.cos(9 * t), part)


@pytest.fixture
def thermometers(make_recording):
    def recordings(count):
        rising = 20 + np.arange(count) + np.linspace(0, 3, 50)[:, np.newaxis]
        return [make_recording(rising, {'force_z': np.zeros(50)})]

    return recordings


def test_a_long_line_is_drawn_by_few_points_and_keeps_its_peaks():
    wave = series(20_000)
    wave.after[[777, 15_555]] = 50.0, -50.0
    text = pictures.svg_text(pictures.errors_over_time(wave, 'N'), 'p', 'long')
    assert len(text) < 100_000
    line = max(re.findall(r'<path d="([^"]*)"[^>]*stroke-width: 1.4', text), key=len)
    heights = sorted(float(y) for _, y in re.findall(r'[ML] ([\d.]+) ([\d.]+)', line))
    middle = heights[len(heights) // 2]
    assert heights[1] - heights[0] > 30 < heights[-1] - heights[-2], 'one point at each peak'
    assert heights[0] < middle < heights[-1]


def test_lines_break_between_parts_and_at_gaps():
    whole = pictures.errors_over_time(series(), 'N').axes[0].lines[0].get_xdata()
    parted = pictures.errors_over_time(series(parts=3), 'N').axes[0].lines
    assert np.isnan(whole).sum() == 0
    data = max((line.get_xdata() for line in parted), key=len)
    assert np.isnan(data).sum() == 2
    gap = replace(series(), hours=series().hours + (series().hours > 1) * 2)
    assert np.isnan(pictures.errors_over_time(gap, 'N').axes[0].lines[0].get_xdata()).sum() == 1


def test_both_lines_differ_without_colour_and_axes_have_units(thermometers):
    panel = pictures.errors_over_time(series(), 'N m').axes[0]
    assert panel.lines[0].get_linestyle() != panel.lines[1].get_linestyle()
    assert (panel.get_xlabel(), panel.get_ylabel()) == ('time, h', 'error, N m')
    first, second = pictures.temperatures_over_time(thermometers(2)).axes[0].lines
    assert first.get_linestyle() != second.get_linestyle()


@pytest.mark.parametrize('points', [1, 2, 3])
def test_a_handful_of_points_is_drawn(points):
    figure = pictures.errors_over_time(series(points), 'N')
    assert '<svg' in pictures.svg_text(figure, 'p', 'few')


def test_more_thermometers_than_colours_are_all_drawn(thermometers):
    picture = pictures.temperatures_over_time(thermometers(9))
    assert len(picture.axes[-1].lines) == 9
