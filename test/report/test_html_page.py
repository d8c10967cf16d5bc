"""The page is read as a browser would: its tags, its text, what it loads, its pictures."""

from dataclasses import astuple, replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
import re

import numpy as np
import pytest

from wrist_ft_comp.report.evaluation import judge_errors
from wrist_ft_comp.report.html_page import page, write_report
from wrist_ft_comp.report.report_content import calibration_content, evaluation_content
from wrist_ft_comp.series import rounded

VOID = {'meta', 'br', 'hr', 'img', 'link', 'input'}
KINDS = ('good', 'weak', 'none', 'evaluation', 'plateaus', 'work')
MAX_BYTES = 1_000_000
every_kind = pytest.mark.parametrize('kind', KINDS)


class Outline(HTMLParser):
    """Tags that must close, tags that were seen, text, ids, and what would be loaded."""

    def __init__(self, text):
        super().__init__()
        self.open, self.seen, self.text, self.loads, self.ids = [], [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.seen.append(tag)
        if tag not in VOID:
            self.open.append(tag)
        self.loads += [v for k, v in attributes if k in {'src', 'href', 'xlink:href', 'srcset'}]
        self.ids += [v for k, v in attributes if k == 'id']

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)

    @property
    def whole(self):
        """All text, with plain spaces."""
        return ' '.join(self.text).replace('\N{NO-BREAK SPACE}', ' ')


def brief(view):
    """Write a page of one axis: pictures take most of the time."""
    return page(replace(view, axes=view.axes[:1]))


