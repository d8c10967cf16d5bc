"""The commands of the README and of the tutorial, run as they are written, in their order."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[3]
TITLES = ('max \\|K_s\\|, %FS/°C (eq. 23)', 'zero spread, %FS')


def test_the_readme_s_commands_for_files_give_the_figures_of_its_table(terminal, commands):
    lines = [words for words in commands('README.md') if words[0] == 'wrist_ft_comp']
    assert len(lines) >= 5
    printed = ''.join(terminal.run(words) for words in lines)
    readme = (ROOT / 'README.md').read_text('utf-8')
    for title in TITLES:
        figures = re.search(re.escape(f'| {title} |') + r'(.*)\|', readme)
        assert figures is not None, title
        expected = [cell.strip() for cell in figures[1].split('|')]
        shown = re.search(re.escape(title.replace('\\', '')) + r'(.*)', printed)
        assert shown is not None
        assert shown[1].split() == expected


def test_the_readme_s_commands_run(play):
    play('README.md', lambda each: each.temperature > 28.0)


def test_the_tutorial_s_commands_run_and_another_day_has_a_tenth_of_the_drift(
    terminal, play, commands
):
    play('docs/tutorial.md', lambda each: each.header.stamp.sec % 86400 > 7200)
    printed = terminal.run(['wrist_ft_comp', 'evaluate', 'model.yaml', 'day_2.csv'])
    ratio = re.search(r'force_z .* (\S+)$', printed, re.M)
    assert ratio is not None, printed
    assert float(ratio[1]) >= 10.0
    for words in commands('docs/recording.md'):
        terminal.run(words)
