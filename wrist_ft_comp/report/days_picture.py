"""The picture of a diary: the drift of every day, and what was left of it."""

from matplotlib.figure import Figure
import numpy as np

from wrist_ft_comp.learning.entry import Diary, forces_left
from wrist_ft_comp.report.days import date_of
from wrist_ft_comp.report.pictures import COMPENSATED_COLOUR, png_bytes, RAW_COLOUR

#: Colour, line, marker and label of what forces_left gives.
_STYLES = (
    (RAW_COLOUR, '--', 'x', 'no model'),
    (COMPENSATED_COLOUR, '-', 'o', 'live model'),
    ('#009E73', '', '^', 'challenger'),
)


def days_png(diary: Diary) -> bytes:
    """Draw the drift left per day; lines are changes of the live model, crosses incidents."""
    figure = Figure(figsize=(10.0, 4.0), layout='constrained')
    panel = figure.add_subplot()
    left = np.array([forces_left(entry) for entry in diary.days])
    for values, (colour, line, marker, label) in zip(left.T, _STYLES, strict=True):
        panel.plot(values, color=colour, ls=line, marker=marker, ms=4, label=label)
    at = {entry.name: number for number, entry in enumerate(diary.days)}
    for decision in diary.decisions:
        if decision.day in at:
            panel.axvline(at[decision.day] + 0.5, color='#999999', lw=0.8)
    hit = [at[entry.name] for entry in diary.days if entry.incident]
    panel.plot(hit, left[hit, 0], ls='', marker='X', ms=10, color='black', label='incident')
    panel.set_yscale('log')
    every = slice(None, None, max(len(at) // 12, 1))
    panel.set_xticks(range(len(at))[every], [date_of(each) for each in diary.days[every]])
    panel.tick_params(axis='x', rotation=30)
    panel.set_ylabel('drift of a force, N RMS')
    panel.grid(alpha=0.3)
    panel.legend(fontsize=8)
    return png_bytes(figure)
