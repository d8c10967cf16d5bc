"""
All pictures: SVG of a report, which takes its text's colour and font from the page, and PNG.

Without compensation is dashed, or a cross; with it is solid, or a dot: colour is never needed.
"""

from collections.abc import Sequence
from html import escape
from io import BytesIO, StringIO
from itertools import cycle, pairwise
import json
import re
import textwrap
from typing import Any, Literal

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
import numpy as np

from wrist_ft_comp.channels import AXES, axis_unit
from wrist_ft_comp.learning.diary import Diary
from wrist_ft_comp.learning.working_day import DAY_NS
from wrist_ft_comp.ranges import rounded
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.report.days import (
    drift_left,
    events,
    MODEL_CHANGES,
    NO_DAYS,
    OFFERED,
    PAINTER,
    summary,
    when,
)
from wrist_ft_comp.report.report_content import ErrorSeries, starts_h
from wrist_ft_comp.series import FloatArray, IntArray

# One palette, after Okabe and Ito: its colours differ with every common colour deficiency and in
# grey, and have a contrast of 3 or more to the report's papers, light and dark.
#: Without compensation, and with it.
WITHOUT, WITH = '#D55E00', '#0A78B8'
THERMOMETERS = ('#009E73', '#BC5F95', '#8A7300', '#7D848C')
#: What happened to a sensor.
INCIDENT = THERMOMETERS[1]
#: Axes, and everything that is not measured.
FRAME = '#7D848C'
_SOLID: dict[str, Any] = {'color': WITH, 'ls': '-', 'lw': 1.4}
_DASHED: dict[str, Any] = {'color': WITHOUT, 'ls': (0, (4, 1.5)), 'lw': 1.2}
_THERMOMETER_STYLES = ('-', '--', '-.', ':')
_DOTS: dict[str, Any] = {'ls': '', 'marker': 'o', 'ms': 2.2, 'mew': 0, 'color': WITH}
_CROSSES: dict[str, Any] = {'ls': '', 'marker': 'x', 'ms': 3.2, 'mew': 0.8, 'color': WITHOUT}
#: Width and height of an SVG, inches, and what labels of its axes and a row of a legend take. To
#: let matplotlib find that out takes longer than all else of a picture.
_SIZE, _SMALL = (4.6, 2.7), (4.6, 2.3)
_LEFT_IN, _RIGHT_IN, _BOTTOM_IN, _TOP_IN, _ROW_IN = 1.0, 0.25, 0.5, 0.1, 0.21
#: Parts of a line; of every part the lowest and the highest point are drawn.
_BUCKETS = 240
#: Most points of a cloud.
_POINTS = 150
#: Most points of a line whose numbers are shown.
_HOVER_POINTS = 240
#: Samples are not joined where they are farther apart than this many median distances.
_GAP = 10.0

# The PNG pictures: of a node's days, and of a recording.
#: Width of a picture, and heights of its parts, inches: newtons, per cent, a lane of events, title
#: and what lies between them; and the panels of a recording.
_WIDTH, _NEWTONS, _PER_CENT, _LANE, _MARGINS = 11.0, 2.4, 1.5, 0.22, 1.7
_TEMPERATURES, _AXIS = 2.2, 1.4
#: Letters in a line of the title.
_TITLE_LETTERS = 115
#: Most dates below the picture.
_MOST_DATES = 8
#: A pause is drawn to scale up to this share of the number of days, or up to this many days.
_PAUSE_SHARE, _LEAST_PAUSE_DAYS = 0.25, 7.0
#: Newtons are drawn up to this many times what 90 % of the days stay below, and so is per cent.
_SHOWN, _MOST_PER_CENT = 2.0, 125.0
#: Least width of a bar in a lane, as a share of the width.
_LEAST_BAR = 0.004


def errors_over_time(series: ErrorSeries, unit: str) -> Figure:
    """Draw the errors of an axis over time; thin lines where one part ends and the next begins."""
    figure, panel = _panel('time, h', f'error, {unit}', _SMALL)
    for at in np.flatnonzero(np.diff(series.part)):
        panel.axvline(series.hours[at : at + 2].mean(), color=FRAME, lw=0.6, ls=':')
    label = 'without compensation'
    _line(panel, series.hours, series.before, series.part, label=label, **_DASHED)
    _line(panel, series.hours, series.after, series.part, label='with', **_SOLID)
    _legend(panel)
    return figure


