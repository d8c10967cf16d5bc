"""The layouts of PlotJuggler and Foxglove are whole, as these tools read them."""

import json
from pathlib import Path
import xml.etree.ElementTree as ET

CONFIG = Path(__file__).parent.parent / 'config'


def test_plotjuggler_finds_tabs_docks_and_plots():
    root = ET.parse(CONFIG / 'plotjuggler.xml').getroot()  # noqa: S314 -- our own file
    assert root.tag == 'root'
    (tabs,) = root.findall('tabbed_widget')
    assert [tab.get('tab_name') for tab in tabs.findall('Tab')] == ['force', 'torque']
    for tab in tabs.findall('Tab'):
        containers = tab.findall('Container')
        assert len(containers) == int(tab.get('containers'))
        for splitter in tab.iter('DockSplitter'):
            assert splitter.get('orientation') in {'-', '|'}
            sizes = [float(size) for size in splitter.get('sizes').split(';')]
            assert len(sizes) == len(splitter) == int(splitter.get('count'))
            assert sum(sizes) == 1
        for plot in tab.iter('plot'):
            assert plot.get('mode') == 'TimeSeries'
            assert set(plot.find('range').attrib) == {'left', 'right', 'top', 'bottom'}
            assert plot.findall('curve')


def leaves(node):
    """Panels of a mosaic: a name, or two halves."""
    if isinstance(node, str):
        yield node
        return
    assert set(node) == {'direction', 'first', 'second', 'splitPercentage'}
    assert node['direction'] in {'row', 'column'}
    assert 0 < node['splitPercentage'] < 100
    yield from leaves(node['first'])
    yield from leaves(node['second'])


def test_foxglove_finds_every_panel_once():
    layout = json.loads((CONFIG / 'foxglove.json').read_text(encoding='utf-8'))
    shown = list(leaves(layout['layout']))
    assert sorted(shown) == sorted(layout['configById'])
    assert len(shown) == 8
    for name, panel in layout['configById'].items():
        kind, _, key = name.partition('!')
        assert key
        if kind == 'Plot':
            assert panel['xAxisVal'] == 'timestamp'
            assert all(path['timestampMethod'] == 'headerStamp' for path in panel['paths'])
        else:
            assert (kind, panel['topicToRender']) == ('DiagnosticSummary', '/diagnostics')
