#!/bin/sh
# Makes .venv: with ROS from wheels, or around a sourced ROS 2 with the system's own packages.
set -eu
python=${1:-python3}
here=$(dirname "$0")

"$python" - <<'CHECK' || exit 1
import sys
if not (3, 10) <= sys.version_info[:2] <= (3, 13):
    sys.exit(f'Python 3.10 to 3.13 is needed, this is {sys.version.split()[0]}. '
             'Name another one with "make PYTHON=python3.12 setup".')
try:
    import ensurepip, venv
except ImportError:
    sys.exit('This Python cannot make virtual environments. '
             'Install its venv package (Debian, Ubuntu: apt install python3-venv).')
CHECK

# A sourced ROS 2 is built for one Python; another one finds its rclpy, but cannot import it.
"$python" - <<'CHECK' || exit 1
import importlib.util, sys
if importlib.util.find_spec('rclpy'):
    try:
        import rclpy
    except ImportError as error:
        sys.exit(f'A ROS 2 is sourced whose rclpy this Python ({sys.executable}) cannot import: {error}. '
                 'Name the Python it is built for with "make PYTHON=/usr/bin/python3 setup", '
                 'or use a shell that sources no ROS 2.')
CHECK

rm -rf .venv
if "$python" -c 'import rclpy' 2>/dev/null; then
    echo "A ROS 2 is sourced: using its rclpy, and Ubuntu 24.04's versions of what is missing."
    "$python" -m venv --system-site-packages .venv
    extras='test,lint' constraints=$here/noble.txt
else
    echo 'No ROS 2 is sourced: installing rclpy and Fast DDS from wheels into .venv (350 MB).'
    "$python" -m venv .venv
    extras='ros,test,lint' constraints=$here/lock.txt
fi
.venv/bin/python -m pip install --quiet --disable-pip-version-check -c "$constraints" -e ".[$extras]"
