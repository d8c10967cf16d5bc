#!/bin/sh
# Writes lock.txt: what a Python 3.10 gets today, so that tomorrow gives the same.
set -eu
python=${1:-python3}
here=$(dirname "$0")
"$python" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 10) and "Run it with Python 3.10.")'
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$python" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet '.[ros,test,lint]'
{
    echo "# What is tested, on Python 3.10 to 3.13: every package exactly. Made by 'make lock'."
    "$folder/venv/bin/python" -m pip freeze --exclude setuptools --exclude wrist_ft_comp
} > "$here/lock.txt"
