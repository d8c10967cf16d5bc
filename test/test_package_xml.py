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
    'rosbags': 'python3-rosbags-pip',
    'scipy': 'python3-scipy',
    'sklearn': 'python3-sklearn',
    'tqdm': 'python3-tqdm',
    'yaml': 'python3-yaml',
}
#: Comes with rclpy's message packages; only named to quieten a warning of its own.
NOT_IMPORTED_BY_US = {'rosidl_generator_py'}
#: Asked for by one command only, which says how to get it; there is no rosdep key.
OPTIONAL = {'shtab'}


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
    assert imported('wrist_ft_comp') - OPTIONAL == declared('exec_depend')


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
