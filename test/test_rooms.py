"""The directions in which the rooms may look, read from the source."""

import ast
from collections.abc import Iterator
from pathlib import Path
import sys

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / 'wrist_ft_comp'
MODULES = sorted(PACKAGE.rglob('*.py'))
ROOMS = ('core', 'files', 'ros', 'cli')
#: Which rooms a room may look into, itself included.
ALLOWED_ROOMS = {
    'core': {'core'},
    'files': {'core', 'files'},
    'ros': {'core', 'files', 'ros'},
    'cli': {'core', 'files', 'cli'},
    '__init__': set[str](),
    '__main__': {'cli'},
}
ROS_PACKAGES = {
    'action_msgs', 'ament_index_python', 'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs',
    'launch', 'launch_ros', 'rcl_interfaces', 'rclpy', 'rosbag2_py', 'rosgraph_msgs',
    'rosidl_runtime_py', 'sensor_msgs', 'std_msgs', 'std_srvs', 'tf2_ros',
}  # fmt: skip
CLOCKS_AND_LOGS = {'time', 'datetime', 'logging'}
#: Ways to reach a file that the core must not take.
FILE_CALLS = {
    'open', 'read_text', 'write_text', 'read_bytes', 'write_bytes', 'fdopen', 'loadtxt',
    'genfromtxt', 'savetxt', 'savez', 'memmap', 'tofile', 'fromfile',
}  # fmt: skip
FILE_MODULES = {'io', 'os', 'pathlib', 'shutil', 'sqlite3', 'subprocess', 'tempfile', 'zipfile'}


def room_of(module: Path) -> str:
    first = module.relative_to(PACKAGE).parts[0]
    return first if first in ROOMS else ''


def tree_of(module: Path) -> ast.Module:
    return ast.parse(module.read_text(encoding='utf-8'))


def imports_of(tree: ast.AST) -> Iterator[str]:
    """Yield every imported name in full, wherever the import stands."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'relative import of {node.module}'
            yield str(node.module)
            yield from (f'{node.module}.{alias.name}' for alias in node.names)


def calls_of(tree: ast.AST) -> Iterator[str]:
    """Yield the last name of everything that is called."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            if any(ast.unparse(argument) == 'os.devnull' for argument in node.args):
                continue  # the documented answer to a broken pipe, and no file
            if isinstance(node.func, ast.Name):
                yield node.func.id
            elif isinstance(node.func, ast.Attribute):
                yield node.func.attr


def rooms_imported(tree: ast.AST) -> set[str]:
    parts = [name.split('.') for name in imports_of(tree) if name.startswith('wrist_ft_comp.')]
    return {names[1] for names in parts if names[1] in ROOMS}


def name_of(module: Path) -> str:
    return str(module.relative_to(PACKAGE))


every_module = pytest.mark.parametrize('module', MODULES, ids=name_of)
every_core_module = pytest.mark.parametrize(
    'module', [module for module in MODULES if room_of(module) == 'core'], ids=name_of
)


def every_module_but(room: str) -> pytest.MarkDecorator:
    others = [module for module in MODULES if room_of(module) != room]
    return pytest.mark.parametrize('module', others, ids=name_of)


def test_the_rooms_are_found() -> None:
    assert {'core', 'files', 'ros'} <= {room_of(module) for module in MODULES}
    assert len(MODULES) > 20


@every_module
def test_a_room_looks_only_where_it_may(module: Path) -> None:
    allowed = ALLOWED_ROOMS[room_of(module) or module.stem]
    assert rooms_imported(tree_of(module)) <= allowed


@every_core_module
def test_the_core_knows_numpy_scipy_and_the_standard_library_only(module: Path) -> None:
    roots = {name.split('.')[0] for name in imports_of(tree_of(module))}
    foreign = roots - set(sys.stdlib_module_names) - {'numpy', 'scipy', 'wrist_ft_comp'}
    assert not foreign


@every_core_module
def test_the_core_asks_no_clock_and_keeps_no_log(module: Path) -> None:
    roots = {name.split('.')[0] for name in imports_of(tree_of(module))}
    assert not roots & CLOCKS_AND_LOGS


@every_core_module
def test_the_core_opens_no_file(module: Path) -> None:
    tree = tree_of(module)
    assert not set(calls_of(tree)) & FILE_CALLS
    assert not {name.split('.')[0] for name in imports_of(tree)} & FILE_MODULES


@every_module_but('files')
def test_only_files_open_files(module: Path) -> None:
    assert not set(calls_of(tree_of(module))) & (FILE_CALLS - {'fdopen'})


@every_module_but('ros')
def test_only_ros_knows_ros(module: Path) -> None:
    assert not {name.split('.')[0] for name in imports_of(tree_of(module))} & ROS_PACKAGES


@every_module_but('cli')
def test_only_the_command_line_prints(module: Path) -> None:
    assert 'print' not in set(calls_of(tree_of(module)))


@every_module
def test_nothing_leaves_the_process_but_the_command_line(module: Path) -> None:
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
