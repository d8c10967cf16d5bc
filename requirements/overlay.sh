#!/bin/sh
# Makes build/NAME: the tools of NAME.txt in an environment of their own, which sees .venv's packages, too.
# colcon's builds have its Python in their first line, as everywhere, and so run with those packages.
set -eu
name=$1
here=$(dirname "$0")
venv=build/$name

rm -rf "$venv"
.venv/bin/python -m venv "$venv"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check -r "$here/$name.txt"
.venv/bin/python - "$("$venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')" <<'LINK'
import pathlib, sys, sysconfig
line = f'import site; site.addsitedir({sysconfig.get_path("purelib")!r})\n'
pathlib.Path(sys.argv[1], 'project.pth').write_text(line)
LINK
