"""The picture of a node's days: what drifted, what was left of it, and what happened."""

from collections.abc import Sequence
from io import BytesIO
import textwrap
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, FigureBase
import numpy as np

from wrist_ft_comp.learning.day_files import DAY_NS
from wrist_ft_comp.learning.diary import DayEntry, Diary
from wrist_ft_comp.ranges import rounded
from wrist_ft_comp.report.days import (
    drift_left,
    Event,
    event_line,
    events,
    MODEL_CHANGES,
    NO_DAYS,
    OFFERED,
    PAINTER,
    summary,
    when,
)
from wrist_ft_comp.report.pictures import FRAME, INCIDENT, WITH, WITHOUT
from wrist_ft_comp.series import FloatArray

#: Width of the picture, inches.
_WIDTH = 11.0
#: Heights of the panels of newtons and of per cent, and of a lane of events, inches.
_NEWTONS, _PER_CENT, _LANE = 2.4, 1.5, 0.22
#: Heights of what lies between panels, of the title above, and of a line of text below, inches.
_MARGINS, _TITLE, _LINE = 1.0, 0.6, 0.14
#: Room to the left and the right of the days, days.
_BORDER = 0.3
#: Letters in a line of the title, and of the text.
_TITLE_LETTERS, _TEXT_LETTERS = 115, 160
#: The newest events are written below the picture: this many, in at most this many lines each.
_MOST_EVENTS, _MOST_LINES = 16, 2
#: Most dates below the picture.
_MOST_DATES = 8
#: A pause is drawn to scale up to this share of the number of days, or up to this many days.
_PAUSE_SHARE, _LEAST_PAUSE_DAYS = 0.25, 7.0
#: From this number of days on, bars have no room between them, and dots are small.
_MANY_DAYS = 120
#: Many days are joined by a running median of this many.
_MEDIAN_DAYS = 7
#: Days are joined over pauses up to this long, days: from Friday to Monday.
_JOINED_DAYS = 3.5
#: Newtons above this many times the 90 % quantile are cut off at this many times it.
_FAR, _CUT = 3.0, 1.5
#: Highest percentage that is drawn to scale; figures of higher ones stand between it and the edge.
_MOST_PER_CENT, _EDGE_PER_CENT = 115.0, 135.0
#: Least width of a bar in a lane, and the room for a text beside one, as shares of the width.
_LEAST_BAR, _TEXT_WIDTH = 0.004, 0.075


def days_png(diary: Diary) -> bytes:
    """Draw the days below a sentence that sums them up, and above a list of what happened."""
    happened = events(diary)
    older = len(happened) - _MOST_EVENTS
    lines = [f'{older} older events are listed by wrist_ft_comp show.'] if older > 0 else []
    for event in happened[-_MOST_EVENTS:]:
        lines += textwrap.wrap(
            event_line(event, diary.days), _TEXT_LETTERS, max_lines=_MOST_LINES, placeholder=' …',
            subsequent_indent=' ' * 8)  # fmt: skip
    heights = _height(happened) + _TITLE, _LINE * (len(lines) + 2)
    figure = Figure(figsize=(_WIDTH, sum(heights)), layout='constrained')
    drawing, text = figure.subfigures(2, height_ratios=heights)
    title, small = ('\n'.join(textwrap.wrap(line, _TITLE_LETTERS)) for line in summary(diary))
    drawing.suptitle(title, x=0.01, ha='left', weight='bold', size=12)
    newtons = _draw(drawing, diary.days, happened)
    newtons.set_title(small, loc='left', size=9, color=FRAME, pad=22)
    text.text(0.01, 1, '\n'.join(lines), va='top', size=8, parse_math=False)
    FigureCanvasAgg(figure)
    buffer = BytesIO()
    figure.savefig(buffer, dpi=120, format='png', metadata={'Software': PAINTER})
    return buffer.getvalue()


def days_figure(diary: Diary) -> Figure:
    """Draw newtons and per cent of every day, and what happened by its name."""
    happened = events(diary)
    figure = Figure(figsize=(_WIDTH, _height(happened)), layout='constrained')
    _draw(figure, diary.days, happened)
    return figure


def _height(happened: Sequence[Event]) -> float:
    """Compute the height of the drawing, inches."""
    return _NEWTONS + _PER_CENT + _LANE * len({event.name for event in happened}) + _MARGINS


