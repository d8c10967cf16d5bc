#!/bin/sh
# Makes build/noble: Python 3.12 with Ubuntu 24.04's library versions, ROS from wheels, the rest as locked.
set -eu
python=${1:-python3.12}
here=$(dirname "$0")
venv=build/noble

if ! "$python" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 12))' 2>/dev/null; then
    echo "Ubuntu 24.04's Python 3.12 is needed, and '$python' is not one." \
        'Name one with "make PYTHON312=/path/to/python3.12 test-noble".' >&2
    exit 1
fi
# matplotlib 3.6.3 is older than Python 3.12: there is no wheel, and its own build would download these two.
if ! pkg-config --exists freetype2 qhull_r; then
    echo 'matplotlib 3.6.3 has to be built for Python 3.12 and needs two libraries for that.' \
        'Install them (Debian, Ubuntu: apt install pkg-config libfreetype-dev libqhull-dev).' >&2
    exit 1
fi

rm -rf "$venv"
"$python" -m venv "$venv"
names=$(sed -n 's/==.*//p' "$here/noble.txt" | paste -s -d '|')
grep -viE "^($names)==" "$here/lock.txt" > "$venv/rest.txt"
printf '[libs]\nsystem_freetype = true\nsystem_qhull = true\n' > "$venv/matplotlib.cfg"
MPLSETUPCFG=$PWD/$venv/matplotlib.cfg "$venv/bin/python" -m pip install --quiet \
    --disable-pip-version-check -c "$here/noble.txt" -c "$venv/rest.txt" -e '.[ros,test]'
