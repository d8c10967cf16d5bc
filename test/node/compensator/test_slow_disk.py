import json
import os
import time

from moments import SECOND, START
import pytest

FSYNC_S = 0.4
#: A model is read in 30 ms, on a busy machine in 300; whoever waits for the disk takes longer.
LONGEST_CALLBACK_S = 0.35


@pytest.mark.usefixtures('haste')
def test_no_callback_waits_for_the_disk_and_every_answer_does(rig, make_model, monkeypatch):
    first, second = make_model('a.yaml'), make_model('b.yaml', {'force_x': (1.0, 0.0, 0.0)})
    node, fsync, took_s = rig(model=first), os.fsync, {}

    def slow(handle):
        time.sleep(FSYNC_S)
        fsync(handle)

    def timed(name, callback, *arguments):
        before = time.monotonic()
        result = callback(*arguments)
        took_s[name] = max(took_s.get(name, 0.0), time.monotonic() - before)
        return result

    def answer(name, *data):
        answers = timed(name, node.ask, name, *data)
        assert answers.empty(), f'{name} answers before the disk does'
        node.wait_until(
            lambda: timed('poll', node.node.housekeep) or not answers.empty(),
            f'the answer of {name}',
        )
        return answers.get()

    monkeypatch.setattr(os, 'fsync', slow)
    timed('record', node.call, 'record', True)
    for cell in range(4):
        stamp = START + cell * SECOND
        timed('wrench', node.put, stamp, [1.0] * 6)
        timed('temperature', node.put_temperature, stamp, 25.0)
    recorded = answer('record', False)
    assert recorded.message.startswith('recorded 3 thermal cells')
    timed('model_file', node.set, 'model_file', str(second.path))
    assert answer('rollback').success
    document = json.loads((node.directory / 'active.json').read_text())
    assert document['history'][-1]['sha256'] == first.sha256
    node.node.learning._remember(verdict='well')
    timed('reset_tare', node.call, 'reset_tare')
    timed('poll', node.node.housekeep)
    timed('diagnose', node.node._diagnose)
    assert max(took_s.values()) < LONGEST_CALLBACK_S, took_s
    assert node.node.writer.end(9.0)
    assert json.loads((node.directory / 'learning.json').read_text())['verdict'] == 'well'
