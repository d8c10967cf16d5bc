"""The folders of the package: who looks into whom, and what each may do."""

import ast
from collections import Counter
from pathlib import Path
import re
import sys

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / 'wrist_ft_comp'
#: A folder looks only into those above it in this list; '' is the foundation beside the folders.
FOLDERS = [
    '', 'drift', 'wire', 'stream', 'payload', 'fit', 'stored', 'recordings', 'learning', 'report',
    'jobs', 'ros', 'simulation', 'node', 'cli',
]  # fmt: skip
#: Numbers in, numbers out: no files, clocks, logs, and of libraries numpy and scipy only.
MATHEMATICS = {'drift', 'stream', 'payload', 'fit', 'simulation'}
#: What opens files.
OF_FILES = {'stored', 'recordings', 'learning.days', 'jobs.learning_job'}
#: What knows ROS, and what reads bags by a system ROS.
OF_ROS = {'ros', 'node', 'cli.service_calls', 'recordings.rosbag2_backend'}
FILE_CALLS = {
    'open', 'read_text', 'write_text', 'read_bytes', 'write_bytes', 'loadtxt', 'genfromtxt',
    'savetxt', 'savez', 'memmap', 'tofile', 'fromfile', 'savefig',
}  # fmt: skip
BESIDE_THE_MATHEMATICS = {
    'time', 'datetime', 'logging', 'io', 'os', 'shutil', 'sqlite3', 'subprocess', 'tempfile',
}  # fmt: skip
ROS = re.compile(r'rcl|ros|ament|builtin_interfaces$|launch|tf2|\w+_(msgs|srvs|interfaces)$')


#: Every module: by its name, such as ``drift.arx_pls``, its syntax tree.
MODULES = {
    '.'.join(path.relative_to(PACKAGE).with_suffix('').parts).removesuffix('.__init__'): ast.parse(
        path.read_text('utf-8')
    )
    for path in sorted(PACKAGE.rglob('*.py'))
}


def folder_of(module):
    return module.split('.')[0] if module.split('.')[0] in FOLDERS else ''


def imported(tree):
    """Yield every name that is imported, or written as a text, in full."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'relative import of {node.module}'
            yield from (f'{node.module}.{alias.name}' for alias in node.names)
        elif isinstance(node, ast.Constant) and re.match(r'wrist_ft_comp\.\S+$', str(node.value)):
            yield node.value


def looked_into(module):
    """Name the modules of the package that a module imports, also by a text."""
    names = (name.removeprefix('wrist_ft_comp.') for name in imported(MODULES[module]))
    near = {name if name in MODULES else name.rpartition('.')[0] for name in names}
    return {name for name in near if name in MODULES and name != module and '.' in name}


def called(tree):
    """Yield what is called: its last name, and the call."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            yield getattr(node.func, 'attr', getattr(node.func, 'id', '')), node


def outside(*rooms):
    """Name the modules that are in none of some folders and are none of some modules."""
    allowed = set().union(*rooms)
    return [m for m in MODULES if m not in allowed and folder_of(m) not in allowed]


def test_a_folder_looks_only_into_those_above_it():
    wrong = [
        f'{module} looks into {other}'
        for module in MODULES
        if module not in {'__main__', '__init__'}
        for other in looked_into(module)
        if FOLDERS.index(folder_of(other)) > FOLDERS.index(folder_of(module))
    ]
    assert wrong == []
    assert {path.parent.name for path in PACKAGE.glob('*/__init__.py')} == set(FOLDERS) - {''}


def test_no_imports_go_round_in_a_circle():
    arrows = {module: looked_into(module) for module in MODULES}
    while ends := {module for module, others in arrows.items() if not others}:
        arrows = {module: others - ends for module, others in arrows.items() if module not in ends}
    assert arrows == {}


def test_no_folder_holds_more_than_a_quarter_of_the_lines_or_a_single_file():
    lines, files = Counter(), Counter()
    for path in PACKAGE.rglob('*.py'):
        folder = path.parent.relative_to(PACKAGE).as_posix()
        lines[folder] += len(path.read_text('utf-8').splitlines())
        files[folder] += path.name != '__init__.py'
    assert max(lines.values()) < sum(lines.values()) / 4
    assert min(files.values()) > 1


def test_the_mathematics_imports_numpy_and_scipy_and_neither_files_nor_clocks():
    for module in set(MODULES) - set(outside(MATHEMATICS)):
        roots = {name.split('.')[0] for name in imported(MODULES[module])}
        foreign = roots - set(sys.stdlib_module_names) - {'numpy', 'scipy', 'wrist_ft_comp'}
        assert foreign | roots & BESIDE_THE_MATHEMATICS == set(), module


def test_files_are_opened_in_few_places():
    """Pictures are drawn into memory; a null device is the documented answer to a broken pipe."""
    for module in outside(OF_FILES):
        for name, call in called(MODULES[module]):
            target = ast.unparse(call.args[0]) if call.args else ''
            harmless = target in {'os.devnull', 'buffer'}
            assert name not in FILE_CALLS or harmless, f'{module}: {ast.unparse(call)}'


def test_ros_is_imported_in_few_places():
    for module in outside(OF_ROS):
        roots = {name.split('.')[0] for name in imported(MODULES[module])} - {'rosbags'}
        assert not list(filter(ROS.match, roots)), module


def test_only_the_command_line_prints_and_only_programs_leave_the_process():
    for module in outside({'cli'}):
        assert 'print' not in {name for name, _ in called(MODULES[module])}, module
    for module in outside({'cli', 'node', 'jobs', 'ros', '__main__'}):
        exits = {'sys.exit', 'exit', 'quit', 'os._exit'}
        assert not exits & {ast.unparse(call.func) for _, call in called(MODULES[module])}, module
