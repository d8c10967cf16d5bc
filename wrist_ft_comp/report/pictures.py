"""All pictures, SVG and PNG: dashed without compensation, so that colour is never needed."""

from collections.abc import Sequence
from html import escape
from io import BytesIO, StringIO
from itertools import cycle
import json
import re
import textwrap
from typing import Any, Literal

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
import numpy as np

from wrist_ft_comp.recording import Recording
from wrist_ft_comp.report.report_content import ErrorSeries, starts_h
from wrist_ft_comp.series import FloatArray, IntArray, rounded
from wrist_ft_comp.stored.safe_file import Output

#: What a PNG picture names as its software, by which it is known again.
PAINTER = 'wrist_ft_comp picture'
PICTURE = Output(
    # Header, image header, and the text, before or after the chunk that holds the resolution.
    # Bytes that are no text count as one letter, alone or together.
    name='picture', endings='.png',
    begins=rf'.PNG\r\n\x1a\n.{{20,80}}tEXtSoftware\x00{PAINTER}')  # fmt: skip

# One palette, after Okabe and Ito: its colours differ with every common colour deficiency and in
# grey, and have a contrast of 3 or more to the report's papers, light and dark.
#: Without compensation, and with it.
WITHOUT, WITH = '#D55E00', '#0A78B8'
THERMOMETERS = ('#009E73', '#BC5F95', '#8A7300', '#7D848C')
#: Axes, and everything that is not measured.
FRAME = '#7D848C'


def errors_over_time(series: ErrorSeries, unit: str) -> Figure:
    """Draw the errors of an axis over time; thin lines where one part ends and the next begins."""
    figure, panel = _panel(f'error, {unit}')
    for at in np.flatnonzero(np.diff(series.part)):
        panel.axvline(series.hours[at : at + 2].mean(), color=FRAME, lw=0.6, ls=':')
    _line(panel, series.hours, series.before, series.part, color=WITHOUT, ls=(0, (4, 1.5)), lw=1.2)
    _line(panel, series.hours, series.after, series.part, color=WITH, ls='-', lw=1.4)
    return figure


def temperatures_over_time(recordings: Sequence[Recording]) -> Figure:
    """Draw all thermometers over time, recordings one after the other."""
    figure, panel = _panel('temperature, °C')
    pairs = zip(starts_h(recordings), recordings, strict=True)
    hours = np.concatenate([start + recording.elapsed_s / 3600 for start, recording in pairs])
    part = np.repeat(np.arange(len(recordings)), list(map(len, recordings)))
    columns_c = np.concatenate([recording.temperature_c for recording in recordings]).T
    styles = cycle(zip(THERMOMETERS, ('-', '--', '-.', ':'), strict=True))
    for j, (column_c, (colour, style)) in enumerate(zip(columns_c, styles, strict=False), start=1):
        # Of many, only the first one has the word.
        label = f'{j}' if len(columns_c) > 2 and j > 1 else f'thermometer {j}'
        _line(panel, hours, column_c, part, color=colour, ls=style, lw=1.4, label=label)
    panel.legend(loc='lower right', bbox_to_anchor=(1, 1), ncols=4, frameon=False)
    return figure


def svg_text(figure: Figure, name: str, words: str, series: ErrorSeries | None = None) -> str:
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
    # Points of a line that are no farther apart than half a pixel are joined; peaks stay.
    style = {'svg.hashsalt': name, 'svg.fonttype': 'none', 'path.simplify_threshold': 0.5}
    with rc_context(style):
        canvas.print_svg(buffer, metadata={'Date': None})  # Figure.savefig would draw twice
    text = buffer.getvalue()
    text = re.sub(
        r'<metadata>.*?</metadata>|<!--.*?-->\s*', '', text[text.index('<svg') :], flags=re.DOTALL
    )
    text = re.sub(r'(\bid="|href="#|url\(#)', rf'\g<1>{name}-', text)
    more = f'role="img" aria-label="{escape(words)}"'
    if series is not None:
        panel, points = figure.axes[0], 72.0  # of an inch in SVG
        box, (begin_h, end_h) = panel.get_position(), panel.get_xlim()
        shown = slice(None, None, max(-(-len(series.hours) // 240), 1))  # the page stays small
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


def _panel(y_label: str) -> tuple[Figure, Axes]:
    """Prepare a picture of something over time."""
    figure = Figure(figsize=(4.6, 2.1), layout='constrained')
    panel = figure.add_subplot(xlabel='time, h', ylabel=y_label)
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


def _line(panel: Axes, x: FloatArray, y: FloatArray, part: IntArray, **style: Any) -> None:
    """Draw a line that breaks between parts and at gaps."""
    steps = np.diff(x)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    breaks = np.flatnonzero((np.diff(part) != 0) | (steps > 10 * usual)) + 1
    lonely = 'o' if len(x) < 3 * (len(breaks) + 1) else ''
    xs, ys = (np.insert(values, breaks, np.nan) for values in (x, y))
    panel.plot(xs, ys, marker=lonely, ms=2, **style)


def days_figure(sentence: str, dates: Sequence[str], drift: FloatArray) -> Figure:
    """Draw what drifted every day without and with a model, (days, 2), N, below a sentence."""
    figure = Figure(figsize=(11.0, 4.0), layout='constrained')
    title = '\n'.join(textwrap.wrap(sentence, 115))
    figure.suptitle(title, x=0.01, ha='left', weight='bold', size=12)
    panel, numbers = figure.add_subplot(ylabel='force, N'), np.arange(len(dates))
    dated = numbers[:: -(-len(dates) // 8)]  # more dates would overlap
    panel.set_xlim(-0.8, len(dates) - 0.2)
    panel.set_xticks(dated, [dates[n] for n in dated])
    _frame(panel, 'y')
    without, left = drift.T
    panel.bar(numbers, without, 0.9, lw=0, color=WITHOUT, alpha=0.4, label='drift without a model')
    panel.bar(numbers, left, 0.5, lw=0, color=WITH, label='left by the live model')
    highest = np.nanmax(drift, axis=1, initial=0.0)
    # A few wild days must not flatten the others.
    panel.set_ylim(0, min(2 * np.quantile(highest, 0.9), 1.1 * highest.max()) or 1.0)
    panel.legend(loc='lower left', bbox_to_anchor=(0, 1), ncols=2, frameon=False, borderaxespad=0)
    return figure


def png(figure: Figure) -> bytes:
    """Turn a picture into PNG that is known again by its software."""
    buffer = BytesIO()
    figure.savefig(buffer, dpi=120, format='png', metadata={'Software': PAINTER})
    return buffer.getvalue()
