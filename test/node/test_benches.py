"""Reliability benches, a little of each: they run, and find nothing."""

import json


def test_damaged_inputs_are_taken_or_refused(run_python):
    printed = run_python('bench/faults', 'fuzz', '50')
    for reader in ('wire', 'model file', 'state file', 'diary', 'CSV', 'mcap', 'sqlite'):
        assert f'{reader} ' in printed


def test_every_file_loads_after_kills(run_python):
    assert json.loads(run_python('bench/faults', 'kills', '1'))['loaded']['states'] > 0


def test_nothing_wrong_comes_out_while_faults_come_in(run_python):
    """How long the stream was away depends on the machine, so only what came is judged."""
    words = 'bench/faults', 'endurance', '0.15', '--rate', '200'
    printed = run_python(*words, may_fail=True)
    figures = json.loads(printed)
    assert figures['counts']['arrived'] > 0, printed
    assert sum(figures['faults'].values()) >= 4
    assert not [what for what in figures['counts'] if what.startswith('wrong')], printed
    assert figures['tracebacks'] == 0
