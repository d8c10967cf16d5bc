"""
The node as a door for the bad recordings of test/cli/test_bad_recordings.py.

Every kind that a bag can hold comes as messages, byte by byte as the bag would hold them, while
the node records. It says so in its diagnostics, or in the answer of ~/calibrate on what it
recorded: in the sentence of the file's door, or in what LIVE has for the kind.
"""

from dataclasses import replace
from pathlib import Path
import re
import runpy

import pytest

from wrist_ft_comp.jobs.entry import answer

FILES = runpy.run_path(str(Path(__file__).parents[2] / 'cli/test_bad_recordings.py'))
KINDS = {**FILES['REFUSED'], **FILES['WARNED']}
DROPPED = 'readings of thermometer 1 are dropped; they are '
NO_SENSOR = 'outside -100 to 200 °C, which no sensor reads, such as '
#: What is only counted in a file, the node says while it happens; kinds that are not here have the
#: file's own sentence.
LIVE = {
    'kelvin in °C': (
        f'{DROPPED}{NO_SENSOR}29\\S+ °C. In kelvins it would be 2\\S+ °C: then name it '
        '/temperature:temperature:K'),
    'absolute zero in a tenth': f'{DROPPED}{NO_SENSOR}-273.1 °C',
    'temperature never a number': f'{DROPPED}not finite',
    'stamps run back': 'temperatures are dropped, because their stamps do not increase',
    'stamps of years out of few rows': 'stamps leapt ahead; was a clock set?',
    'no stamp at all': 'wrenches come without stamps; the time of arrival is taken',
    'thermometer without a stamp': 'thermometer 1 does not stamp its readings; the time of',
    'no topic of a wrench': 'no raw wrenches arrive: .*wrench_raw has no publisher .is the driver',
    'two clocks': r'stamps of \S+temperature are 17\d+.\d s ahead of those of \S+wrench_raw, comp',
    'one spike': r'force_z of .* stands out by up to \d\d.* N for 1 s in all, first at 0:0',
    'one reading of absolute zero': f'{DROPPED}{NO_SENSOR}-273.1 °C',
    'one wrench that is none': 'some wrenches are unusable and dropped; .*: they are not finite',
    'a first stamp of 1970': 'recorded 598 thermal cells',
    'one stamp hours ahead': 'a temperature was dropped, because its stamp was far from those',
    'a wrench without a stamp': 'wrenches come without stamps',
}  # fmt: skip
#: These come in messages of a driver's own type, which only DDS can carry: test_message_fields.py.
OWN_TYPES = ('wrench and temperature in one message', 'a stamp taken for a temperature')


class JobHere:
    """A calibration in this process, without a report."""

    def __init__(self, job):
        self._outcome = answer(replace(job, report=None))

    def poll(self):
        return self._outcome


@pytest.mark.usefixtures('haste')
@pytest.mark.parametrize(
    'kind', [kind for kind, row in KINDS.items() if 'mcap' in row[2] and kind not in OWN_TYPES]
)
def test_the_node_warns_and_drops_as_the_files_do(kind, rig, messages, monkeypatch):
    monkeypatch.setattr('wrist_ft_comp.node.jobs.start_job', JobHere)
    change, pattern, _ = KINDS[kind]
    table = FILES['good']()
    if change:
        change(table)
    topics = FILES['thermometers'](table)
    chosen = {'temperature_timeout': 3600.0}
    node = rig(topics=topics, thermometers=len(topics), parameters=chosen)
    assert node.call('record', True).success
    said = set()
    parts = [
        (topic, data) for topic, _, _, data in FILES['Door'](messages=messages).parts(table, kind)
    ]
    for number, (topic, data) in enumerate(parts, start=1):
        if topic in topics:
            node.put_temperature_bytes(topics.index(topic), data)
        elif topic == '/wrench_raw':
            node.put_bytes(data)
            node.node.wrench_input.poll()
        if number % 100 == 2 or number == len(parts):
            said.update(status.message for status in node._report())
    counts, wrenches = node.node.counts, [topic for topic, _ in parts].count('/wrench_raw')
    assert node.outputs.qsize() == wrenches - counts.not_finite - counts.implausible
    said.update([node.call('record', False).message, node.call('calibrate').message])
    wanted = LIVE.get(kind, pattern)
    assert [sentence for sentence in said if re.search(wanted, sentence, re.M)], said
