"""The commands of the tutorials and of the guide to recording, run as they are written."""

import json


def test_the_tutorial_s_commands_run_and_another_day_has_a_tenth_of_the_drift(
    terminal, play, commands
):
    assert play(lambda heat: heat.header.stamp.sec % 86400 > 7200, 'docs/tutorial.md') >= 10.0
    for words in commands('docs/recording.md'):
        terminal.run(words)


def test_a_robot_at_work_learns_its_drift_and_its_tool(terminal, play):
    assert play(lambda heat: heat.header.stamp.sec % 86400 > 3600, 'docs/at_work.md') >= 5.0
    payloads = json.loads((terminal.folder / 'payloads.json').read_text())['payloads']
    masses = [each['mass_kg'] for each in payloads.values()]
    assert list(payloads) == ['tool-1', 'tool-2']
    assert abs(masses[0] - 1.4) < 0.05 * 1.4
    assert abs(masses[1] - 2.2) < 0.05 * 2.2
