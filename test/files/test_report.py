"""The page is looked at as a browser would: its tags, its text, what it loads, its pictures."""

import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import numpy as np
import pytest

from wrist_ft_comp import RecordingError
from wrist_ft_comp.core.calibration import CalibrationSettings, calibrate
from wrist_ft_comp.core.chamber_fit import ChamberFigures
from wrist_ft_comp.core.evaluation import evaluate
from wrist_ft_comp.core.identification import IdentificationSettings
from wrist_ft_comp.core.recording import AXES, Recording
from wrist_ft_comp.files import atomic
from wrist_ft_comp.files.model_file import save_model
from wrist_ft_comp.files.report import ReportedRecording, write_report

VOID = {'meta', 'br', 'hr', 'img', 'link', 'input'}
NAME = '<b>.csv & "quotes"'


def make_recording(name=NAME, seed=0, cells=200):
    rng = np.random.default_rng(seed)
    temperature = 20 + 10 * (1 - np.exp(-np.arange(cells) / 60)) + rng.normal(0, 0.01, cells)
    gains = np.arange(1, 7)
    wrench = np.outer(temperature - 20, gains) + rng.normal(0, 0.01, (cells, 6))
    return Recording(
        name=name,
        period_ns=10**9,
        first_cell=0,
        temperature_c=temperature[:, np.newaxis],
        measured=np.ones((cells, 1), dtype=bool),
        wrench=wrench,
        reference=np.full((cells, 6), np.nan),
        warnings=('Something <odd> was left out.',),
    )


@pytest.fixture(scope='module')
def stored(tmp_path_factory):
    settings = CalibrationSettings(identification=IdentificationSettings(method='pls'))
    found = calibrate([make_recording()], settings)
    return save_model(tmp_path_factory.mktemp('model') / '<i>model.yaml', found, {})


@pytest.fixture(scope='module')
def page(stored, tmp_path_factory):
    """A report on two recordings, as text."""
    path = tmp_path_factory.mktemp('report') / 'report.html'
    figures = {'raw': ChamberFigures(0.1, 2.0, 3.0, 4.0)}
    reported = [
        ReportedRecording(make_recording(), 'unloaded'),
        ReportedRecording(make_recording('second.csv', 1), 'constant', figures),
    ]
    write_report(path, stored, reported)
    return path.read_text(encoding='utf-8')


class Outline(HTMLParser):
    """Tags that must close, tags that were seen, text, and what would be loaded."""

    def __init__(self, text):
        super().__init__()
        self.open, self.seen, self.text, self.loads = [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.seen.append(tag)
        if tag not in VOID:
            self.open.append(tag)
        self.loads += [v for k, v in attributes if k in {'src', 'href', 'xlink:href', 'srcset'}]

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def test_every_tag_is_closed_where_it_was_opened(page):
    outline = Outline(page)
    assert not outline.open
    assert page.startswith('<!doctype html>')
    assert outline.seen.count('svg') == 2


def test_the_page_loads_nothing(page):
    outline = Outline(page)
    assert not {'script', 'link', 'img', 'iframe', 'object'} & set(outline.seen)
    assert all(target.startswith('#') for target in outline.loads)
    links = set(re.findall(r'https?://[^"\s<]*', page))
    assert links <= {'http://www.w3.org/2000/svg', 'http://www.w3.org/1999/xlink'}
    assert '@import' not in page
    assert set(re.findall(r'url\((.)', page)) <= {'#'}


def test_names_are_text_and_never_tags(page):
    outline = Outline(page)
    assert NAME in outline.text
    assert '<i>model.yaml' in outline.text
    assert 'Something <odd> was left out.' in outline.text
    assert not {'b', 'i', 'odd'} & set(outline.seen)


def test_every_axis_is_in_tables_and_pictures(page):
    outline = Outline(page)
    for axis in AXES:
        assert outline.text.count(axis) >= 3  # evidence and one table per recording
        assert page.count(f'<!-- {axis}, ') == 2  # a panel's title in each picture


def test_pictures_are_xml_and_share_no_id(page):
    pictures = re.findall(r'<svg.*?</svg>', page, re.DOTALL)
    ids = [
        node.get('id')
        for picture in pictures
        for node in ET.fromstring(picture).iter()  # noqa: S314 -- our own text
        if node.get('id')
    ]
    assert len(pictures) == 2
    assert len(set(ids)) == len(ids)


def test_the_numbers_are_those_of_the_evaluation(page, stored):
    outline = Outline(page)
    judged = evaluate(stored.model, make_recording('second.csv', 1), 'constant')
    for axis in AXES:
        numbers = judged[axis]
        assert f'{numbers.rms_before:.4g}' in outline.text
        assert f'{numbers.max_after:.4g}' in outline.text


def test_figures_of_a_chamber_table_are_shown(page):
    text = Outline(page).text
    assert 'max sensitivity drift' in text
    assert '0.1000' in text


def test_what_cannot_be_compared_is_said(stored, tmp_path):
    path = tmp_path / 'r.html'
    write_report(path, stored, [ReportedRecording(make_recording(), 'recorded')])
    outline = Outline(path.read_text())
    assert NAME in outline.text
    assert any('no cell with both' in text for text in outline.text)


def test_names_that_are_no_text_do_not_stop_the_report(stored, tmp_path):
    path = tmp_path / 'r.html'
    write_report(path, stored, [ReportedRecording(make_recording('\udcff.csv'), 'unloaded')])
    assert '?.csv' in path.read_text(encoding='utf-8')


def test_an_old_report_is_replaced_and_nothing_else_is_left(stored, tmp_path):
    path = tmp_path / 'r.html'
    path.write_text('old')
    write_report(path, stored, [])
    assert Outline(path.read_text()).seen[0] == 'html'
    assert [each.name for each in tmp_path.iterdir()] == ['r.html']


def test_a_failure_keeps_the_old_report(stored, tmp_path, monkeypatch):
    path = tmp_path / 'r.html'
    path.write_text('old')

    def full(_):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(atomic, 'sync', full)
    with pytest.raises(RecordingError, match='No space left'):
        write_report(path, stored, [])
    assert path.read_text() == 'old'
    assert [each.name for each in tmp_path.iterdir()] == ['r.html']


def test_a_missing_folder_is_a_sentence(stored, tmp_path):
    with pytest.raises(RecordingError, match='cannot be written'):
        write_report(tmp_path / 'no' / 'r.html', stored, [])
