"""
The report in a real browser: nothing complains, nothing is cut off, nothing is pale.

Chromium is installed by .ci/run; elsewhere these are skipped where it is missing.
"""

import re

from chromium import Browser, CHROMIUM
import pytest

KINDS = ('good', 'weak', 'none', 'evaluation', 'plateaus')

#: Everything that sticks out to the right of the window, or of a box that hides what does.
CUT_OFF = """
(() => {
  const wide = document.documentElement.clientWidth + 0.5;
  const bad = [];
  for (const node of document.querySelectorAll('body *')) {
    const box = node.getBoundingClientRect();
    if (box.right > wide || box.left < -0.5) bad.push(['sticks out', node.tagName, box.right]);
    if (node.namespaceURI.endsWith('svg')) continue;
    const style = getComputedStyle(node);
    const hides = style.overflowX !== 'visible' || style.textOverflow !== 'clip';
    if (hides && node.scrollWidth > node.clientWidth + 1) bad.push(['hides', node.tagName]);
  }
  return bad;
})()
"""

#: Text of pictures that leaves its picture, is smaller than people can read, or covers other text.
PICTURE_TEXT = """
(() => {
  const bad = [];
  for (const picture of document.querySelectorAll('svg')) {
    const frame = picture.getBoundingClientRect();
    if (frame.width < 200 || frame.height < 100) bad.push(['small', frame.width, frame.height]);
    for (const text of picture.querySelectorAll('text')) {
      const box = text.getBoundingClientRect();
      const outside = box.left < frame.left - 1 || box.right > frame.right + 1
        || box.top < frame.top - 1 || box.bottom > frame.bottom + 1;
      if (outside || Math.max(box.height, box.width) < 5) bad.push([text.textContent, box.left]);
      const size = parseFloat(getComputedStyle(text).fontSize) * frame.width
        / picture.viewBox.baseVal.width;
      if (size < 9) bad.push(['tiny', text.textContent, size]);
    }
    const boxes = [...picture.querySelectorAll('text')].map(
      (text) => [text.textContent, text.getBoundingClientRect()]);
    boxes.forEach(([name, one], i) => boxes.slice(i + 1).forEach(([other, two]) => {
      const across = Math.min(one.right, two.right) - Math.max(one.left, two.left);
      const down = Math.min(one.bottom, two.bottom) - Math.max(one.top, two.top);
      if (across > 1 && down > 3) bad.push([name, other]);
    }));
  }
  return bad;
})()
"""

#: WCAG's contrast of every text, and of every line and mark of the pictures, with its paper.
PALE = """
(() => {
  const channel = (v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
  const parts = (colour) => colour.match(/[\\d.]+/g).map(Number);
  const luminance = (colour) => parts(colour).slice(0, 3).map((v) => channel(v / 255))
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const paper = (node) => {
    for (let at = node; at; at = at.parentElement) {
      const colour = getComputedStyle(at).backgroundColor;
      if (!(parts(colour)[3] === 0)) return colour;
    }
    return 'rgb(255, 255, 255)';
  };
  const contrast = (one, two) => {
    const [a, b] = [luminance(one), luminance(two)].sort((x, y) => y - x);
    return (a + 0.05) / (b + 0.05);
  };
  const bad = [];
  let seen = 0;
  for (const node of document.querySelectorAll('body *')) {
    const own = [...node.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
    if (!own || node.tagName.toLowerCase() === 'style') continue;
    seen += 1;
    const style = getComputedStyle(node);
    const ink = node.namespaceURI.endsWith('svg') ? style.fill : style.color;
    const value = contrast(ink, paper(node));
    if (value < 4.5) bad.push([node.textContent.slice(0, 30), ink, paper(node), value]);
  }
  for (const line of document.querySelectorAll('svg path, svg use')) {
    const { stroke, strokeOpacity } = getComputedStyle(line);
    if (stroke === 'none' || strokeOpacity < 1) continue;
    const value = contrast(stroke, paper(line));
    if (value < 3) bad.push([stroke, paper(line), value]);
  }
  return { bad, seen };
})()
"""


