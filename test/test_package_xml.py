"""package.xml and setup.py name what the code imports, and say the same."""

import ast
from pathlib import Path
import re
import sys
from xml.etree import ElementTree

import wrist_ft_comp

ROOT = Path(__file__).parents[1]
MANIFEST = ElementTree.parse(ROOT / 'package.xml').getroot()  # noqa: S314 -- our own file
#: What rosdep calls ``python3-`` and the name that is imported.
PREFIXED = {
    'hypothesis', 'jinja2', 'jsonschema', 'matplotlib', 'numpy', 'pandas', 'pytest', 'rich',
    'scipy', 'sklearn', 'yaml',
}  # fmt: skip
#: Used where they are there, from pip only; and what comes with rclpy's message packages.
NOT_DECLARED = {'rosbags', 'openpyxl', 'pyarrow', 'rosidl_generator_py'}
#: Loaded by name: storages by rosbag2_py, and the messages of TF.
PLUGINS = {
    'rosbag2_compression_zstd', 'rosbag2_storage_mcap', 'rosbag2_storage_sqlite3', 'tf2_msgs',
}  # fmt: skip


def imported(folder):
    """Keys of rosdep of what a folder's modules import from elsewhere."""
    roots: set[str] = set()
    for path in (ROOT / folder).rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text('utf-8'))):
            if isinstance(node, ast.Import):
                roots |= {alias.name.split('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                roots.add(str(node.module).split('.')[0])
    ours = {path.stem for of in ('test', 'examples') for path in (ROOT / of).rglob('*.py')}
    foreign = roots - set(sys.stdlib_module_names) - ours - NOT_DECLARED - {'wrist_ft_comp'}
    return {f'python3-{root}' if root in PREFIXED else root for root in foreign}


def declared(*tags):
    return {str(element.text) for tag in tags for element in MANIFEST.iter(tag)}


def test_imports_and_dependencies_are_the_same():
    needed = declared('exec_depend')
    assert imported('wrist_ft_comp') | imported('launch') | PLUGINS == needed
    assert imported('test') <= needed | declared('test_depend')
    # A key that needs pip keeps a package out of the ROS distribution.
    assert not [key for key in needed | declared('test_depend') if key.endswith('-pip')]


def test_version_and_licence_are_written_the_same_everywhere():
    setup = (ROOT / 'setup.py').read_text('utf-8')
    match = re.search(r"version='(.*)'", setup)
    assert match is not None
    assert MANIFEST.findtext('version') == match[1] == wrist_ft_comp.__version__
    assert f'\n{match[1]} (' in (ROOT / 'CHANGELOG.rst').read_text('utf-8')
    assert f"license='{MANIFEST.findtext('license')}'" in setup
    assert (ROOT / 'LICENSE').read_text('utf-8').split()[:2] == ['Apache', 'License']
    assert MANIFEST.findtext('export/build_type') == 'ament_python'
