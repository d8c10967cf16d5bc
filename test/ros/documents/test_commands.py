"""The commands of the README and of the tutorial, run as they are written, in their order."""

import json
from pathlib import Path
import re
import sys

ROOT = Path(__file__).parents[3]
TITLES = ('max \\|K_s\\|, %FS/°C (eq. 23)', 'zero spread, %FS')


def drift_fell(terminal, lines):
    """How many times, by the first evaluation of a document, force z."""
    words = next(line for line in lines if line[:2] == ['wrist_ft_comp', 'evaluate'])
    axis = json.loads(terminal.run([*words, '--json']))['axes']['force_z']
    return axis['rms_before'] / axis['rms_after']


def test_the_readme_s_commands_run_and_give_its_figures(terminal, play, commands):
    terminal.run([sys.executable, str(Path(__file__).with_name('bags.py')), '.'])
    play('README.md', lambda each: each.temperature > 28.0)
    assert drift_fell(terminal, commands('README.md')) >= 10.0
    readme = (ROOT / 'README.md').read_text('utf-8')
    for title in TITLES:
        figures = re.search(re.escape(f'| {title} |') + r'(.*)\|', readme)
        assert figures is not None, title
        expected = [cell.strip() for cell in figures[1].split('|')]
        shown = re.search(re.escape(title.replace('\\', '')) + r'(.*)', terminal.printed)
        assert shown is not None
        assert shown[1].split() == expected


def test_the_tutorial_s_commands_run_and_another_day_has_a_tenth_of_the_drift(
    terminal, play, commands
):
    play('docs/tutorial.md', lambda each: each.header.stamp.sec % 86400 > 7200)
    assert drift_fell(terminal, commands('docs/tutorial.md')) >= 10.0
    for words in commands('docs/recording.md'):
        terminal.run(words)