@pytest.fixture(scope='module')
def browser(tmp_path_factory):
    if CHROMIUM is None:
        pytest.skip('there is no chromium here; on Debian, apt install chromium')
    started = Browser(tmp_path_factory.mktemp('profile'))
    yield started
    started.close()


@pytest.fixture(scope='module')
def files(text, tmp_path_factory):
    folder = tmp_path_factory.mktemp('pages')

    def path_of(kind):
        (folder / f'{kind}.html').write_text(text(kind), encoding='utf-8')
        return folder / f'{kind}.html'

    return path_of


#: Shows what is folded.
UNFOLD = "document.querySelectorAll('details').forEach((folded) => { folded.open = true; })"


# Nothing depends on width and scheme together.
@pytest.mark.parametrize(('width', 'scheme'), [(1280, 'light'), (400, 'dark')])
@pytest.mark.parametrize('kind', KINDS)
def test_the_page_is_whole_legible_and_without_complaints(kind, width, scheme, browser, files):
    browser.open(files(kind), width, scheme)
    assert browser.complaints() == []
    folded = browser.evaluate('document.documentElement.scrollHeight')
    assert folded <= 3 * 1080
    browser.evaluate(UNFOLD)
    assert browser.evaluate('document.compatMode') == 'CSS1Compat'
    assert browser.evaluate('innerWidth') == width
    assert browser.evaluate('document.documentElement.scrollWidth') <= width
    assert browser.evaluate(CUT_OFF) == []
    assert browser.evaluate("document.querySelectorAll('svg text').length") > 20
    assert browser.evaluate(PICTURE_TEXT) == []
    contrast = browser.evaluate(PALE)
    assert contrast['seen'] > 50
    assert contrast['bad'] == []


@pytest.mark.parametrize('kind', KINDS)
def test_the_page_prints(kind, browser, files):
    browser.open(files(kind), 1280, 'dark')
    assert browser.pdf().startswith(b'%PDF')
    paper = browser.evaluate('getComputedStyle(document.body).backgroundColor')
    assert paper == 'rgb(255, 255, 255)'
    assert browser.evaluate(CUT_OFF) == []


def test_hover_shows_time_and_value_and_a_click_copies_what_to_exclude(browser, files):
    browser.open(files('good'), 1280)
    x, y = browser.evaluate("""(() => {
      const picture = document.querySelector('svg[data-plot]');
      picture.scrollIntoView({block: 'center'});
      const box = picture.getBoundingClientRect();
      return [box.left + box.width * 0.6, box.top + box.height / 2];
    })()""")
    browser.send('Input.dispatchMouseEvent', type='mouseMoved', x=x, y=y)
    said = browser.evaluate("document.querySelector('output').textContent")
    assert re.match(r'\d:\d\d:\d\d: \S+ N \(without compensation \S+\)', said)
    for kind in ('mousePressed', 'mouseReleased'):
        browser.send('Input.dispatchMouseEvent', type=kind, x=x, y=y, button='left', clickCount=1)
    said = browser.evaluate("document.querySelector('output').textContent")
    begin, end = map(int, re.fullmatch(r'--exclude (\d+)\.\.(\d+)', said).groups())
    assert end - begin == 60
    assert browser.evaluate('String(getSelection())') == said


def test_the_checks_can_fail(browser, tmp_path):
    page = tmp_path / 'bad.html'
    page.write_text(
        '<!doctype html><body style="background:#fff"><script>oops()</script>'
        '<p style="width:3000px;color:#ccc">pale</p><svg width="300" height="200" '
        'viewBox="0 0 300 200"><text x="290" y="20">outside</text><text x="5" y="50">on</text>'
        '<text x="7" y="52">top</text></svg>',
        encoding='utf-8',
    )
    browser.open(page, 400)
    assert browser.complaints()
    assert browser.evaluate(CUT_OFF)
    said = browser.evaluate(PICTURE_TEXT)
    assert 'outside' in [name for name, *_ in said]
    assert ['on', 'top'] in said
    assert browser.evaluate(PALE)['bad']
