"""The rooms of the package: who looks into whom, how full they are, and what each may do."""

import ast
from pathlib import Path
import subprocess
import sys

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / 'wrist_ft_comp'
MODULES = {
    '.'.join(path.relative_to(PACKAGE).with_suffix('').parts): path
    for path in sorted(PACKAGE.rglob('*.py'))
}
#: What a room may look into, besides itself and the errors.
DOORS = {
    'model': set[str](),
    'stream': {'model'},
    'identification': {'model'},
    'calibration': {'model', 'stream', 'identification'},
    'report': {'model', 'calibration'},
    'files': {'model', 'stream', 'calibration'},
    'simulation': {'model'},
    'ros': {'model', 'stream', 'calibration', 'report', 'files', 'simulation'},
    'cli': {'model', 'stream', 'calibration', 'report', 'files', 'simulation', 'ros'},
}
#: Numbers in, numbers out.
MATHEMATICS = {'model', 'stream', 'identification', 'calibration', 'simulation'}
#: A room that holds more cannot be seen through.
MOST_FILES = 12
ROS_PACKAGES = {
    'action_msgs', 'ament_index_python', 'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs',
    'launch', 'launch_ros', 'rcl_interfaces', 'rclpy', 'rosbag2_py', 'rosgraph_msgs',
    'rosidl_runtime_py', 'sensor_msgs', 'std_msgs', 'std_srvs', 'tf2_ros',
}  # fmt: skip
CLOCKS_AND_LOGS = {'time', 'datetime', 'logging'}
#: Ways to reach a file that only ``files`` takes.
FILE_CALLS = {
    'open', 'read_text', 'write_text', 'read_bytes', 'write_bytes', 'loadtxt', 'genfromtxt',
    'savetxt', 'savez', 'memmap', 'tofile', 'fromfile',
}  # fmt: skip
FILE_MODULES = {'io', 'os', 'shutil', 'sqlite3', 'subprocess', 'tempfile', 'zipfile'}


def room_of(module):
    first = module.split('.', maxsplit=1)[0]
    return first if first in DOORS else ''


def tree_of(module):
    return ast.parse(MODULES[module].read_text(encoding='utf-8'))


def imported(tree):
    """Yield every imported name in full, wherever the import stands, also for type checking."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'relative import of {node.module}'
            yield str(node.module)
            yield from (f'{node.module}.{alias.name}' for alias in node.names)


def own_imports(module):
    """Modules of the package that a module imports."""
    names = {name.removeprefix('wrist_ft_comp.') for name in imported(tree_of(module))}
    return {name for name in names if name in MODULES and name != module}


def called(tree):
    """Yield the last name of everything that is called."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            if any(ast.unparse(argument) == 'os.devnull' for argument in node.args):
                continue  # the documented answer to a broken pipe, and no file
            if isinstance(node.func, ast.Name):
                yield node.func.id
            elif isinstance(node.func, ast.Attribute):
                yield node.func.attr


def roots(module):
    return {name.split('.')[0] for name in imported(tree_of(module))}


every_module = pytest.mark.parametrize('module', MODULES)
every_module_of_the_mathematics = pytest.mark.parametrize(
    'module', [module for module in MODULES if room_of(module) in MATHEMATICS]
)


def every_module_but(*rooms):
    others = [module for module in MODULES if room_of(module) not in rooms]
    return pytest.mark.parametrize('module', others)


def test_every_room_is_there():
    assert {room_of(module) for module in MODULES} == {*DOORS, ''}


@every_module
def test_a_room_looks_only_through_its_doors(module):
    room = room_of(module)
    if module == '__main__':
        assert own_imports(module) == {'cli.entry'}
        return
    if module == '__init__':  # what others' programs use, by way of type checking only
        assert {room_of(name) for name in own_imports(module)} <= {*DOORS, ''} - {'ros', 'cli'}
        return
    allowed = DOORS.get(room, set()) | {room}
    outside = {name for name in own_imports(module) if name != 'errors'}
    assert {room_of(name) for name in outside} - {''} <= allowed


