"""The commands of the guide to learning at work, run as they are written."""

import json


def test_a_robot_at_work_learns_its_drift_and_its_tool(terminal, play):
    assert play(lambda heat: heat.header.stamp.sec % 86400 > 2000, 'docs/at_work.md') >= 5.0
    payloads = json.loads((terminal.folder / 'payloads.json').read_text())['payloads']
    masses = [payload['mass_kg'] for payload in payloads.values()]
    assert list(payloads) == ['tool-1', 'tool-2']
    assert abs(masses[0] - 1.4) < 0.05 * 1.4
    assert abs(masses[1] - 2.2) < 0.05 * 2.2
