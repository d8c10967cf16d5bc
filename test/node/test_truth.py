"""A quarter of an hour of the machine of truth; longer runs are ``make reliability``."""

import re


def test_a_quarter_of_an_hour_full_of_events_brings_no_finding(run_python):
    words = '--hours', '0.25', '--every', '100', '--seed', '3'
    printed = run_python('bench/faults/truth.py', *words)
    found = re.search(r'^(\d+) events .* 0 findings; 0\.0 false warnings', printed, re.MULTILINE)
    assert found, printed
    assert int(found[1]) >= 5, printed
