"""The commands of the README, run as they are written, in their order."""

from pathlib import Path
import re
import sys

ROOT = Path(__file__).parents[3]
TITLES = ('max \\|K_s\\|, %FS/°C (eq. 23)', 'zero spread, %FS')


def test_the_readme_s_commands_run_and_give_its_figures(terminal, play):
    terminal.run([sys.executable, str(Path(__file__).with_name('bags.py')), '.'])
    assert play('README.md', lambda each: each.temperature > 28.0) >= 10.0
    readme = (ROOT / 'README.md').read_text('utf-8')
    for title in TITLES:
        figures = re.search(re.escape(f'| {title} |') + r'(.*)\|', readme)
        shown = re.search(re.escape(title.replace('\\', '')) + r'(.*)', terminal.printed)
        assert figures is not None, title
        assert shown is not None, title
        assert shown[1].split() == [cell.strip() for cell in figures[1].split('|')]