@every_kind
def test_the_page_is_small_well_formed_and_loads_nothing(kind, text, view):
    outline = Outline(text(kind))
    assert not outline.open
    assert text(kind).startswith('<!doctype html>')
    assert len(text(kind).encode()) < MAX_BYTES
    assert len(outline.ids) == len(set(outline.ids))
    assert outline.seen.count('svg') == 1 + len(view(kind).axes)
    levels = [int(tag[1]) for tag in outline.seen if re.fullmatch(r'h\d', tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after - before <= 1 for before, after in pairwise(levels))
    assert not {'link', 'img', 'iframe', 'object'} & set(outline.seen)
    assert outline.seen.count('script') == 1
    assert all(target.startswith('#') for target in outline.loads)
    assert {target[1:] for target in outline.loads} <= set(outline.ids)
    links = set(re.findall(r'https?://[^"\s<]*', text(kind)))
    assert links <= {'http://www.w3.org/2000/svg', 'http://www.w3.org/1999/xlink'}
    assert '@import' not in text(kind)
    assert set(re.findall(r'url\(#?([^)]*)', text(kind))) <= set(outline.ids), 'clips of pictures'


def test_names_are_text_and_never_tags(text, view, make, judge):
    outline = Outline(text('good'))
    assert any(make.name in part for part in outline.text)
    assert 'Calibration of <i>model.yaml' in outline.text
    assert 'Something <odd> was left out.' in outline.text
    assert {'a' * 64, view('good').stored.sha256} <= set(map(str.strip, outline.text)), 'sources'
    assert not {'b', 'i', 'odd'} & set(outline.seen)
    assert b'?.csv' in brief(judge(make.recording('\udcff.csv'))).encode(errors='replace')


@every_kind
def test_every_axis_has_its_verdict_and_its_numbers(kind, text, view):
    whole = Outline(text(kind)).whole
    for axis in view(kind).axes:
        assert whole.count(axis.verdict.sentence) == 1
        for value in astuple(axis.errors):
            assert rounded(value) in whole
        for candidate in axis.entry['candidates']:
            assert rounded(candidate['rms']) in whole


def test_a_refused_axis_is_named_once_at_the_top(make, tmp_path):
    recordings = [make.recording()]
    calibration, stored = make.learn(recordings, tmp_path, method='pls')
    refusal = 'force_z drifts too slowly'
    fit = replace(calibration.fits['force_z'], model=None, refusal=refusal)
    fits = {**calibration.fits, 'force_z': fit}
    warnings = f'{refusal}. It is left.', 'Something else.'
    refused = replace(calibration, fits=fits, warnings=warnings)
    view = calibration_content(refused, recordings, stored)
    assert view.warnings == ('Something else.',)
    axis = next(axis for axis in view.axes if axis.axis == 'force_z')
    assert axis.verdict.level == 'uncalibrated'
    assert axis.verdict.sentence.startswith(refusal)
    assert Outline(page(replace(view, axes=(axis,)))).whole.count(refusal) == 1


def test_a_program_writes_a_report_and_the_answer_of_a_service_has_its_lines(make, tmp_path):
    recordings = [make.recording('monday.csv')]
    calibration, stored = make.learn(recordings, tmp_path, method='pls')
    write_report(tmp_path / 'r.html', stored, calibration, recordings)
    whole = Outline((tmp_path / 'r.html').read_text()).whole
    lines = calibration_content(calibration, recordings, stored).lines()
    assert lines[0].startswith('force_x: good. ')
    advice = [line.removeprefix('next: ') for line in lines if line.startswith('next: ')]
    assert len(advice) == 3
    assert all(sentence in whole for sentence in advice)


def test_a_page_says_what_was_held_out_and_what_the_figures_are(text, view):
    for kind, parts in (('good', 2), ('weak', 3), ('plateaus', 8)):
        assert f'Each of {parts} parts was predicted' in text(kind)
    alone = 'before: RMS in parts of 22 min. left: RMS, enlarged to a day.'
    assert alone in Outline(text('weak')).whole
    for kind in ('good', 'plateaus', 'evaluation', 'work'):
        assert view(kind).footer.startswith('before, left: root mean square.')
    for kind in KINDS:
        dashes = any(row[-1] == '–' for row in view(kind).rows)
        assert view(kind).footer.endswith('–: not known, record another day.') == dashes


def test_an_evaluation_marks_the_recordings_that_were_learnt_from(view, text):
    assert view('evaluation').titles[-2:] == ('peak left', 'limit')
    peaks = [rounded(axis.errors.max_after) for axis in view('evaluation').axes]
    assert [row[-2] for row in view('evaluation').rows] == peaks
    names = [day.name for day in view('evaluation').recordings]
    for axis in view('evaluation').axes:
        assert axis.entry['chosen'].startswith('pls')
        spreads = axis.entry['time_constant_errors_s']
        assert len(spreads) == len(axis.entry['time_constants_s'])
        assert [name for name, *_ in axis.parts] == names
        squares = np.square([left for *_, left in axis.parts])
        assert np.sqrt(squares.mean()) == pytest.approx(axis.errors.rms_after)
    whole = Outline(text('evaluation')).whole
    assert whole.count('Recording by recording') == len(view('evaluation').axes)
    assert 'Recording by recording' not in Outline(text('good')).whole


@pytest.fixture
def judge(make, stored):
    def build(recording, **changes):
        evaluated = replace(make.evaluated(stored, recording), **changes)
        return evaluation_content(stored, [evaluated], 60, [Path('day.csv')], stored.topics)

    return build


def test_four_hours_at_a_cell_a_second_are_no_larger_and_have_own_numbers(make, stored, judge):
    recording = make.recording('other.csv', 5, cells=14_400, axes=6)
    view = judge(recording)
    assert len(page(view).encode()) < MAX_BYTES
    expected = judge_errors([make.evaluated(stored, recording).errors])
    assert {axis.axis: axis.errors for axis in view.axes} == expected


def test_standard_errors_are_shown_where_there_are_any(view):
    entry = {'time_constants_s': [60.0, 7200.0], 'time_constant_errors_s': [3.0, None]}
    first = view('good').axes[0]
    shown = replace(view('good'), axes=(replace(first, entry={**first.entry, **entry}),))
    assert '60 ± 3 s, 7200 s' in Outline(page(shown)).whole


def test_a_robot_at_work_has_its_payloads_and_what_was_used_on_the_page(text, view):
    whole, work = Outline(text('work')).whole, view('work')
    tool, both = work.payloads.payloads.values()
    assert f'{tool.mass_kg:.3f} ± ' in whole
    assert f'{1e3 * both.center_m[2]:.1f} ± ' in whole
    used, pushed = (int(share) for share in re.findall(r'(\d+)%', work.at_work))
    assert 50 < used <= 100 - pushed < 95
    assert work.at_work.partition('. ')[0] in whole
    assert 'No payload could be identified' in Outline(brief(replace(work, payloads=None))).whole
