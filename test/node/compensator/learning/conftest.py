"""Nodes that keep a diary, days that take no time, and a job that finds what a test wants."""

from functools import partial
import json
import sys

from moments import SECOND, START
import pytest

from wrist_ft_comp.learning import days

NEEDED = {'calibration.reference': 'payload', 'gravity.source': 'imu'}
#: Times of days, which are shorter here by this factor: a day has 144 thermal cells of 1 s.
TIMES, SHORTER = ('DAY_NS', 'SILENCE_NS', 'SHORTEST_NS'), 600
#: Stands for the learning job: keeps what it was asked, copies a model, answers.
JOB = """
import json, os, shutil, sys
from pathlib import Path
folder, job = Path(sys.argv[1]), json.loads(sys.stdin.readline())
with (folder / 'asked').open('a') as file:
    file.write(json.dumps({**job, 'nice': os.nice(0)}) + '\\n')
answer = json.loads((folder / 'answer').read_text())
if answer is None:
    sys.stdin.read()
if answer.get('learnt'):
    shutil.copy(answer['path'], job['output'])
    answer['path'] = job['output']
print(json.dumps(answer))
"""


class Learner:
    """A node that learns, what it hears, and what its job answers."""

    def __init__(self, rig, folder, clock, mode='propose', **more):
        self._folder, self._clock = folder, clock
        self.answer(success=True, message='no better model')
        self.rig = rig(namespace='/learner', parameters={**NEEDED, 'learning.mode': mode, **more})
        self.node, self.days = self.rig.node, self.rig.directory / 'days'

    def answer(self, **fields):
        said = {'learnt': False, 'paused': '', 'incident': '', **fields} if fields else None
        (self._folder / 'answer').write_text(json.dumps(said))

    def find(self, stored, **more):
        self.answer(
            success=True, learnt=True, path=str(stored.path), sha256=stored.sha256,
            document=stored.document, **{'message': 'leaves half', **more},
        )  # fmt: skip

    def asked(self):
        path = self._folder / 'asked'
        whole, _, _ = path.read_text().rpartition('\n') if path.exists() else ('', '', '')
        return [json.loads(line) for line in whole.splitlines()]  # the last may be half written

    def hear(self, cells, later=0):
        """Send cells, some of them later than the last: wrench, specific force, temperature."""
        self._clock[0] += later
        for _ in range(cells):
            stamp = START + self._clock[0] * SECOND + SECOND // 2
            self.rig.put(stamp, [12.3456789, 0.5, 123.456789, 0.1, 0.2, 0.3])
            self.node.broadcast('on_specific_force', stamp, (0.0, 0.0, 9.80665), 0.01)
            warmth = 25.0 + 0.01 * self._clock[0]
            self.rig.put_temperature(stamp, *[warmth] * self.rig.thermometers)
            self._clock[0] += 1

    def a_day(self):
        """Let a day pass, and a job judge it."""
        jobs = len(self.asked())
        self.hear(147)
        self.judged(jobs + 1)

    def files(self):
        return sorted(file.name for file in self.days.glob('*.csv'))

    def wait(self, condition, what):
        self.rig.wait_until(condition, what)

    def judged(self, jobs=1):
        """Wait until a number of jobs have answered."""
        learning = self.node.learning
        self.wait(lambda: len(self.asked()) >= jobs and learning._judging is None, 'the job')


@pytest.fixture
def learner(rig, tmp_path, monkeypatch):
    """Start nodes that learn, all with the same data_directory."""
    command = (sys.executable, '-c', JOB, str(tmp_path))
    monkeypatch.setattr('wrist_ft_comp.node.calibration_services.COMMAND', command)
    monkeypatch.setattr('wrist_ft_comp.node.learner._LOOK_S', 0.0)
    for name in TIMES:
        monkeypatch.setattr(days, name, getattr(days, name) // SHORTER)
    return partial(Learner, rig, tmp_path, [0])
