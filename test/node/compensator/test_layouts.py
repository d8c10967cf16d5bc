"""What the live views show is there: every topic and field, on a running node."""

import json
from pathlib import Path
import xml.etree.ElementTree as ET

from geometry_msgs.msg import Vector3, Wrench, WrenchStamped
import pytest
from sensor_msgs.msg import Temperature

CONFIG = Path(__file__).parents[3] / 'config'
MESSAGES = {
    'geometry_msgs/msg/WrenchStamped': WrenchStamped,
    'geometry_msgs/Wrench': Wrench,
    'geometry_msgs/Vector3': Vector3,
    'sensor_msgs/msg/Temperature': Temperature,
}


def plotjuggler():
    root = ET.parse(CONFIG / 'plotjuggler.xml').getroot()  # noqa: S314 -- our own file
    return [curve.get('name') for curve in root.iterfind('.//Tab//plot/curve')]


def foxglove():
    layout = json.loads((CONFIG / 'foxglove.json').read_text(encoding='utf-8'))
    panels = [layout['configById'][name] for name in panels_of(layout['layout'])]
    paths = [path['value'] for panel in panels for path in panel.get('paths', ())]
    return [path.replace('.', '/') for path in paths]


def panels_of(mosaic):
    """Names of panels: a mosaic is one, or two halves."""
    if isinstance(mosaic, str):
        return [mosaic]
    return [*panels_of(mosaic['first']), *panels_of(mosaic['second'])]


@pytest.mark.parametrize('shown', [plotjuggler, foxglove])
def test_every_path_leads_to_a_number_of_the_node_s_topics(shown, rig):
    node = rig(thermometers=2).node
    name, namespace = node.get_name(), node.get_namespace()
    published = node.get_publisher_names_and_types_by_node(name, namespace)
    published += node.get_subscriber_names_and_types_by_node(name, namespace)
    topics = {topic.removeprefix(namespace): types[0] for topic, types in published}
    for path in shown():
        topic = max((t for t in topics if path.startswith(f'{t}/')), key=len)
        kind = topics[topic]
        for field in path.removeprefix(f'{topic}/').split('/'):
            kind = MESSAGES[kind].get_fields_and_field_types()[field]
        assert kind == 'double', path


@pytest.mark.parametrize('shown', [plotjuggler, foxglove])
def test_every_axis_is_shown_raw_compensated_and_with_its_drift(shown):
    paths = shown()
    for axis in (f'{kind}/{letter}' for kind in ('force', 'torque') for letter in 'xyz'):
        assert sum(path.endswith(f'/wrench/{axis}') for path in paths) == 3
    assert '/temperature/temperature' in paths
