"""Lines of the log about troubles that begin, change, come and go, and end."""

from types import SimpleNamespace

import pytest

from wrist_ft_comp.ros.diagnostics import NodeLog, OK, STALE, Status, WARN

WELL = Status('input', OK, '999 wrenches per second')
NAN = Status('input', WARN, 'some wrenches are unusable and dropped; check the driver')
SILENT = Status('input', STALE, 'no raw wrenches arrive')


@pytest.fixture
def logged():
    """Report statuses one after the other; give the log's lines."""
    lines = []
    levels = 'info', 'warning', 'error'
    note = {level: lambda line, level=level: lines.append((level, line)) for level in levels}
    log = NodeLog(SimpleNamespace(**note))

    def tell(*statuses):
        lines.clear()
        for status in statuses:
            log.report([status])
        return list(lines)

    return tell


def test_a_trouble_is_logged_once_and_its_end_when_it_stays_away(logged):
    assert logged(WELL) == []
    assert logged(*[NAN] * 30) == [('warning', f'input: {NAN.message}')]
    assert logged(*[WELL] * 9) == []
    assert logged(WELL) == [('info', 'input: 999 wrenches per second')]
    assert logged(*[WELL] * 30) == []
    assert logged(NAN) == [('warning', f'input: {NAN.message}')]
    assert len(logged(*[WELL, SILENT, WELL, NAN] * 500)) <= 2, 'what comes and goes'


def test_changed_numbers_are_not_logged_but_other_thermometers_are(logged):
    def silent(numbers, seconds):
        return Status('temperature', WARN, f'thermometer {numbers} silent for {seconds} s; held')

    assert len(logged(*[silent('1', seconds) for seconds in (5, 6.5, 77)])) == 1
    assert len(logged(silent('2', 5))) == 1
    assert len(logged(silent('1, 2', 5), silent('1, 3', 5))) == 2


def test_a_driver_may_take_its_time_to_start(logged):
    assert logged(*[SILENT] * 5) == []
    assert logged(SILENT) == [('warning', 'input: no raw wrenches arrive')]