def test_no_imports_go_round_in_a_circle():
    """Not even those that only type checking sees."""
    arrows = {module: own_imports(module) for module in MODULES}
    while ends := {module for module, others in arrows.items() if not others}:
        arrows = {module: others - ends for module, others in arrows.items() if module not in ends}
    assert not arrows


def test_no_room_is_too_full_to_see_through():
    for folder in {path.parent for path in MODULES.values()}:
        files = [path for path in folder.glob('*.py') if path.name != '__init__.py']
        assert len(files) <= MOST_FILES, f'{folder.name} holds {len(files)} files'


@every_module
def test_every_file_says_first_what_lives_in_it(module):
    docstring = ast.get_docstring(tree_of(module)) or ''
    assert docstring.split('\n')[0].endswith(('.', ':'))


@every_module_of_the_mathematics
def test_the_mathematics_knows_numpy_scipy_and_the_standard_library_only(module):
    foreign = roots(module) - set(sys.stdlib_module_names) - {'numpy', 'scipy', 'wrist_ft_comp'}
    assert not foreign


@every_module_of_the_mathematics
def test_the_mathematics_asks_no_clock_and_keeps_no_log(module):
    assert not roots(module) & CLOCKS_AND_LOGS


@every_module_of_the_mathematics
def test_the_mathematics_does_not_reach_for_files(module):
    assert not roots(module) & FILE_MODULES


@every_module_but('files')
def test_only_files_open_files(module):
    assert not set(called(tree_of(module))) & FILE_CALLS


@every_module_but('files')
def test_pictures_are_drawn_into_memory(module):
    """Matplotlib writes a file where it is given a path."""
    nodes = list(ast.walk(tree_of(module)))
    buffers = {
        ast.unparse(node.targets[0])
        for node in nodes
        if isinstance(node, ast.Assign) and ast.unparse(node.value) in {'BytesIO()', 'StringIO()'}
    }
    targets = {
        ast.unparse(node.args[0]) if node.args else 'nothing'
        for node in nodes
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith('savefig')
    }
    assert targets <= buffers


@every_module_but('ros')
def test_only_ros_knows_ros(module):
    """But for one module, which reads bags by what a system ROS has for that."""
    allowed = {'rosbag2_py'} if module == 'files.bags.rosbag2_backend' else set[str]()
    assert roots(module) & ROS_PACKAGES == allowed


@every_module_but('cli')
def test_only_the_command_line_prints(module):
    assert 'print' not in set(called(tree_of(module)))


@every_module
def test_nothing_leaves_the_process_but_the_command_line(module):
    """A library that calls sys.exit takes its user down with it; ``__main__`` blocks may."""
    tree = tree_of(module)
    guarded = {
        id(inner)
        for node in tree.body
        if isinstance(node, ast.If) and '__main__' in ast.unparse(node.test)
        for inner in ast.walk(node)
    }
    exits = [
        ast.unparse(node)
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and ast.unparse(node.func) in {'sys.exit', 'exit', 'quit', 'os._exit'}
        and id(node) not in guarded
    ]
    assert not exits or room_of(module) in {'cli', 'ros'}


def test_what_runs_live_loads_no_submodule_of_scipy():
    """Nor any room that only fits or reports: the node that holds it has to be light."""
    rooms = 'identification|calibration|report|files|simulation'
    program = f"""
import re, sys, numpy
before = set(sys.modules)
import {', '.join(f'wrist_ft_comp.{m}' for m in MODULES if room_of(m) in {'model', 'stream'})}
from wrist_ft_comp.model.arx import relaxation
from wrist_ft_comp.model.arx_pls import from_gains
one = numpy.ones(1)
model = from_gains([relaxation(9.0, 1.0)], one.reshape(1, 1, 1), one, one, one)
model.run(model.start(one), numpy.ones((9, 1)))
heavy = re.compile(r'scipy|matplotlib|rosbags|wrist_ft_comp[.]({rooms})')
sys.exit(' '.join(filter(heavy.match, set(sys.modules) - before)) or 0)
"""
    finished = subprocess.run(
        [sys.executable, '-c', program], capture_output=True, text=True, check=False
    )
    assert (finished.returncode, finished.stderr) == (0, '')
