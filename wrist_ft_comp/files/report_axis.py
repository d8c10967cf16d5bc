"""The part of a report that shows one axis."""

from collections.abc import Iterator
import math

from wrist_ft_comp.core.axis_fit import Candidate
from wrist_ft_comp.files import report_pictures as pictures
from wrist_ft_comp.files.report_html import (
    bullets,
    duration,
    element,
    facts,
    number,
    table,
    text,
)
from wrist_ft_comp.files.report_view import AxisView


def axis_name(axis: str) -> str:
    """Write an axis' name for people."""
    return axis.replace('_', ' ')


def axis_section(axis: AxisView, level: str) -> str:
    """
    Show one axis: verdict, errors over time and temperature, what was chosen among what.

    Parameters
    ----------
    axis : AxisView
        What to show.
    level : str
        Its verdict's name.

    Returns
    -------
    str
        HTML.

    """
    head = element(
        'header',
        text('h3', axis_name(axis.axis)) + text('span', level, class_='level'),
        class_=axis.verdict.level,
    )
    notes = bullets(axis.notes) if axis.notes else ''
    learnt = element('div', _parts(axis) + facts(dict(_facts(axis))) + notes)
    tried = element('div', _candidates(axis)) if axis.candidates else ''
    inside = (
        head
        + text('p', axis.verdict.sentence)
        + element('div', ''.join(_figures(axis)), class_='pair')
        + element('div', learnt + tried, class_='pair')
    )
    return element('section', inside, class_='axis', id=axis.axis)


def _figures(axis: AxisView) -> Iterator[str]:
    """Draw the errors over time and over temperature."""
    name = axis_name(axis.axis)
    several = axis.series.part[0] != axis.series.part[-1]
    what_parts = 'recordings' if axis.parts else 'held-out blocks'
    dotted = f'; dotted lines part {what_parts}' if several else ''
    what = f'from {number(axis.rms_before)} to {number(axis.rms_after)} {axis.unit} RMS'
    for key, figure, over in (
        ('t', pictures.errors_over_time(axis.series, axis.unit), 'time'),
        ('c', pictures.errors_over_temperature(axis.series, axis.unit), 'temperature'),
    ):
        words = f'Error of {name} over {over}, without and with compensation: {what}.'
        picture = pictures.svg_text(figure, f'{key}{axis.axis.replace("_", "")}', words)
        yield element('figure', picture + text('figcaption', f'{name} over {over}{dotted}'))
        dotted = ''


def _parts(axis: AxisView) -> str:
    """Tell several recordings apart: one may be good and another bad."""
    if len(axis.parts) < 2:
        return ''
    return table(
        f'Recording by recording, {axis.unit} RMS',
        ['', 'before', 'after'],
        [[name, number(before), number(after)] for name, before, after in axis.parts],
        class_='names',
    )


def _facts(axis: AxisView) -> Iterator[tuple[str, str]]:
    """List what was learnt."""
    yield 'removed drift', axis.drifts
    yield 'chosen', axis.chosen
    if axis.reason:
        yield 'because', axis.reason
    if axis.time_constants_s:
        yield 'time constants', ', '.join(_time_constants(axis))


def _time_constants(axis: AxisView) -> Iterator[str]:
    """Write time constants with their standard errors, where these are known."""
    unknown = (math.nan,) * len(axis.time_constants_s)
    errors = axis.time_constant_errors_s or unknown
    for tau, error in zip(axis.time_constants_s, errors, strict=True):
        yield duration(tau) if math.isnan(error) else duration(tau, error)


def _candidates(axis: AxisView) -> str:
    """Put all candidates and their scores into a table with bars."""
    largest = max(candidate.rms for candidate in axis.candidates) or 1.0
    rows = ''.join(_candidate(each, axis.chosen, largest) for each in axis.candidates)
    titles = ('candidate', f'held out, {axis.unit} RMS', '')
    head = element('tr', ''.join(text('th', title, scope='col') for title in titles))
    whose = ' of the calibration' if axis.parts else ''
    caption = text('caption', f'All candidates{whose}, simplest first; the chosen one in bold.')
    return element(
        'table', caption + element('thead', head) + element('tbody', rows), class_='bars'
    )


def _candidate(candidate: Candidate, chosen: str, largest: float) -> str:
    """Write one candidate."""
    width = f'width:{100 * candidate.rms / largest:.1f}%'
    cells = (
        text('th', 'no compensation' if candidate.name == 'none' else candidate.name, scope='row')
        + text('td', number(candidate.rms))
        + element('td', element('span', '', class_='bar', style=width))
    )
    return element('tr', cells, class_='chosen' if candidate.name == chosen else 'tried')
