from matplotlib import colors
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.image import imread
import numpy as np
import pytest

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.report import pictures
from wrist_ft_comp.report.pictures import draw_drift, DriftSeries, save_png, TemperatureSeries

DRAWN = (pictures.RAW_COLOUR, pictures.COMPENSATED_COLOUR)


def figure(axes=3, points=200, title='force'):
    t = np.linspace(0, 7200, points)
    series = [DriftSeries(f'{title} {k}', t, t / 100 + k, np.sin(t / 500)) for k in range(axes)]
    temperatures = [
        TemperatureSeries('temperature_c', t, 20 + t / 600),
        TemperatureSeries('temperature_2_c', t, 22 + t / 900),
    ]
    return draw_drift(series, temperatures)


def pixels(image, colour):
    """How many pixels have a colour."""
    return int(np.count_nonzero(np.abs(image[..., :3] - colors.to_rgb(colour)).max(axis=-1) < 0.1))


def panel_images(drawn, image):
    """The pixels of every panel."""
    height, width = image.shape[:2]
    for panel in drawn.axes:
        x0, y0, x1, y1 = panel.get_position().extents
        rows = slice(int((1 - y1) * height), int((1 - y0) * height))
        yield image[rows, int(x0 * width) : int(x1 * width)]


@pytest.mark.parametrize('axes', [1, 2, 6])
def test_every_panel_of_the_png_shows_both_lines(axes, tmp_path):
    drawn = figure(axes)
    save_png(tmp_path / 'a.png', drawn)
    image = imread(tmp_path / 'a.png')
    *drifts, temperatures = panel_images(drawn, image)
    assert len(drifts) == axes
    for part in drifts:
        assert all(pixels(part, colour) > 50 for colour in DRAWN)
    for colour in ('#009E73', '#CC79A7'):
        assert pixels(temperatures, colour) > 50


def test_colours_differ_in_grey_too():
    """Luminance as a black-and-white printer shows it."""
    grey = [np.dot(colors.to_rgb(colour), (0.2126, 0.7152, 0.0722)) for colour in DRAWN]
    assert len(set(DRAWN)) == 2
    assert abs(grey[0] - grey[1]) > 0.05


def test_panels_are_named_and_axes_have_units():
    drawn = figure(2)
    titles = [panel.get_title() for panel in drawn.axes]
    assert titles == ['force 0', 'force 1', 'temperature, °C']
    assert drawn.axes[-1].get_xlabel() == 'time, h'
    legend = [text.get_text() for text in drawn.axes[0].get_legend().get_texts()]
    assert legend == ['without', 'with']


def test_long_recordings_are_thinned_out_but_not_to_a_sketch():
    drawn = figure(1, points=50_000)
    assert 4_000 <= len(drawn.axes[0].lines[0].get_xdata()) < 10_000


def test_more_thermometers_than_colours_are_all_drawn():
    t = np.arange(10.0)
    drawn = draw_drift([], [TemperatureSeries(str(j), t, t + j) for j in range(9)])
    assert len(drawn.axes[-1].lines) == 9


def test_a_folder_that_is_missing_is_a_sentence(tmp_path):
    with pytest.raises(RecordingError, match='cannot be written'):
        save_png(tmp_path / 'no' / 'a.png', figure(1))


def test_drawing_does_not_change_the_series():
    t = np.arange(5.0)
    series = DriftSeries('a', t, t.copy(), t.copy())
    FigureCanvasAgg(draw_drift([series], [TemperatureSeries('b', t, t.copy())])).draw()
    np.testing.assert_array_equal(series.raw, np.arange(5.0))
