"""docs/interface.md is what the code says."""

from pathlib import Path
import subprocess
import sys

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.usefixtures('ros_domain')
def test_the_reference_of_the_interface_is_what_the_code_says():
    done = subprocess.run(
        [sys.executable, 'docs/generator/interface.py'],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    written = (ROOT / 'docs/interface.md').read_text('utf-8')
    assert done.stdout == written, 'write it anew: make docs'
