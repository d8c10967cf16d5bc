"""The report: one self-contained page that says how good a calibration is, and shows why."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict
from importlib import resources
from pathlib import Path

from wrist_ft_comp import RecordingError
from wrist_ft_comp.core.chamber_fit import FIGURE_TITLES
from wrist_ft_comp.core.verdict import LEVEL_NAMES
from wrist_ft_comp.files import report_pictures as pictures
from wrist_ft_comp.files.atomic import replaced_on_success
from wrist_ft_comp.files.report_axis import axis_name, axis_section
from wrist_ft_comp.files.report_html import bullets, element, facts, number, table, text
from wrist_ft_comp.files.report_view import ReportView, Source

#: By this a page is known again.
GENERATOR = 'wrist_ft_comp report'


def write_report(path: Path, view: ReportView) -> None:
    """
    Write the page; an existing one is replaced in one step.

    Parameters
    ----------
    path : Path
        Target.
    view : ReportView
        Its content.

    Raises
    ------
    RecordingError
        When the page cannot be written.

    """
    content = page(view)
    try:
        with replaced_on_success(path) as neighbour:
            # A file's name may hold bytes that are no text; they are shown as "?".
            neighbour.write_text(content, encoding='utf-8', errors='replace')
    except OSError as error:
        raise RecordingError(
            f'The report {path} cannot be written: {error.strerror}. Choose a folder that can be '
            'written to, or make room.'
        ) from error


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
