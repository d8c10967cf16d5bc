#!/bin/sh
# Makes build/colcon: colcon in an environment of its own, which sees .venv's packages, too. What it
# builds has its Python in the first line, as colcon does everywhere, and so runs with those packages.
set -eu
here=$(dirname "$0")
venv=build/colcon

rm -rf "$venv"
.venv/bin/python -m venv "$venv"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check -r "$here/colcon.txt"
.venv/bin/python - "$("$venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')" <<'LINK'
import pathlib, sys, sysconfig
line = f'import site; site.addsitedir({sysconfig.get_path("purelib")!r})\n'
pathlib.Path(sys.argv[1], 'project.pth').write_text(line)
LINK