def _draw(figure: FigureBase, days: Sequence[DayEntry], happened: Sequence[Event]) -> Axes:
    """Draw newtons, per cent and events, from above; gives the uppermost panel."""
    # Days stand where their dates are; those without a date, or with an earlier one, a day later.
    stamps = np.array([day.first_ns or np.nan for day in days], dtype=float)
    steps = np.diff(stamps) / DAY_NS
    longest = max(_PAUSE_SHARE * len(days), _LEAST_PAUSE_DAYS)
    steps = np.minimum(np.where(steps > 0, steps, 1.0), longest)
    left = np.append(0.0, np.cumsum(steps))
    width = np.minimum(np.append(steps, steps[-1:] if len(steps) else 1.0), 1.0)
    right = left + (0.85 if len(days) < _MANY_DAYS else 1.0) * width
    dated = [0]
    for n, at in enumerate(left.tolist()):
        if at - left[dated[-1]] >= (right[-1] - left[0]) / _MOST_DATES:
            dated.append(n)

    names = list(dict.fromkeys(event.name for event in happened))
    heights = _NEWTONS, _PER_CENT, _LANE * (len(names) + 1)
    panels: list[Axes] = figure.subplots(3, height_ratios=heights).tolist()
    newtons, per_cent, lanes = panels
    for panel in panels:
        panel.set_xlim(left[0] - _BORDER, right[-1] + _BORDER)
        panel.set_xticks(left[dated], [when(days[n]) for n in dated])
        panel.tick_params(labelbottom=panel is lanes, color=FRAME)
        panel.spines[['top', 'right']].set_visible(False)
        panel.spines[['bottom', 'left']].set_color(FRAME)
        panel.grid(axis='y', color=FRAME, alpha=0.35, lw=0.6)
        panel.set_axisbelow(True)
    drifts = [drift_left(day) for day in days]
    _draw_newtons(newtons, left, right - left, np.array(drifts))
    _draw_per_cent(per_cent, (left + right) / 2, 100 * np.array([day.share for day in drifts]))

    lanes.set_yticks(range(len(names)), names, parse_math=False)
    lanes.set_ylim(len(names) - 0.4, -0.6)
    least = _LEAST_BAR * (right[-1] - left[0])
    for lane, name in enumerate(names):
        dates = []
        for event in (event for event in happened if event.name == name):
            begin, end = left[event.first], right[event.last]
            if name in MODEL_CHANGES:
                lanes.plot(end, lane, '^', color=WITH, ms=7, clip_on=False)
                begin, end = end - least, end + least
            elif name == NO_DAYS:
                begin, end = right[event.first], left[event.last]
                lanes.barh(lane, end - begin, 0.5, begin, color=FRAME, alpha=0.4)
            else:
                end = max(end, begin + least)
                lanes.barh(lane, end - begin, 0.5, begin, color=INCIDENT)
            dates.append((begin, end, when(days[event.first])))
            if name in MODEL_CHANGES and name != OFFERED:
                for panel in (newtons, per_cent):
                    panel.axvline(right[event.first], color=FRAME, lw=0.8, ls='--')
        _write(lanes, dates, lane)
    return newtons


def _draw_newtons(panel: Axes, begin: FloatArray, width: FloatArray, drift: FloatArray) -> None:
    """Draw the drift of days, wide bars, and what was left of it, narrow bars before them."""
    without, left = drift.T
    narrow, middle = 0.55 if len(without) < _MANY_DAYS else 1.0, begin + width / 2
    label = 'drift without a model'
    panel.bar(middle, without, width, color=WITHOUT, alpha=0.4, lw=0, label=label)
    panel.bar(middle, left, narrow * width, color=WITH, label='left by the live model')
    panel.set_ylabel('force, N')
    highest = np.nanmax(drift, axis=1, initial=0.0)
    usual = float(np.quantile(highest, 0.9))
    top = _CUT * usual if highest.max() > _FAR * usual > 0 else 1.1 * highest.max() or 1.0
    panel.set_ylim(0, top)
    far = [(x, x, f'{rounded(y, 2)} N') for x, y in zip(middle, highest, strict=True) if y > top]
    _write(panel, far, 0.95 * top)
    panel.legend(
        loc='lower left', bbox_to_anchor=(0, 1), ncols=2, frameon=False, borderaxespad=0.1
    )


def _draw_per_cent(panel: Axes, middle: FloatArray, share: FloatArray) -> None:
    """Draw the share of the drift that was left, %, and join it by a line, or by its median."""
    judged = np.flatnonzero(np.isfinite(share))
    many = len(judged) > _MANY_DAYS
    shown = np.minimum(share, _MOST_PER_CENT)
    panel.plot(middle, shown, 'o', ms=2 if many else 4, color=WITH, alpha=0.5 if many else 1.0)
    half = _MEDIAN_DAYS // 2 if many else 0
    line = [np.median(share[judged[max(k - half, 0) : k + half + 1]]) for k in range(len(judged))]
    breaks = np.flatnonzero(np.diff(middle[judged]) > _JOINED_DAYS) + 1
    xs = np.insert(middle[judged], breaks, np.nan)
    panel.plot(xs, np.insert(np.minimum(line, _MOST_PER_CENT), breaks, np.nan), color=WITH, lw=1.2)
    panel.axhline(100, color=WITHOUT, lw=1.0)
    far = judged[share[judged] > _MOST_PER_CENT]
    texts = [(middle[n], middle[n], f'{share[n]:.0f} %') for n in far]
    _write(panel, texts, (_MOST_PER_CENT + _EDGE_PER_CENT) / 2)
    panel.set_ylim(0, _EDGE_PER_CENT)
    panel.set_yticks((0, 25, 50, 75, 100), ('0', '25', '50', '75', 'no model  100'))
    panel.set_ylabel('left, %')


def _write(panel: Axes, texts: Sequence[tuple[float, float, str]], height: float) -> None:
    """Write texts behind spans, (begin, end), or before the last one, where there is room."""
    low, high = panel.get_xlim()
    room = _TEXT_WIDTH * (high - low)
    style: dict[str, Any] = {'textcoords': 'offset points', 'va': 'center', 'fontsize': 8}
    begins = [begin for begin, _, _ in texts[1:]]
    ends = [end for _, end, _ in texts[:-1]]
    for (begin, end, text), before, after in zip(
        texts, [low, *ends], [*begins, high], strict=False
    ):
        if after - end >= room:
            panel.annotate(text, (end, height), (3, 0), ha='left', **style)
        elif after == high and begin - before >= 2 * room:
            panel.annotate(text, (begin, height), (-3, 0), ha='right', **style)
