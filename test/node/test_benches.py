"""Reliability benches of files and callbacks, a little of each: they run, and find nothing."""

import json


def test_damaged_inputs_are_taken_or_refused(run_bench):
    code, printed = run_bench('faults', 'fuzz', '100')
    assert code == 0, printed
    for reader in ('wire', 'model file', 'state file', 'diary', 'CSV', 'mcap', 'sqlite'):
        assert f'{reader} ' in printed


def test_every_file_loads_after_kills(run_bench):
    code, printed = run_bench('faults', 'kills', '1')
    assert code == 0, printed
    assert json.loads(printed)['loaded']['states'] > 0