def errors_over_temperature(series: ErrorSeries, unit: str) -> Figure:
    """Draw the errors of an axis over the temperature of the leading thermometer."""
    figure, panel = _panel('temperature, °C', f'error, {unit}')
    drawn = slice(None, None, max(-(-len(series.hours) // _POINTS), 1))
    at = series.temperature_c[drawn]
    panel.plot(at, series.before[drawn], label='without compensation', **_CROSSES)
    panel.plot(at, series.after[drawn], label='with', **_DOTS)
    _legend(panel)
    return figure


def temperatures_over_time(recordings: Sequence[Recording]) -> Figure:
    """Draw all thermometers over time, recordings one after the other."""
    figure, panel = _panel('time, h', 'temperature, °C')
    pairs = zip(starts_h(recordings), recordings, strict=True)
    hours = np.concatenate([start + recording.elapsed_s / 3600 for start, recording in pairs])
    part = np.repeat(np.arange(len(recordings)), list(map(len, recordings)))
    columns = np.concatenate([one.temperature_c for one in recordings]).T
    styles = cycle(zip(THERMOMETERS, _THERMOMETER_STYLES, strict=True))
    many = len(columns) > 2
    for j, (values, (colour, style)) in enumerate(zip(columns, styles, strict=False), start=1):
        label = f'{j}' if many and j > 1 else f'thermometer {j}'  # the first has the word
        _line(panel, hours, values, part, color=colour, ls=style, lw=1.4, label=label)
    _legend(panel, columns=4 if many else 2)
    return figure


def svg_text(
    figure: Figure, name: str, description: str, series: ErrorSeries | None = None
) -> str:
    """
    Turn a picture into SVG for a page, in which no other picture has its name.

    Ids begin with the name, so that two pictures of one page share none. Text stays text: it is
    sharper and smaller, a search finds it, and the page's style sheet gives it colour and font.
    A series over time goes with it as numbers, which the page's script shows.
    """
    canvas: Any = FigureCanvasSVG(figure)
    buffer = StringIO()
    for patch in (figure.patch, *(panel.patch for panel in figure.axes)):
        patch.set_visible(False)
    with rc_context({'svg.hashsalt': name, 'svg.fonttype': 'none'}):
        canvas.print_svg(buffer, metadata={'Date': None})  # Figure.savefig would draw twice
    text = buffer.getvalue()
    text = re.sub(
        r'<metadata>.*?</metadata>|<!--.*?-->\s*', '', text[text.index('<svg') :], flags=re.DOTALL
    )
    text = re.sub(r'(\bid="|href="#|url\(#)', rf'\g<1>{name}-', text)
    more = f'role="img" aria-label="{escape(description)}"'
    if series is not None:
        panel, points = figure.axes[0], 72.0  # of an inch in SVG
        box, (begin_h, end_h) = panel.get_position(), panel.get_xlim()
        shown = slice(None, None, max(-(-len(series.hours) // _HOVER_POINTS), 1))
        plot = {
            'left': box.x0 * figure.get_figwidth() * points,
            'right': box.x1 * figure.get_figwidth() * points,
            'from': begin_h, 'to': end_h, 'unit': panel.get_ylabel().rpartition(', ')[2],
            'hours': np.round(series.hours[shown], 4).tolist(),
            'seconds': np.round(series.elapsed_s[shown]).astype(int).tolist(),
            'before': [float(rounded(value)) for value in series.before[shown]],
            'after': [float(rounded(value)) for value in series.after[shown]],
        }  # fmt: skip
        more += f' data-plot="{escape(json.dumps(plot))}"'
    return text.replace('<svg', f'<svg {more}', 1)


def thin_out(x: FloatArray, y: FloatArray, buckets: int) -> tuple[FloatArray, FloatArray]:
    """Keep the lowest and the highest point of every stretch of a line, so every peak is kept."""
    if len(x) <= 2 * buckets:
        return x, y
    edges = np.linspace(0, len(x), buckets + 1).astype(int)
    kept = sorted(
        {
            int(start + pick(y[start:end]))
            for start, end in pairwise(edges)
            for pick in (np.argmin, np.argmax)
        }
    )
    return x[kept], y[kept]


def _panel(x_label: str, y_label: str, size: tuple[float, float] = _SIZE) -> tuple[Figure, Axes]:
    """Prepare a picture with one pair of axes."""
    width, height = size
    figure = Figure(figsize=size)
    figure.subplots_adjust(
        left=_LEFT_IN / width, right=1 - _RIGHT_IN / width,
        bottom=_BOTTOM_IN / height, top=1 - _TOP_IN / height,
    )  # fmt: skip
    panel = figure.add_subplot()
    panel.set_xlabel(x_label)
    panel.set_ylabel(y_label)
    panel.locator_params(nbins=6)
    _frame(panel)
    return figure, panel


def _frame(panel: Axes, grid: Literal['both', 'y'] = 'both') -> None:
    """Draw grid, ticks and two of four sides in the colour of what is not measured."""
    panel.grid(axis=grid, color=FRAME, alpha=0.35, lw=0.6)
    panel.set_axisbelow(True)
    panel.tick_params(color=FRAME, length=2)
    panel.spines[['top', 'right']].set_visible(False)
    panel.spines[['bottom', 'left']].set_color(FRAME)


def _legend(panel: Axes, columns: int = 2) -> None:
    """Put the legend above the picture, where it hides nothing."""
    rows = -(-len(panel.get_legend_handles_labels()[0]) // columns)
    figure: Any = panel.figure
    figure.subplots_adjust(top=1 - (_TOP_IN + rows * _ROW_IN) / figure.get_figheight())
    panel.legend(
        loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=columns, frameon=False,
        borderaxespad=0.1, handlelength=2.4, markerscale=1.5,
    )  # fmt: skip


def _line(panel: Axes, x: FloatArray, y: FloatArray, part: IntArray, **style: Any) -> None:
    """Draw a line that breaks between parts and at gaps."""
    steps = np.diff(x)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    breaks = np.flatnonzero((np.diff(part) != 0) | (steps > _GAP * usual)) + 1
    pieces = list(zip(np.split(x, breaks), np.split(y, breaks), strict=True))
    nothing = np.array([np.nan])
    xs, ys = [], []
    for piece_x, piece_y in pieces:
        share = max(round(_BUCKETS * len(piece_x) / max(len(x), 1)), 2)
        kept_x, kept_y = thin_out(piece_x, piece_y, share)
        xs += [kept_x, nothing]
        ys += [kept_y, nothing]
    lonely = 'o' if max(len(piece) for piece, _ in pieces) < 3 else ''
    panel.plot(np.concatenate(xs), np.concatenate(ys), marker=lonely, ms=2, **style)


def days_png(diary: Diary) -> bytes:
    """Draw the days of a node that learns."""
    return _png(days_figure(diary))


def days_figure(diary: Diary) -> Figure:
    """Draw newtons and per cent of every day, and what happened by its name, below a sentence."""
    days, happened = diary.days, events(diary)
    # Days stand where their dates are; those without a date, or with an earlier one, a day later.
    stamps = np.array([day.first_ns or np.nan for day in days], dtype=float)
    steps = np.diff(stamps) / DAY_NS
    longest = max(_PAUSE_SHARE * len(days), _LEAST_PAUSE_DAYS)
    steps = np.minimum(np.where(steps > 0, steps, 1.0), longest)
    left = np.append(0.0, np.cumsum(steps))
    width = np.minimum(np.append(steps, steps[-1:] if len(steps) else 1.0), 1.0)
    right = left + 0.9 * width
    dated = [0]
    for n, at in enumerate(left.tolist()):
        if at - left[dated[-1]] >= (right[-1] - left[0]) / _MOST_DATES:
            dated.append(n)

    names = list(dict.fromkeys(event.name for event in happened))
    heights = _NEWTONS, _PER_CENT, _LANE * (len(names) + 1)
    figure = Figure(figsize=(_WIDTH, sum(heights) + _MARGINS), layout='constrained')
    title, counted = ('\n'.join(textwrap.wrap(line, _TITLE_LETTERS)) for line in summary(diary))
    figure.suptitle(title, x=0.01, ha='left', weight='bold', size=12)
    panels: list[Axes] = figure.subplots(3, height_ratios=heights).tolist()
    newtons, per_cent, lanes = panels
    for panel in panels:
        panel.set_xlim(left[0] - 0.3, right[-1] + 0.3)
        panel.set_xticks(left[dated], [when(days[n]) for n in dated])
        panel.tick_params(labelbottom=panel is lanes)
        _frame(panel, 'y')
    drift = np.array([drift_left(day) for day in days])
    middle, wide = (left + right) / 2, right - left
    for values, colour, share, label in (
        (drift[:, 0], WITHOUT, 1.0, 'drift without a model'),
        (drift[:, 1], WITH, 0.55, 'left by the live model'),
    ):
        alpha = 0.4 if colour == WITHOUT else 1.0
        newtons.bar(middle, values, share * wide, color=colour, alpha=alpha, lw=0, label=label)
    highest = np.nanmax(drift, axis=1, initial=0.0)
    newtons.set_ylim(0, min(_SHOWN * np.quantile(highest, 0.9), 1.1 * highest.max()) or 1.0)
    newtons.set_ylabel('force, N')
    newtons.set_title(counted, loc='left', size=9, color=FRAME, pad=22)
    newtons.legend(
        loc='lower left', bbox_to_anchor=(0, 1), ncols=2, frameon=False, borderaxespad=0.1
    )
    shares = 100 * np.array([drift_left(day).share for day in days])
    per_cent.plot(middle, np.minimum(shares, _MOST_PER_CENT), 'o-', ms=3, lw=0.8, color=WITH)
    per_cent.axhline(100, color=WITHOUT, lw=1.0)
    per_cent.set_ylim(0, 1.05 * _MOST_PER_CENT)
    per_cent.set_yticks((0, 25, 50, 75, 100), ('0', '25', '50', '75', 'no model  100'))
    per_cent.set_ylabel('left, %')

    lanes.set_yticks(range(len(names)), names, parse_math=False)
    lanes.set_ylim(len(names) - 0.4, -0.6)
    least = _LEAST_BAR * (right[-1] - left[0])
    for event in happened:
        lane, begin, end = names.index(event.name), left[event.first], right[event.last]
        if event.name in MODEL_CHANGES:
            lanes.plot(end, lane, '^', color=WITH, ms=7, clip_on=False)
            for panel in (newtons, per_cent) if event.name != OFFERED else ():
                panel.axvline(right[event.first], color=FRAME, lw=0.8, ls='--')
        elif event.name == NO_DAYS:
            begin, end = right[event.first], left[event.last]
            lanes.barh(lane, end - begin, 0.5, begin, color=FRAME, alpha=0.4)
        else:
            lanes.barh(lane, max(end - begin, least), 0.5, begin, color=INCIDENT)
    return figure


def recording_png(recording: Recording, after: FloatArray | None = None) -> bytes:
    """Draw temperatures and wrench of a recording; ``after``, (N, 6), is compensated."""
    axes = [AXES.index(axis) for axis in recording.axes_present]
    heights = [_TEMPERATURES, *[_AXIS] * len(axes)]
    figure = Figure(figsize=(_WIDTH, sum(heights)), layout='constrained')
    figure.suptitle(recording.name, x=0.01, ha='left', weight='bold', size=12, parse_math=False)
    panels = figure.subplots(len(heights), sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    hours, part = recording.elapsed_s / 3600, np.zeros(len(recording), dtype=np.int64)
    panels[0].set_ylabel('temperature, °C')
    for j, (values, colour) in enumerate(
        zip(recording.temperature_c.T, cycle(THERMOMETERS), strict=False), start=1
    ):
        _line(panels[0], hours, values, part, color=colour, lw=1.4, label=f'thermometer {j}')
    for panel, column in zip(panels[1:], axes, strict=True):
        panel.set_ylabel(f'{AXES[column]}, {axis_unit(AXES[column])}')
        for values, label, style in (
            (recording.wrench, 'raw', _DASHED if after is not None else _SOLID),
            (after, 'compensated', _SOLID),
        ):
            if values is not None:
                held = np.isfinite(values[:, column])
                _line(panel, hours[held], values[held, column], part[held], label=label, **style)
    panels[-1].set_xlabel('time, h')
    for panel in panels:
        _frame(panel)
    figure.align_ylabels(panels)
    for panel in panels[:2]:
        panel.legend(loc='best', frameon=False, ncols=4)
    return _png(figure)


def _png(figure: Figure) -> bytes:
    """Draw a picture that is known again by its software."""
    FigureCanvasAgg(figure)
    buffer = BytesIO()
    figure.savefig(buffer, dpi=120, format='png', metadata={'Software': PAINTER})
    return buffer.getvalue()
