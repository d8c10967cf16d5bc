"""The scripts that complete words, run by the shells themselves."""

from importlib import util
import shutil
import subprocess
import sys

import pytest

needs_shtab = pytest.mark.skipif(
    util.find_spec('shtab') is None, reason='shtab is not installed here (extra "completion")'
)

COMPLETE = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1))
$(complete -p wrist_ft_comp | sed 's/.*-F \\([^ ]*\\) .*/\\1/') wrist_ft_comp "${@: -1}" ""
printf '%s\\n' "${COMPREPLY[@]}"
"""


def script(shell, tmp_path):
    command = [sys.executable, '-m', 'wrist_ft_comp', 'completion', shell]
    made = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert made.stderr == ''
    path = tmp_path / f'completion.{shell}'
    path.write_text(made.stdout, encoding='utf-8')
    return path


@needs_shtab
@pytest.mark.skipif(shutil.which('bash') is None, reason='there is no bash here')
@pytest.mark.parametrize(
    ('words', 'expected'),
    [
        (['cal'], ['calibrate']),
        (['calibrate', '--meth'], ['--method']),
        (['calibrate', '--method', 'arx'], ['arx_pls', 'arx_pls_oe']),
        (['evaluate', '--re'], ['--reference', '--reference-topic', '--report']),
        (['completion', 'z'], ['zsh']),
    ],
)
def test_bash_completes(words, expected, tmp_path):
    path = script('bash', tmp_path)
    done = subprocess.run(
        ['/bin/bash', '-c', COMPLETE, 'bash', path, 'wrist_ft_comp', *words],
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert sorted(done.stdout.split()) == expected, done.stderr


@needs_shtab
def test_zsh_gets_a_script_that_it_can_read(tmp_path):
    path = script('zsh', tmp_path)
    assert path.read_text().startswith('#compdef wrist_ft_comp')
    zsh = shutil.which('zsh')
    if zsh:
        subprocess.run([zsh, '-n', path], check=True, timeout=60)


def test_without_shtab_it_says_what_to_install(run, monkeypatch):
    monkeypatch.setattr('wrist_ft_comp.cli.completion.find_spec', lambda _: None)
    assert 'pip install shtab' in run('completion', 'bash').sentence
