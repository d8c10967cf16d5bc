"""
The pictures: the report's, SVG that takes colours and fonts from the page, and the demo's, a PNG.

Without compensation is dashed, or a cross; with it is solid, or a dot: colour is never needed.
"""

from collections.abc import Sequence
from html import escape
from io import BytesIO, StringIO
from itertools import pairwise
import re
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
import numpy as np

from wrist_ft_comp.report import PAINTER
from wrist_ft_comp.report.coverage import Coverage, WORKING_RANGE_C
from wrist_ft_comp.report.view import ErrorSeries, WorkView
from wrist_ft_comp.signals import FloatArray, IntArray

# Placeholders for the page's colours; the style sheet defines what they stand for.
_INK, _GRID, _WITHOUT, _WITH = '#0a0b01', '#0a0b02', '#0a0b03', '#0a0b04'
_THERMOMETERS = (('#0a0b05', '-'), ('#0a0b06', '--'), ('#0a0b07', '-.'), ('#0a0b08', ':'))
_VARIABLES = {
    _INK: 'ink', _GRID: 'grid', _WITHOUT: 'without', _WITH: 'with',
    **{colour: f'thermometer-{j + 1}' for j, (colour, _) in enumerate(_THERMOMETERS)},
}  # fmt: skip
_SOLID: dict[str, Any] = {'color': _WITH, 'ls': '-', 'lw': 1.4}
_DASHED: dict[str, Any] = {'color': _WITHOUT, 'ls': (0, (4, 1.5)), 'lw': 1.2}
_SIZE = (4.6, 2.7)
#: Parts of a line in which the lowest and the highest point are kept.
_BUCKETS = 240
#: Points of a cloud.
_POINTS = 300
#: Samples further apart than this many times the usual distance are not joined.
_GAP = 10.0
# The PNG's, by Okabe and Ito: distinguishable with every common colour deficiency, and in grey.
RAW_COLOUR, COMPENSATED_COLOUR = '#D55E00', '#0072B2'
#: Colour, width, height above others, and label of what is left of an axis' drift.
_LEFT = (
    (RAW_COLOUR, 1.0, 2.0, 'without'),
    (COMPENSATED_COLOUR, 1.0, 2.2, 'with'),
    ('#999999', 0.6, 2.1, 'with, payload taken off'),
)
_TEMPERATURE_COLOURS = ('#009E73', '#CC79A7', '#E69F00', '#56B4E9')
#: Points of one of its lines.
_PNG_POINTS = 4000


def errors_over_time(series: ErrorSeries, unit: str) -> Figure:
    """Draw the errors of an axis over time; thin lines where one part ends and the next begins."""
    figure, panel = _panel_of_parts(f'error, {unit}', series.hours, series.part)
    label = 'without compensation'
    _line(panel, series.hours, series.before, series.part, label=label, **_DASHED)
    _line(panel, series.hours, series.after, series.part, label='with', **_SOLID)
    _legend(panel)
    return figure


