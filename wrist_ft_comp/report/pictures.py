"""
The report's pictures: SVG that takes its text's colour and font from the page.

Without compensation is dashed, or a cross; with it is solid, or a dot: colour is never needed.
"""

from html import escape
from io import StringIO
from itertools import cycle, pairwise
import re
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
import numpy as np

from wrist_ft_comp.report.coverage import Coverage, WORKING_RANGE_C
from wrist_ft_comp.report.report_content import ErrorSeries
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
_GRID: dict[str, Any] = {'color': FRAME, 'alpha': 0.35, 'lw': 0.6}
_SOLID: dict[str, Any] = {'color': WITH, 'ls': '-', 'lw': 1.4}
_DASHED: dict[str, Any] = {'color': WITHOUT, 'ls': (0, (4, 1.5)), 'lw': 1.2}
_THERMOMETER_STYLES = ('-', '--', '-.', ':')
_DOTS: dict[str, Any] = {'ls': '', 'marker': 'o', 'ms': 2.2, 'mew': 0, 'color': WITH}
_CROSSES: dict[str, Any] = {'ls': '', 'marker': 'x', 'ms': 3.2, 'mew': 0.8, 'color': WITHOUT}
#: Width and height of an SVG, inches, and what labels of its axes and a row of a legend take. To
#: let matplotlib find that out takes longer than all else of a picture.
_SIZE = (4.6, 2.7)
_LEFT_IN, _RIGHT_IN, _BOTTOM_IN, _TOP_IN, _ROW_IN = 1.0, 0.25, 0.5, 0.1, 0.21
#: Parts of a line; of every part the lowest and the highest point are drawn.
_BUCKETS = 240
#: Most points of a cloud.
_POINTS = 300
#: Samples are not joined where they are farther apart than this many median distances.
_GAP = 10.0


def errors_over_time(series: ErrorSeries, unit: str) -> Figure:
    """Draw the errors of an axis over time; thin lines where one part ends and the next begins."""
    figure, panel = _panel('time, h', f'error, {unit}')
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


def drift_after_a_step(unit: str, minutes: FloatArray, drift: FloatArray) -> Figure:
    """Draw how the drift follows each thermometer that warms by 1 K: what it adds, and when."""
    figure, panel = _panel('minutes after the thermometer warmed', f'drift, {unit} per K')
    _thermometer_lines(panel, minutes, drift.T, np.zeros(len(minutes), dtype=np.int64))
    panel.axhline(0.0, color=FRAME, lw=0.6)
    return figure


def temperatures_over_time(hours: FloatArray, temperature_c: FloatArray, part: IntArray) -> Figure:
    """Draw all thermometers, (n, J), over time, broken between parts."""
    figure, panel = _panel('time, h', 'temperature, °C')
    _thermometer_lines(panel, hours, temperature_c, part)
    return figure


def time_over_temperature(coverage: Coverage) -> Figure:
    """Draw how long the leading thermometer was at every temperature, and where it never was."""
    figure, panel = _panel('temperature, °C', 'minutes per kelvin')
    edges, minutes = coverage.edges_c, coverage.seconds[coverage.leading] / 60
    panel.bar(edges[:-1], minutes, np.diff(edges), align='edge', color=WITH, label='seen')
    low, high = WORKING_RANGE_C
    empty = (minutes == 0) & (edges[:-1] >= low) & (edges[1:] <= high)
    panel.bar(
        edges[:-1][empty], np.full(int(empty.sum()), max(minutes.max(), 1e-9)),
        np.diff(edges)[empty], align='edge', color='none', edgecolor=FRAME, hatch='////', lw=0,
        label='not seen',
    )  # fmt: skip
    _legend(panel)
    return figure


def svg_text(figure: Figure, name: str, description: str) -> str:
    """
    Turn a picture into SVG for a page, in which no other picture has its name.

    Ids begin with the name, so that two pictures of one page share none. Text stays text: it is
    sharper and smaller, a search finds it, and the page's style sheet gives it colour and font.
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
    return text.replace('<svg', f'<svg role="img" aria-label="{escape(description)}"', 1)


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


def _panel(x_label: str, y_label: str) -> tuple[Figure, Axes]:
    """Prepare a picture with one pair of axes."""
    width, height = _SIZE
    figure = Figure(figsize=_SIZE)
    figure.subplots_adjust(
        left=_LEFT_IN / width, right=1 - _RIGHT_IN / width,
        bottom=_BOTTOM_IN / height, top=1 - _TOP_IN / height,
    )  # fmt: skip
    panel = figure.add_subplot()
    panel.set_xlabel(x_label)
    panel.set_ylabel(y_label)
    panel.grid(**_GRID)
    panel.set_axisbelow(True)
    panel.tick_params(color=FRAME, length=2)
    panel.locator_params(nbins=6)
    panel.spines[['top', 'right']].set_visible(False)
    panel.spines[['bottom', 'left']].set_color(FRAME)
    return figure, panel


def _thermometer_lines(panel: Axes, x: FloatArray, columns: FloatArray, part: IntArray) -> None:
    """Draw a line per thermometer, (n, J); a legend of many begins with the word only."""
    styles = cycle(zip(THERMOMETERS, _THERMOMETER_STYLES, strict=True))
    many = columns.shape[1] > 2
    for j, (values, (colour, style)) in enumerate(zip(columns.T, styles, strict=False), start=1):
        label = f'{j}' if many and j > 1 else f'thermometer {j}'
        _line(panel, x, values, part, color=colour, ls=style, lw=1.4, label=label)
    _legend(panel, columns=4 if many else 2)


def _legend(panel: Axes, columns: int = 2) -> None:
    """Put the legend above the picture, where it hides nothing."""
    rows = -(-len(panel.get_legend_handles_labels()[0]) // columns)
    panel.figure.subplots_adjust(top=1 - (_TOP_IN + rows * _ROW_IN) / _SIZE[1])
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
