"""The part that owns the live model: the first one, swaps, rollbacks, and their history."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from functools import partial
import math
from pathlib import Path
from typing import Any

import numpy as np

from wrist_ft_comp.channels import AXES, axis_unit, SensorNames
from wrist_ft_comp.drift.drift_model import check_fits, check_sensor, StoredModel
from wrist_ft_comp.errors import SettingsError, WristFtCompError
from wrist_ft_comp.node.raw_wrench import Counts
from wrist_ft_comp.ros.diagnostics import ERROR, OK, Status, WARN
from wrist_ft_comp.ros.hub import Part
from wrist_ft_comp.ros.parameters import Parameter
from wrist_ft_comp.ros.services import service, warned, Work
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.node_folder import HistoryEntry, How, NodeFolder
from wrist_ft_comp.stored.safe_file import FileWriter
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.stream.drift_limits import axis_limits

#: A model is doubted that leaves more than this of held-out drift, N, and more than half of it.
_MOST_LEFT_N = 1.0


@dataclass(eq=False)
class LiveModel(Part):
    """
    Owns the live model and those before it.

    It starts with the newest decision. A model_file with other content than at the last start that
    gave one is a new decision of the operator, and has to be usable. Otherwise the model goes on
    that a calibration or a rollback has made live since that start.
    """

    store: NodeFolder
    sensor: Callable[[], SensorNames]
    compensator: Compensator
    counts: Counts
    writer: FileWriter
    #: Why the right model is not live, or will not be live after a restart.
    problem: str = ''
    #: The live model; None is no compensation.
    stored: StoredModel | None = None
    #: Models that were live, the live one last.
    history: list[HistoryEntry] = field(default_factory=list)
    #: Ends the day that is being recorded, before a person's decision is written down.
    end_day: Callable[[], None] = lambda: None
    #: SHA-256 of the model that the operator gave at the last start; empty where there was none.
    _given: str = ''
    #: Model of a model_file that was checked and goes live next; loading it takes tens of ms.
    _validated: StoredModel | None = None
    #: How often the history is yet to be written.
    _unwritten: int = 0

    title = 'model'
    parameters = (
        Parameter(
            'model_file', '',
            'Model to run, relative to data_directory or to the working directory; empty takes '
            'the one that was live last. If its content, whatever its name, is that of the last '
            'start with a model_file, a model that went live after that (by a calibration, '
            'adoption or rollback) stays live. Set at run time, it must lie inside '
            'data_directory, or have been live before.'),
    )  # fmt: skip

    def start(self) -> None:
        """Choose the first model: that of model_file, or the one that was live last."""
        log, store, model_file = self.hub.log, self.store, self.hub.chosen()['model_file']
        self.writer.problems['state.json'] = store.take()
        given = self.load(store.locate(model_file)) if model_file else None
        try:
            self.history, self._given = store.history(), store.given()
            if self.history and self.history[-1].path is not None:
                self.stored = self.load(self.history[-1].path)
        except WristFtCompError as error:
            self.problem = f'The last model cannot be used: {error}'
            last = self.history.pop() if self.history else HistoryEntry(None)
            self.history.append(replace(last, path=None, sha256=''))
        unusable = self.problem
        if given is not None:
            if given.sha256 != self._given or not self.history or self.problem:
                self.stored, self._given = given, given.sha256
                self._write_down(f'model_file was {given.path.name} at the start')
                if unusable:
                    log.warning(f'{unusable} {given.path} is live instead.')
            elif self.sha256 != given.sha256:
                now = 'no model' if self.stored is None else self.stored.path
                log.warning(
                    f'model_file is {given.path} with the content of the last start with one. '
                    f'After that {now} was made live, and goes on. Call ~/rollback, or set '
                    'model_file while running, to go back.'
                )
        if self.stored is not None:
            if self.stored.sha256 != self.history[-1].sha256:
                self.problem = (
                    f'{self.stored.path} has changed since it was live, and runs as it is now; '
                    'set model_file to it if that is right, or call ~/rollback'
                )
            self._make_live(self.stored)

    def end(self) -> None:
        """Leave the folder to other nodes."""
        self.store.release()

    def statuses(self) -> Iterator[Status]:
        """Report the live model."""
        stored, unsaved = self.stored, self.writer.problems.get('state.json', '')
        if stored is None:
            why = self.problem or 'no model; record a warm-up and call ~/calibrate'
            why = f'{why}; {unsaved}' if unsaved else why
            yield Status(self.title, ERROR if self.problem else WARN, why)
            return
        numbers = {
            'file': str(stored.path),
            'sha256': stored.sha256,
            'axes': ', '.join(stored.model.axes) or 'none',
        }
        for j, entry in enumerate(stored.document['thermometers'], start=1):
            numbers[f'thermometer_{j}_calibrated_c'] = '{:.1f} to {:.1f}'.format(*entry['range_c'])
        trouble = self.problem or unsaved or ''.join(check_sensor(stored, self.sensor()))
        if not stored.model.axes:
            trouble = trouble or (
                'the model compensates no axis, because nothing could be learnt; record a warm-up '
                'and call ~/calibrate'
            )
        # The answer of ~/calibrate said why; who comes after a restart reads the status alone.
        for axis, largest in zip(AXES, axis_limits(_MOST_LEFT_N), strict=True):
            entry = stored.document['axes'].get(axis)
            if entry and entry['rms_after'] > max(largest, entry['rms_before'] / 2):
                trouble = trouble or (
                    f'the model leaves {entry["rms_after"]:.2g} {axis_unit(axis)} (RMS) of the '
                    f'drift of {axis}, more than half; see wrist_ft_comp show'
                )
        raw = () if self.counts.newest is None else np.nan_to_num(self.counts.newest[1])
        # An axis that drifts too little for a model was calibrated, too.
        new = [axis for axis, value in zip(AXES, raw, strict=False) if value]
        if new := [axis for axis in new if axis not in stored.model.deviation]:
            trouble = trouble or (
                f'the model knows nothing of {", ".join(new)}, which drift as before; record a '
                'warm-up and call ~/calibrate'
            )
        yield Status(self.title, WARN if trouble else OK, trouble or summary(stored), numbers)

    @property
    def sha256(self) -> str | None:
        """Hash of the live model's file."""
        return None if self.stored is None else self.stored.sha256

    def load(self, path: Path) -> StoredModel:
        """Load a model; refuse other thermometers, or another order of them."""
        stored, sensor = load_model(path), self.sensor()
        check_fits(stored.model, len(sensor['temperature_topics']), name=path)
        check_sensor(stored, sensor)
        return stored

    def take(self, stored: StoredModel, why: str, judged: str = '') -> None:
        """
        Make a new model live; ``kept`` waits until that is remembered.

        ``why`` is the reason in a sentence, ``judged`` the newest day that was judged, where the
        node itself decided; empty where a person did.
        """
        self._make_live(stored)
        self.history = self.history or [HistoryEntry(None)]
        self._write_down(why, 'learnt' if judged else 'chosen', judged)

    def _make_live(self, stored: StoredModel | None) -> None:
        stream, newest = self.compensator, self.counts.newest
        keep = newest[:2] if newest else None
        if keep is None and stream.tared:  # no wrench has come: unloaded
            keep = stream.tracker.end_ns, [math.nan] * len(AXES)
        stream.go_live(stored.model if stored else None, keep)
        self.stored = stored
        if stored is not None:
            self.hub.log.info(f'{summary(stored)} with {stored.path} ({stored.sha256[:12]})')

    def _write_down(self, why: str, how: How = 'chosen', judged: str = '') -> None:
        """Remember that the live model is live from now on; no news where it was live before."""
        path, sha256 = (self.stored.path, self.stored.sha256) if self.stored else (None, '')
        last = self.history[-1] if self.history else None
        if not last or last.withdrawn or (last.path, last.sha256) != (path, sha256):
            if last and last.path == path:  # its file has changed: what was in it is gone
                self.history[-1] = replace(last, withdrawn=True)
            if how != 'learnt':
                self.end_day()
            since = datetime.now(timezone.utc).isoformat(timespec='seconds')
            day = judged or self.store.newest_day()
            self.history.append(HistoryEntry(path, sha256, since, why, how, day))
        self._remember()

    def _remember(self) -> None:
        """Have the history written."""

        def note(problem: str) -> None:
            self._unwritten, self.problem = self._unwritten - 1, problem

        self._unwritten, self.problem = self._unwritten + 1, ''
        write = partial(self.store.activate, tuple(self.history), self._given)
        self.writer.put('active.json', write, note)

    def kept(self, answer: str) -> Work:
        """Wait until the history is on the disk; give an answer, perhaps with a warning."""
        while self._unwritten:
            yield
        return warned(answer, self.problem)

    def check_parameters(self, parameters: Sequence[Any]) -> None:
        """Refuse files outside data_directory and unusable models; changes nothing that runs."""
        for value in (given.value for given in parameters if given.name == 'model_file'):
            # One that was live before was named at a start.
            if self.store.locate(value) not in [entry.path for entry in self.history]:
                self.store.require_inside('model_file', value)
            self._validated = self.load(self.store.locate(value)) if value else None

    def apply_parameters(self, parameters: Sequence[Any]) -> None:
        """Make the model of a changed model_file live, which was loaded to check it."""
        stored, self._validated = self._validated, None
        if stored is not None and any(given.name == 'model_file' for given in parameters):
            self.take(stored, f'a person set model_file to {stored.path.name}')

    @service('~/rollback', 'goes back to the model before the last calibration or adoption')
    def roll_back(self, _: Any) -> Work:
        """Go back to the model before the live one; say which."""
        history = self.history
        standing = [n for n, entry in enumerate(history) if not entry.withdrawn]
        if len(standing) < 2:
            raise SettingsError('There is no earlier model to go back to; nothing changes.')
        before, live = standing[-2:]
        path, left = history[before].path, history[live].path
        # Withdrawn also where it cannot be used, or those before it could never be reached.
        history[before] = replace(history[before], withdrawn=True)
        try:
            stored = None if path is None else self.load(path)
            if stored and history[before].sha256 not in {'', stored.sha256}:
                raise SettingsError(f'{path} has changed since it was live.')
            self._make_live(stored)
        except WristFtCompError as error:
            self._remember()
            raise SettingsError(
                f'{error} The running model stays; call again for the model before that one.'
            ) from error
        history[live] = replace(history[live], withdrawn=True)
        names = [one.name if one else 'no model' for one in (left, path)]
        self._write_down(
            f'a person went back from {names[0]} to {names[1]} with ~/rollback', 'back'
        )
        now = (
            'no model was live before: wrenches pass uncompensated until model_file is set to '
            f'{left} while running'
        )
        if path is not None:
            now = f'compensating with {path} again'
        return (yield from self.kept(now))


def summary(stored: StoredModel) -> str:
    """Say how many axes a live model compensates, and which it does not."""
    count = len(stored.model.axes)
    others = ', '.join(axis for axis in AXES if axis not in stored.model.axes)
    passing = f'; {others}, which it does not know, pass as they are' if count and others else ''
    return f'compensating {count} {"axis" if count == 1 else "axes"}{passing}'