def errors_over_temperature(series: ErrorSeries, unit: str) -> Figure:
    """Draw the errors of an axis over the temperature of the leading thermometer."""
    figure, panel = _panel('temperature, °C', f'error, {unit}')
    every = slice(None, None, max(-(-len(series.hours) // _POINTS), 1))
    at = series.temperature_c[every]
    panel.plot(at, series.before[every], ls='', marker='x', ms=3.2, mew=0.8, color=_WITHOUT,
               label='without compensation')  # fmt: skip
    panel.plot(
        at, series.after[every], ls='', marker='o', ms=2.2, mew=0, color=_WITH, label='with'
    )
    _legend(panel)
    return figure


def drift_after_a_step(unit: str, minutes: FloatArray, drift: FloatArray) -> Figure:
    """Draw how the drift follows each thermometer that warms by 1 K: what it adds, and when."""
    figure, panel = _panel('minutes after the thermometer warmed', f'drift, {unit} per K')
    _thermometer_lines(panel, minutes, drift.T, np.zeros(len(minutes), dtype=np.int64))
    panel.axhline(0.0, color=_INK, lw=0.6)
    return figure


def temperatures_over_time(hours: FloatArray, temperature_c: FloatArray, part: IntArray) -> Figure:
    """Draw all thermometers, (n, J), over time, broken between parts."""
    figure, panel = _panel('time, h', 'temperature, °C')
    _thermometer_lines(panel, hours, temperature_c, part)
    return figure


def time_over_temperature(coverage: Coverage) -> Figure:
    """Draw how long the leading thermometer was at which temperature, and what it has not seen."""
    figure, panel = _panel('temperature, °C', 'minutes per kelvin')
    edges, minutes = coverage.edges_c, coverage.seconds[coverage.leading] / 60
    panel.bar(edges[:-1], minutes, np.diff(edges), align='edge', color=_WITH, label='seen')
    low, high = WORKING_RANGE_C
    empty = (minutes == 0) & (edges[:-1] >= low) & (edges[1:] <= high)
    panel.bar(
        edges[:-1][empty], np.full(int(empty.sum()), max(minutes.max(), 1e-9)),
        np.diff(edges)[empty], align='edge', color='none', edgecolor=_GRID, hatch='////', lw=0,
        label='not seen',
    )  # fmt: skip
    _legend(panel)
    return figure


def directions_seen(directions: FloatArray) -> Figure:
    """Draw where gravity came from: both halves of the sphere, equal areas, z in their middles."""
    figure = Figure(figsize=_SIZE, layout='constrained')
    every = slice(None, None, max(-(-len(directions) // (2 * _POINTS)), 1))
    angle = np.linspace(0, 2 * np.pi, 100)
    for number, sign in enumerate((1, -1)):
        panel = figure.add_subplot(1, 2, number + 1)
        panel.set_aspect('equal')
        panel.set_axis_off()
        for tilt in (30, 60, 90):
            radius = np.sqrt(2) * np.sin(np.deg2rad(tilt) / 2)
            panel.plot(radius * np.cos(angle), radius * np.sin(angle), color=_GRID, lw=0.6)
        x, y, z = directions[every][sign * directions[every, 2] > 0].T
        shrink = 1 / np.sqrt(1 + np.abs(z))
        panel.plot(x * shrink, y * shrink, ls='', marker='o', ms=2.2, mew=0, color=_WITH)
        panel.annotate('x', (1.03, 0), color=_INK, va='center')
        panel.annotate('y', (0, 1.03), color=_INK, ha='center')
        panel.set_title('z up' if sign > 0 else 'z down', color=_INK, fontsize=9)
    return figure


def used_over_time(work: WorkView) -> Figure:
    """Draw the shares of the time that counted, and that were taken for contact."""
    figure, panel = _panel_of_parts('share of the time, %', work.hours, work.part)
    _line(panel, work.hours, 100 * work.used, work.part, label='learnt from', **_SOLID)
    _line(panel, work.hours, 100 * work.pushed, work.part, label='taken for contact', **_DASHED)
    panel.set_ylim(0, 100)
    _legend(panel)
    return figure


def svg_text(figure: Figure, name: str, description: str) -> str:
    """Turn a picture into SVG in the page's colours, by a name that no other picture of it has."""
    canvas: Any = FigureCanvasSVG(figure)
    buffer = StringIO()
    for patch in (figure.patch, *(panel.patch for panel in figure.axes)):
        patch.set_visible(False)
    # Text stays text: sharper, smaller, and found by a search. Figure.savefig would draw twice.
    with rc_context({'svg.hashsalt': name, 'svg.fonttype': 'none', 'hatch.color': _GRID}):
        canvas.print_svg(buffer, metadata={'Date': None})
    text = buffer.getvalue()
    text = re.sub(r'<metadata>.*?</metadata>', '', text[text.index('<svg') :], flags=re.DOTALL)
    text = re.sub(r'(\bid="|href="#|url\(#)', rf'\g<1>{name}-', text)
    text = re.sub(r'<!--.*?-->\s*', '', text)
    # Matplotlib writes "font: 10px 'DejaVu Sans', …", newer ones size and family apart.
    text = re.sub(r'font: ([\d.]+)px [^;"]*', r'font-size: \1px', text)
    text = re.sub(r'font-family: [^;"]*;? ?', '', text)
    for colour, variable in _VARIABLES.items():
        text = text.replace(colour, f'var(--{variable})')
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
    figure = Figure(figsize=_SIZE, layout='constrained')
    panel = figure.add_subplot()
    panel.set_xlabel(x_label, color=_INK)
    panel.set_ylabel(y_label, color=_INK)
    panel.grid(color=_GRID, lw=0.6)
    panel.set_axisbelow(True)
    panel.tick_params(colors=_INK, length=2)
    panel.locator_params(nbins=6)
    panel.spines[['top', 'right']].set_visible(False)
    panel.spines[['bottom', 'left']].set_color(_INK)
    return figure, panel


def _panel_of_parts(y_label: str, hours: FloatArray, part: IntArray) -> tuple[Figure, Axes]:
    """Prepare a picture over time; thin lines where one part ends and the next begins."""
    figure, panel = _panel('time, h', y_label)
    for at in np.flatnonzero(np.diff(part)):
        panel.axvline(hours[at : at + 2].mean(), color=_INK, lw=0.6, ls=':')
    return figure, panel


def _thermometer_lines(panel: Axes, x: FloatArray, columns: FloatArray, part: IntArray) -> None:
    """Draw a line per thermometer, (n, J)."""
    for j, values in enumerate(columns.T):
        colour, style = _THERMOMETERS[j % len(_THERMOMETERS)]
        label = f'thermometer {j + 1}'
        _line(panel, x, values, part, color=colour, ls=style, lw=1.4, label=label)
    _legend(panel, columns=min(columns.shape[1], 3))


def _legend(panel: Axes, columns: int = 2) -> None:
    """Put the legend above the picture, where it hides nothing."""
    panel.legend(
        loc='lower left', bbox_to_anchor=(0.0, 1.0), ncols=columns, frameon=False,
        labelcolor=_INK, borderaxespad=0.1, handlelength=2.4, markerscale=1.5,
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


def draw_drift(
    axes: Sequence[tuple[str, FloatArray, Sequence[FloatArray]]],
    temperatures: Sequence[tuple[str, FloatArray, FloatArray]],
) -> Figure:
    """Draw every axis over time, without and with compensation, above the temperatures."""
    # By title, which names the unit: times, s, (n,), and what is left of drift, raw, compensated
    # and perhaps in ``wrench_external``, or °C, (n,); NaN where nothing is known.
    rows = -(-len(axes) // 2) + 1
    figure = Figure(figsize=(10.0, 2.2 * rows), layout='constrained')
    grid = figure.add_gridspec(rows, 2)
    for number, (title, elapsed_s, left) in enumerate(axes):
        panel = figure.add_subplot(grid[number // 2, number % 2])
        for values, (colour, width, above, label) in zip(left, _LEFT, strict=False):
            _png_line(panel, elapsed_s, values, color=colour, lw=width, zorder=above, label=label)
        panel.set_title(title, fontsize=10)
        panel.grid(alpha=0.3)
        if number == 0:
            panel.legend(title='compensation', fontsize=8, title_fontsize=8)
    panel = figure.add_subplot(grid[rows - 1, :])
    for number, (title, elapsed_s, temperature_c) in enumerate(temperatures):
        colour = _TEMPERATURE_COLOURS[number % len(_TEMPERATURE_COLOURS)]
        _png_line(panel, elapsed_s, temperature_c, color=colour, label=title)
    panel.set_title('temperature, °C', fontsize=10)
    panel.set_xlabel('time, h')
    panel.grid(alpha=0.3)
    panel.legend(fontsize=8)
    return figure


def _png_line(panel: Axes, elapsed_s: FloatArray, values: FloatArray, **style: Any) -> None:
    """Draw a line of a few thousand points."""
    every = slice(None, None, max(len(elapsed_s) // _PNG_POINTS, 1))
    panel.plot(elapsed_s[every] / 3600, values[every], **style)


def png_bytes(figure: Figure) -> bytes:
    """Turn a picture into the content of a PNG file."""
    FigureCanvasAgg(figure)
    buffer = BytesIO()
    figure.savefig(buffer, dpi=120, format='png', metadata={'Software': PAINTER})
    return buffer.getvalue()
