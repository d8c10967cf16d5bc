"""package.xml and setup.py name what the code imports, and say the same."""

import ast
from pathlib import Path
import re
import sys
from xml.etree import ElementTree

import pytest

import wrist_ft_comp

ROOT = Path(__file__).parents[1]
MANIFEST = ElementTree.parse(ROOT / 'package.xml').getroot()  # noqa: S314 -- our own file
SETUP = (ROOT / 'setup.py').read_text('utf-8')
#: rosdep's key by the name that is imported, where it isn't the same.
KEYS = {
    'hypothesis': 'python3-hypothesis',
    'jinja2': 'python3-jinja2',
    'jsonschema': 'python3-jsonschema',
    'matplotlib': 'python3-matplotlib',
    'numpy': 'python3-numpy',
    'pytest': 'python3-pytest',
    'scipy': 'python3-scipy',
    'sklearn': 'python3-sklearn',
    'tqdm': 'python3-tqdm',
    'yaml': 'python3-yaml',
}
#: Comes with rclpy's message packages; only named to quieten a warning of its own.
NOT_IMPORTED_BY_US = {'rosidl_generator_py'}
#: Used where they are there; from pip only, and so no dependency of a released package.
OPTIONAL = {'rosbags', 'shtab'}
#: Loaded by rosbag2_py, by name.
PLUGINS = {'rosbag2_compression_zstd', 'rosbag2_storage_mcap', 'rosbag2_storage_sqlite3'}
#: Keys that rosdep finds in apt of Ubuntu 24.04: by its base.yaml and python.yaml, and packages
#: that are released into ROS 2 Jazzy.
APT = {
    'python3-hypothesis', 'python3-jinja2', 'python3-jsonschema', 'python3-matplotlib',
    'python3-numpy', 'python3-pytest', 'python3-scipy', 'python3-sklearn', 'python3-tqdm',
    'python3-yaml',
}  # fmt: skip
RELEASED = {
    'ament_index_python', 'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs',
    'rcl_interfaces', 'rclpy', 'rosbag2_compression_zstd', 'rosbag2_py', 'rosbag2_storage_mcap',
    'rosbag2_storage_sqlite3', 'rosgraph_msgs', 'sensor_msgs', 'std_msgs', 'std_srvs',
    'stereo_msgs',
}  # fmt: skip


def imported(folder):
    """Keys of what a folder's modules import from elsewhere."""
    roots: set[str] = set()
    for path in (ROOT / folder).rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text('utf-8'))):
            if isinstance(node, ast.Import):
                roots |= {alias.name.split('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                roots.add(str(node.module).split('.')[0])
    ours = {'wrist_ft_comp', *(path.stem for path in (ROOT / 'test').rglob('*.py'))}
    foreign = roots - set(sys.stdlib_module_names) - ours - NOT_IMPORTED_BY_US
    return {KEYS.get(root, root) for root in foreign}


def declared(*tags):
    return {str(each.text) for tag in tags for each in MANIFEST.iter(tag)}


def test_what_the_package_imports_is_what_it_depends_on():
    assert imported('wrist_ft_comp') - OPTIONAL == declared('exec_depend') - PLUGINS
    assert declared('exec_depend') >= PLUGINS


def test_every_dependency_comes_by_apt():
    """A package with a key that needs pip cannot be released into the ROS distribution."""
    tags = {each.tag for each in MANIFEST} & {
        'depend', 'exec_depend', 'test_depend', 'build_depend', 'buildtool_depend',
    }  # fmt: skip
    assert declared(*tags) <= APT | RELEASED
    assert not {key for key in declared(*tags) if 'pip' in key}


def test_what_the_tests_import_is_named_for_them():
    assert imported('test') - OPTIONAL <= declared('exec_depend', 'test_depend')


def test_the_version_is_written_the_same_everywhere():
    match = re.search(r"version='(.*)'", SETUP)
    assert match is not None
    assert MANIFEST.findtext('version') == match[1] == wrist_ft_comp.__version__
    assert f'\n{match[1]} (' in (ROOT / 'CHANGELOG.rst').read_text('utf-8')


@pytest.mark.parametrize('tag', ['description', 'license', 'maintainer', 'name'])
def test_what_rep_149_demands_is_there(tag):
    assert MANIFEST.get('format') == '3'
    assert (MANIFEST.findtext(tag) or '').strip()
    assert MANIFEST.findtext('export/build_type') == 'ament_python'


def test_the_licence_is_the_one_that_is_named():
    licence = MANIFEST.find('license')
    assert licence is not None
    text = (ROOT / str(licence.get('file'))).read_text('utf-8')
    assert text.split()[:2] == ['Apache', 'License']
    assert f"license='{licence.text}'" in SETUP
