"""
Build tf2_msgs and a driver's messages, of two versions, against the ROS wheels: build/messages.

Needs g++, cmake and ninja, about 90 s, and 300 MB for an environment of its own, whose CMake files
are mended: those in the wheels name include folders of the machine that built them. With ROS 2
from its own packages these tests have nothing to build against, and skip.
"""

from pathlib import Path
import re
import shutil
import subprocess
import sys

HERE = Path(__file__).resolve().parents[2] / 'build/messages'
LOCK = HERE.parents[1] / 'requirements/lock.txt'
#: What makes messages, beside rclpy and the messages that ours contain.
TOOLS = (
    'rclpy[fastrtps]', 'common-interfaces', 'rosidl-default-generators',
    'rosidl-core-generators', 'ament-cmake', 'ament-package', 'ament-cmake-include-directories',
    'ament-cmake-ros', 'ament-cmake-gmock', 'ament-cmake-gtest', 'ament-cmake-pytest',
    'fastrtps-cmake-module', 'python-cmake-module',
)  # fmt: skip
#: A folder that is sourced by itself, the package in it, and the package's messages. A message
#: of the older driver is as long as one of today's, with its voltage in the temperature's place.
PACKAGES = (
    ('today', 'tf2_msgs', {'TFMessage': 'geometry_msgs/TransformStamped[] transforms'}),
    ('today', 'driver_msgs', {
        'State': 'std_msgs/Header header\nfloat64 temperature\nfloat64 voltage\n'
                 'geometry_msgs/Wrench wrench',
        'Unstamped': 'float64 temperature',
    }),
    ('older', 'driver_msgs', {
        'State': 'std_msgs/Header header\nfloat64 voltage\nfloat64 temperature\n'
                 'geometry_msgs/Wrench wrench',
    }),
)  # fmt: skip
CMAKE = """\
cmake_minimum_required(VERSION 3.22)
project({name})
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
find_package(geometry_msgs REQUIRED)
find_package(std_msgs REQUIRED)
rosidl_generate_interfaces(${{PROJECT_NAME}} {files} DEPENDENCIES geometry_msgs std_msgs)
ament_package()
"""
PACKAGE = """\
<package format="3">
  <name>{name}</name><version>1.0.0</version><description>For tests</description>
  <maintainer email="maintainers@wrist-ft-comp.invalid">nobody</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <depend>geometry_msgs</depend><depend>std_msgs</depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""


def make_tools(venv: Path) -> dict[str, Path]:
    """Make the environment; where numpy and Python are included from, by the wheels' names."""
    subprocess.run([sys.executable, '-m', 'venv', venv], check=True)
    python = venv / 'bin/python'
    names = [f'ros-jazzy-{name}' for name in TOOLS]
    install = [python, '-m', 'pip', 'install', '-qq', '--disable-pip-version-check', '-c', LOCK]
    subprocess.run([*install, *names, 'catkin_pkg'], check=True)
    ask = "import numpy, sysconfig; print(sysconfig.get_path('include'), numpy.get_include())"
    said = subprocess.run([python, '-c', ask], check=True, capture_output=True, text=True)
    include, of_numpy = said.stdout.split()
    for file in venv.glob('share/*/cmake/*Export.cmake'):
        text = file.read_text()
        mended = re.sub(r'/opt/python/[^;"]*/numpy/_core/include', of_numpy, text)
        file.write_text(re.sub(r'/opt/python/[^;"]*/include/python[\d.]+', include, mended))
    return venv


def build(venv: Path, prefix: Path, name: str, messages: dict[str, str]) -> None:
    """Build a package into a prefix, whose libraries find one another."""
    source = HERE / 'source' / prefix.name / name
    for kind, text in messages.items():
        file = source / f'msg/{kind}.msg'
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f'{text}\n')
    files = ' '.join(f'"msg/{kind}.msg"' for kind in messages)
    (source / 'CMakeLists.txt').write_text(CMAKE.format(name=name, files=files))
    (source / 'package.xml').write_text(PACKAGE.format(name=name))
    environment = {
        'PATH': f'{venv}/bin:/usr/local/bin:/usr/bin:/bin',
        'AMENT_PREFIX_PATH': str(venv),
        'LD_LIBRARY_PATH': f'{venv}/lib',
    }
    configure = [
        'cmake', '-G', 'Ninja', '-S', source, '-B', source / 'build', '-DBUILD_TESTING=OFF',
        f'-DCMAKE_PREFIX_PATH={venv}', f'-DPython3_EXECUTABLE={venv}/bin/python',
        f'-DCMAKE_INSTALL_PREFIX={prefix}', f'-DCMAKE_INSTALL_RPATH={prefix}/lib',
        '-DCMAKE_BUILD_TYPE=Debug',
    ]  # fmt: skip
    for command in (configure, ['cmake', '--build', source / 'build', '--target', 'install']):
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, check=False
        )
        if done.returncode:
            sys.exit(f'{name} could not be built:\n{(done.stdout + done.stderr)[-3000:]}')


def main() -> None:
    """Build everything anew."""
    missing = [tool for tool in ('g++', 'cmake', 'ninja') if shutil.which(tool) is None]
    if missing:
        sys.exit(f'{", ".join(missing)} missing; such as by apt install g++ cmake ninja-build.')
    shutil.rmtree(HERE, ignore_errors=True)
    venv = HERE / 'venv'
    make_tools(venv)
    for prefix, name, messages in PACKAGES:
        build(venv, HERE / prefix, name, messages)


if __name__ == '__main__':
    main()
