"""The picture of a diary: the drift of every day, and what was left of it."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wrist_ft_comp.calibration.learning.entry import Diary
from wrist_ft_comp.report.days import figures
from wrist_ft_comp.report.pictures import COMPENSATED_COLOUR, png_bytes, RAW_COLOUR

__all__ = ['draw_days', 'png_bytes']

_CHALLENGER_COLOUR, _CHANGE_COLOUR = '#009E73', '#999999'


def draw_days(diaries: Sequence[Diary]) -> Figure:
    """Draw the drift left per day, each node below the other."""
    figure = Figure(figsize=(10.0, 4.0 * len(diaries)), layout='constrained')
    for number, diary in enumerate(diaries, start=1):
        _draw(figure.add_subplot(len(diaries), 1, number), diary)
    return figure


def _draw(panel: Axes, diary: Diary) -> None:
    """Draw one node's days; lines are changes of the live model, crosses incidents."""
    days = [figures(entry) for entry in diary.days]
    at = {each.name: number for number, each in enumerate(days)}
    for values, colour, style, marker, label in (
        ([each.raw_n for each in days], RAW_COLOUR, '--', 'x', 'no model'),
        ([each.live_n for each in days], COMPENSATED_COLOUR, '-', 'o', 'live model'),
        ([each.challenger_n for each in days], _CHALLENGER_COLOUR, '', '^', 'challenger'),
    ):
        panel.plot(values, color=colour, ls=style, marker=marker, ms=4, label=label)
    for decision in diary.decisions:
        if decision.day in at:
            panel.axvline(at[decision.day] + 0.5, color=_CHANGE_COLOUR, lw=0.8)
    hit = [at[entry.name] for entry in diary.days if entry.incident]
    heights = [days[number].raw_n for number in hit]
    panel.plot(hit, heights, ls='', marker='X', ms=10, color='black', label='incident')
    panel.set_yscale('log')
    every = max(len(days) // 12, 1)
    panel.set_xticks(range(0, len(days), every), [each.date for each in days[::every]])
    panel.tick_params(axis='x', rotation=30)
    panel.set_ylabel('drift of a force, N RMS')
    panel.grid(alpha=0.3)
    panel.legend(fontsize=8)
