"""What the log says of troubles that begin, change, come and go, and end."""

import pytest

from wrist_ft_comp.ros.node_log import ERROR, NodeLog, OK, STALE, Status, WARN

WELL = Status('input', OK, '999 wrenches per second')
NAN = Status('input', WARN, 'some wrenches are unusable and dropped; check the driver')
SILENT = Status('input', STALE, 'no raw wrenches arrive')


class Logger:
    """Remembers what was logged."""

    def __init__(self):
        self.lines = []

    def info(self, line):
        self.lines.append(('info', line))

    def warning(self, line):
        self.lines.append(('warning', line))

    def error(self, line):
        self.lines.append(('error', line))


@pytest.fixture
def told():
    """Report statuses one after the other; give what was logged."""
    logger = Logger()
    log = NodeLog(logger)

    def tell(*statuses):
        logger.lines.clear()
        for status in statuses:
            log.tell([status])
        return list(logger.lines)

    return tell


def test_a_trouble_is_told_once_and_its_end_when_it_stays_away(told):
    assert told(WELL) == []
    assert told(*[NAN] * 30) == [('warning', f'input: {NAN.message}')]
    assert told(*[WELL] * 9) == []
    assert told(WELL) == [('info', 'input: 999 wrenches per second')]
    assert told(*[WELL] * 30) == []
    assert told(NAN) == [('warning', f'input: {NAN.message}')]


def test_troubles_that_come_and_go_do_not_fill_the_log(told):
    assert len(told(*[NAN, WELL, SILENT, WELL] * 500)) == 2


def test_numbers_are_no_news_but_other_thermometers_are(told):
    def silent(which, seconds):
        return Status('temperature', WARN, f'thermometer {which} silent for {seconds} s; held')

    assert len(told(*[silent('1', seconds) for seconds in (5, 6.5, 77)])) == 1
    assert len(told(silent('2', 5))) == 1
    assert len(told(silent('1, 2', 5), silent('1, 3', 5))) == 2


def test_an_error_is_one_in_the_log(told):
    assert told(Status('output', ERROR, 'at its limit')) == [('error', 'output: at its limit')]


def test_a_driver_may_take_its_time_to_start(told):
    assert told(*[SILENT] * 5) == []
    assert told(SILENT) == [('warning', 'input: no raw wrenches arrive')]


def test_what_is_logged_elsewhere_is_not_repeated(told):
    assert told(Status('model', ERROR, 'broken'), Status('calibration', WARN, 'refused')) == []
