"""Pictures of drift without and with compensation, readable by colour-blind people."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from wrist_ft_comp import RecordingError
from wrist_ft_comp.core.recording import FloatArray

# Okabe and Ito's palette: distinguishable with every common colour deficiency, and in grey.
RAW_COLOUR = '#D55E00'
COMPENSATED_COLOUR = '#0072B2'
_TEMPERATURE_COLOURS = ('#009E73', '#CC79A7', '#E69F00', '#56B4E9')
_POINTS = 4000


@dataclass(frozen=True, eq=False)
class DriftSeries:
    """
    One axis over time.

    Attributes
    ----------
    title : str
        Name of the axis, with its unit.
    elapsed_s : ndarray, shape (n,)
        Time, s.
    raw, compensated : ndarray, shape (n,)
        What is left without and with compensation, N or N m.

    """

    title: str
    elapsed_s: FloatArray
    raw: FloatArray
    compensated: FloatArray


@dataclass(frozen=True, eq=False)
class TemperatureSeries:
    """
    One thermometer over time.

    Attributes
    ----------
    title : str
        Its name.
    elapsed_s, temperature_c : ndarray, shape (n,)
        Time, s, and temperature, °C.

    """

    title: str
    elapsed_s: FloatArray
    temperature_c: FloatArray


def draw_drift(
    axes: Sequence[DriftSeries],
    temperatures: Sequence[TemperatureSeries],
    marks: Mapping[str, float] | None = None,
) -> Figure:
    """
    Draw every axis over time, without and with compensation, above the temperatures.

    Parameters
    ----------
    axes : sequence of DriftSeries
        One panel each, two beside each other.
    temperatures : sequence of TemperatureSeries
        The last panel.
    marks : mapping of str to float, optional
        Times to mark, s, by their names.

    Returns
    -------
    Figure
        For save_png.

    """
    rows = -(-len(axes) // 2) + 1
    figure = Figure(figsize=(10.0, 2.2 * rows), layout='constrained')
    grid = figure.add_gridspec(rows, 2)
    for number, series in enumerate(axes):
        panel = figure.add_subplot(grid[number // 2, number % 2])
        every = slice(None, None, max(len(series.elapsed_s) // _POINTS, 1))
        hours = series.elapsed_s[every] / 3600
        panel.plot(hours, series.raw[every], color=RAW_COLOUR, lw=1.0, label='without')
        panel.plot(
            hours, series.compensated[every], color=COMPENSATED_COLOUR, lw=1.0, label='with'
        )
        panel.set_title(series.title, fontsize=10)
        if number == 0:
            panel.legend(title='compensation', fontsize=8, title_fontsize=8)
        _decorate(panel, marks or {})
    panel = figure.add_subplot(grid[rows - 1, :])
    for thermometer, colour in zip(temperatures, _TEMPERATURE_COLOURS * 25, strict=False):
        every = slice(None, None, max(len(thermometer.elapsed_s) // _POINTS, 1))
        panel.plot(
            thermometer.elapsed_s[every] / 3600,
            thermometer.temperature_c[every],
            color=colour,
            label=thermometer.title,
        )
    panel.set_title('temperature, °C', fontsize=10)
    panel.set_xlabel('time, h')
    panel.legend(fontsize=8)
    _decorate(panel, marks or {})
    return figure


def _decorate(panel: Axes, marks: Mapping[str, float]) -> None:
    """Add grid lines and marks."""
    panel.grid(alpha=0.3)
    for name, at_s in marks.items():
        panel.axvline(at_s / 3600, color='0.4', lw=1.0, ls='--')
        panel.annotate(
            name,
            (at_s / 3600, 1.0),
            xycoords=('data', 'axes fraction'),
            xytext=(3, -9),
            textcoords='offset points',
            fontsize=7,
            color='0.3',
        )


def save_png(path: Path, figure: Figure) -> None:
    """
    Save a picture.

    Parameters
    ----------
    path : Path
        Target.
    figure : Figure
        What to save.

    Raises
    ------
    RecordingError
        When the file cannot be written.

    """
    FigureCanvasAgg(figure)
    try:
        figure.savefig(path, dpi=120)
    except OSError as error:
        raise RecordingError(f'{path} cannot be written: {error.strerror}.') from error
