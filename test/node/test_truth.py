"""An hour of the machine of truth: its robot lives, and what it says comes from its seed alone."""


def test_an_hour_full_of_events_brings_no_finding(run_bench):
    code, printed = run_bench('faults/truth.py', '--hours', '1', '--every', '300', '--seed', '3')
    assert code == 0, printed
    assert ' 0 findings; 0.0 false warnings in 100 quiet hours' in printed
    assert int(printed.splitlines()[-1].split(' events')[0]) >= 5, printed
