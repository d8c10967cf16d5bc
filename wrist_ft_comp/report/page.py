"""The report: one self-contained page that says how good a calibration is, and shows why."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from html import escape
from importlib import resources
import math
import re

from wrist_ft_comp.calibration.chamber import FIGURE_TITLES
from wrist_ft_comp.calibration.result import Candidate
from wrist_ft_comp.report import pictures
from wrist_ft_comp.report.verdict import LEVEL_NAMES
from wrist_ft_comp.report.view import AxisView, ReportView, Source

#: By this a page is known again.
GENERATOR = 'wrist_ft_comp report'
#: A number and its unit stay on one line.
_UNITS = re.compile(r'(?<=\d) (?=(?:N m|N|°C|K|%|h|min|s)(?!\w))')


def text(tag: str, content: str, **attributes: str) -> str:
    """
    Write an element that holds text.

    Parameters
    ----------
    tag : str
        Its name.
    content : str
        Plain text.
    **attributes : str
        By name; ``class_`` stands for class.

    Returns
    -------
    str
        HTML.

    """
    joined = _UNITS.sub('\N{NO-BREAK SPACE}', content).replace('N m', 'N\N{NO-BREAK SPACE}m')
    return element(tag, escape(joined), **attributes)


def element(tag: str, inside: str, **attributes: str) -> str:
    """Write an element around HTML; attributes as for text."""
    written = ''.join(
        f' {name.rstrip("_")}="{escape(value)}"' for name, value in attributes.items()
    )
    return f'<{tag}{written}>{inside}</{tag}>'


def bullets(sentences: Iterable[str]) -> str:
    """Write a list of sentences."""
    return element('ul', ''.join(text('li', sentence) for sentence in sentences))


def facts(pairs: Mapping[str, str]) -> str:
    """Write names and what they stand for."""
    return element('dl', ''.join(text('dt', k) + text('dd', v) for k, v in pairs.items()))


def table(
    caption: str, header: Sequence[str], rows: Iterable[Sequence[str]], **attributes: str
) -> str:
    """
    Write a table whose first column names the rows.

    Parameters
    ----------
    caption : str
        What it holds.
    header : sequence of str
        Column titles.
    rows : iterable of sequences of str
        Cells.
    **attributes : str
        As for text.

    Returns
    -------
    str
        HTML.

    """
    titles = ''.join(text('th', title, scope='col') for title in header)
    lines = (
        text('th', first, scope='row') + ''.join(text('td', cell) for cell in cells)
        for first, *cells in rows
    )
    body = ''.join(element('tr', line) for line in lines)
    head = element('thead', element('tr', titles))
    inside = text('caption', caption) + head + element('tbody', body)
    return element('table', inside, **attributes)


def number(value: float) -> str:
    """Write a number with four digits that count, as the command line does."""
    if value != value:  # noqa: PLR0124 -- NaN
        return '–'
    return f'{value:.0f}' if abs(value) >= 1000 else f'{value:.4g}'


def duration(seconds: float, error: float | None = None) -> str:
    """Write a time for people, and its standard error in the same unit."""
    unit, size, digits = 's', 1, 0
    if seconds >= 120:
        unit, size, digits = ('min', 60, 1) if seconds < 7200 else ('h', 3600, 1)
    spread = '' if error is None else f' ± {error / size:.{digits}f}'
    return f'{seconds / size:.{digits}f}{spread} {unit}'


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


def page(view: ReportView) -> str:
    """
    Write the page as text.

    Parameters
    ----------
    view : ReportView
        Its content.

    Returns
    -------
    str
        HTML that loads nothing and runs nothing.

    """
    style = resources.files(__package__).joinpath('report.css').read_text('utf-8')
    title = f'{view.kind.capitalize()} of {view.model}'
    head = (
        f'<meta charset="utf-8"><meta name="generator" content="{GENERATOR}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'{text("title", title)}{element("style", style)}'
    )
    body = element('header', text('h1', title) + text('p', headline(view), class_='lead'))
    main = element('main', ''.join(_sections(view)))
    return (
        '<!doctype html>\n<html lang="en">'
        f'{element("head", head)}{element("body", body + main)}</html>\n'
    )


def headline(view: ReportView) -> str:
    """
    Sum the verdicts up in one sentence.

    Parameters
    ----------
    view : ReportView
        The report's content.

    Returns
    -------
    str
        Such as ``6 axes: 5 good, 1 weak.`` and what was seen.

    """
    counts = Counter(axis.verdict.level for axis in view.axes)
    total = len(view.axes)
    parts = [f'{counts[level]} {name}' for level, name in LEVEL_NAMES.items() if counts[level]]
    low, high = view.coverage.range_c[view.coverage.leading]
    hours = sum(source.hours for source in view.sources)
    axes = f'{total} {"axis" if total == 1 else "axes"}'
    return f'{axes}: {", ".join(parts)}. Seen: {hours:.1f} h at {low:.0f} to {high:.0f} °C.'


def _sections(view: ReportView) -> Iterator[str]:
    """Write everything below the title, the most important first."""
    yield text('h2', 'Is it good?') + _verdicts(view)
    if view.warnings:
        yield text('h2', 'Mind this') + bullets(view.warnings)
    yield text('h2', 'What to record next') + bullets(view.advice)
    yield text('h2', 'Error before and after') + text('p', view.explanation) + _errors(view)
    yield ''.join(_chamber_tables(view))
    yield text('h2', 'What was covered') + _coverage(view)
    yield text('h2', 'Axis by axis')
    yield from (axis_section(axis, LEVEL_NAMES[axis.verdict.level]) for axis in view.axes)
    yield text('h2', 'Where it comes from') + _provenance(view)


def _verdicts(view: ReportView) -> str:
    """Write one sentence per axis."""
    items = [
        element(
            'li',
            element('strong', element('a', axis_name(axis.axis), href=f'#{axis.axis}'))
            + text('span', LEVEL_NAMES[axis.verdict.level], class_='level')
            + text('p', axis.verdict.sentence),
            class_=axis.verdict.level,
        )
        for axis in view.axes
    ]
    return element('ul', ''.join(items), class_='verdicts')


def _errors(view: ReportView) -> str:
    """Write the table of errors."""
    held_out = 'Held-out error' if view.kind == 'calibration' else 'Error'
    return table(
        f'{held_out}: root mean square (RMS) and largest.',
        ['axis', 'RMS before', 'after', 'peak before', 'after'],
        [
            [
                f'{axis_name(axis.axis)}, {axis.unit}',
                number(axis.rms_before),
                number(axis.rms_after),
                number(axis.peak_before),
                number(axis.peak_after),
            ]
            for axis in view.axes
        ],
    )


def _chamber_tables(view: ReportView) -> Iterator[str]:
    """Write the figures of chamber tables."""
    for test, columns in view.tables.items():
        values = [asdict(figures) for figures in columns.values()]
        yield table(
            f'Chamber test {test}. Left out: every temperature predicted from the others.'
            if 'left out' in columns
            else f'Chamber test {test}.',
            ['', *columns],
            [
                [title, *(number(each[name]) for each in values)]
                for name, title in FIGURE_TITLES.items()
            ],
        )


def _coverage(view: ReportView) -> str:
    """Show which temperatures and loads were seen."""
    names = ', '.join(each.name for each in view.thermometers)
    figures = (
        (pictures.temperatures_over_time(view.thermometers), f'Temperature of {names} over time.'),
        (
            pictures.time_over_temperature(view.coverage),
            f'Time of thermometer {view.coverage.leading + 1} at each temperature.',
        ),
    )
    pair = ''.join(
        element('figure', pictures.svg_text(figure, f'c{i}', words) + text('figcaption', words))
        for i, (figure, words) in enumerate(figures)
    )
    ranges = table(
        'Temperatures, °C',
        ['', 'from', 'to'],
        [
            [each.name, f'{low:.1f}', f'{high:.1f}']
            for each, (low, high) in zip(view.thermometers, view.coverage.range_c, strict=True)
        ],
    )
    loads = view.coverage.loads.items()
    units = {axis.axis: axis.unit for axis in view.axes}
    known = table(
        'Loads by the reference',
        ['axis', 'from', 'to', 'standard deviation'],
        [
            [f'{axis_name(a)}, {units[a]}', *map(number, (load.low, load.high, load.deviation))]
            for a, load in loads
        ],
    )
    unknown = text('p', 'Loads are not known: no reference was recorded.', class_='soft')
    return element('div', pair, class_='pair') + ranges + (known if loads else unknown)


def _provenance(view: ReportView) -> str:
    """Write files, hashes, versions and settings."""
    seen = text('h3', 'Recordings in this report') + _sources(view.sources)
    learnt = text('h3', 'Recordings the model was learnt from') + _sources(view.learnt_from)
    return facts(view.provenance) + (learnt if view.kind == 'calibration' else seen + learnt)


def _sources(sources: tuple[Source, ...]) -> str:
    """List recordings."""
    if not sources:
        return text('p', 'The model file does not say.')
    items = [
        text('span', source.name)
        + (text('span', f', {source.hours:.2f} h') if source.hours == source.hours else '')
        + (f'<br>SHA-256 {text("code", source.sha256)}' if source.sha256 else '')
        for source in sources
    ]
    return element('ul', ''.join(element('li', item) for item in items))
