"""The part that owns the live model: the first one, swaps, rollbacks, and their history."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from std_srvs.srv import Trigger

from wrist_ft_comp.channels import SensorNames
from wrist_ft_comp.drift.drift_model import check_fits, check_sensor, DriftModel, StoredModel
from wrist_ft_comp.errors import SettingsError, WristFtCompError
from wrist_ft_comp.ros.diagnostics import ERROR, OK, Status, WARN
from wrist_ft_comp.ros.hub import Hub, Part
from wrist_ft_comp.ros.parameters import Parameter
from wrist_ft_comp.ros.services import Service
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.model_store import HistoryEntry, How, ModelStore
from wrist_ft_comp.stored.state_file import StateWriter


@dataclass(eq=False, kw_only=True)
class LiveModel(Part):
    """
    Owns the live model and those before it.

    ``sensor`` gives the names of the sensor; ``swap`` gives a model to the stream, or raises
    without a change.

    It starts with the newest decision. A model_file with other content than at the last start is a
    new decision of the operator, and has to be usable. Otherwise the model goes on that a
    calibration or a rollback has made live since that start.
    """

    store: ModelStore
    sensor: Callable[[], SensorNames]
    swap: Callable[[DriftModel | None], None]
    writer: StateWriter
    hub: Hub = field(init=False)
    #: Why the right model is not live, or will not be live after a restart.
    problem: str = ''
    #: The live model; None is no compensation.
    stored: StoredModel | None = None
    #: Models that were live, the live one last.
    history: list[HistoryEntry] = field(default_factory=list)
    #: Ends the day that is being recorded, before a person's decision is written down.
    end_day: Callable[[], None] = lambda: None
    #: Model of a model_file that was checked and goes live next; loading it takes tens of ms.
    _validated: StoredModel | None = None
    #: Why the live model may be of another sensor, as it was logged.
    _doubt: str = ''

    title = 'model'
    parameters = (
        Parameter(
            'model_file', '',
            'Model to run, relative to data_directory or to the working directory; empty takes '
            'the one that was live last. Where it is the same as at the last start, the model of '
            'a calibration or rollback since then goes on. Set at run time, it must lie inside '
            'data_directory.'),
    )  # fmt: skip

    @classmethod
    def services(cls) -> Sequence[Service]:
        """Offer ~/rollback."""
        purpose = 'goes back to the model before the last calibration or adoption'
        return (Service(Trigger, '~/rollback', purpose, cls.roll_back),)

    def start(self) -> None:
        """Choose the first model."""
        model_file = self.hub.chosen()['model_file']
        self.store.sweep()
        given = self.load(self.store.locate(model_file)) if model_file else None
        self.stored = self._last()
        if given is not None:
            self._prefer(given)
        if self.stored is None:
            self.hub.log.warning(
                'no model: wrenches are not compensated. Record a warm-up (~/record), then call '
                '~/calibrate.'
            )
        else:
            self.swap(self.stored.model)
            self._announce(self.stored)

    def end(self) -> bool:
        """Leave the folder to other nodes."""
        self.store.release()
        return False

    def statuses(self) -> Iterator[Status]:
        """Report the live model."""
        stored, saved = self.stored, self.writer
        numbers = {
            'state_saves': str(saved.written),
            'state_save_took_ms': f'{1e3 * saved.took_s:.1f}',
        }
        if stored is None:
            why = self.problem or 'no model; record a warm-up and call ~/calibrate'
            why = f'{why}; {saved.problem}' if saved.problem else why
            yield Status(self.title, ERROR if self.problem else WARN, why, numbers)
            return
        numbers |= {
            'file': str(stored.path),
            'sha256': stored.sha256,
            'created': str(stored.document['provenance'].get('created', '')),
            'axes': ', '.join(stored.model.axes) or 'none',
            'period_s': f'{stored.model.period_ns / 1e9:g}',
        }
        for j, entry in enumerate(stored.document['thermometers'], start=1):
            numbers[f'thermometer_{j}_calibrated_c'] = '{:.1f} to {:.1f}'.format(*entry['range_c'])
        numbers |= {f'learnt_from_{fact}': ', '.join(n) for fact, n in stored.sensor.items()}
        doubt, before = ''.join(check_sensor(stored, self.sensor())), self._doubt
        self._doubt = doubt
        if doubt and doubt != before:
            self.hub.log.warning(doubt)
        trouble = self.problem or saved.problem or doubt
        if not stored.model.axes:
            trouble = trouble or (
                'the model compensates no axis, because nothing could be learnt; record a warm-up '
                'and call ~/calibrate'
            )
        yield Status(self.title, WARN if trouble else OK, trouble or summary(stored), numbers)

    def _last(self) -> StoredModel | None:
        """Load the model that was live last; one that cannot be used leaves none live."""
        try:
            self.history = self.store.history()
            last = self.history[-1].path if self.history else None
            return None if last is None else self.load(last)
        except WristFtCompError as error:
            self.problem = f'The last model cannot be used: {error}'
        self.hub.log.error(self.problem)
        last_entry = self.history[-1] if self.history else HistoryEntry(None)
        self.history = [*self.history[:-1], replace(last_entry, path=None, sha256='')]
        return None

    def _prefer(self, given: StoredModel) -> None:
        """Take the operator's model, unless what was live last is a newer decision."""
        if given.sha256 == self.store.given() and self.history and not self.problem:
            if self.sha256 != given.sha256:
                now = 'no model' if self.stored is None else self.stored.path
                self.hub.log.warning(
                    f'model_file is {given.path} as at the last start, and {now} was made live '
                    'after that: the latter goes on. Call ~/rollback, or set model_file while '
                    'running, to go back.'
                )
            return
        self.stored = given
        self._go_on(f'model_file was {given.path.name} at the start', given=given.sha256)

    def _announce(self, stored: StoredModel) -> None:
        self.hub.log.info(f'{summary(stored)} with {stored.path} ({stored.sha256[:12]})')

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

    def take(self, stored: StoredModel, why: str, judged: str = '') -> str:
        """
        Make a new model live; return why it could not be remembered, or nothing.

        ``why`` is the reason in a sentence, ``judged`` the newest day that was judged, where the
        node itself decided; empty where a person did.
        """
        self._make_live(stored)
        self.history = self.history or [HistoryEntry(None)]
        return self._go_on(why, 'learnt' if judged else 'chosen', judged)

    def _go_on(
        self, why: str, how: How = 'chosen', judged: str = '', given: str | None = None
    ) -> str:
        """Write down that the live model is live from now on; nothing where it was live before."""
        path, sha256 = (self.stored.path, self.stored.sha256) if self.stored else (None, '')
        last = self.history[-1] if self.history else None
        if last and not last.withdrawn and (last.path, last.sha256) == (path, sha256):
            return self._remember(self.history, given)
        if last and last.path == path:  # its file has changed: what was in it cannot come back
            self.history[-1] = replace(last, withdrawn=True)
        if how != 'learnt':
            self.end_day()
        since = datetime.now(timezone.utc).isoformat(timespec='seconds')
        day = judged or self.store.newest_day()
        entry = HistoryEntry(path, sha256, since, why, how, day)
        return self._remember([*self.history, entry], given)

    def _make_live(self, stored: StoredModel | None) -> None:
        """Swap a model in, say so, and let all parts follow."""
        self.swap(None if stored is None else stored.model)
        self.stored = stored
        if stored is not None:
            self._announce(stored)
        self.hub.broadcast('on_model')

    def _remember(self, history: list[HistoryEntry], given: str | None = None) -> str:
        """Keep the history over a restart; return what went wrong, if anything did."""
        self.history, self.problem = history, ''
        try:
            self.store.activate(history, given)
        except WristFtCompError as error:
            self.problem = str(error)
        if self.problem:
            self.hub.log.error(self.problem)
        return self.problem

    def check_parameters(self, parameters: Sequence[Any]) -> None:
        """Refuse files outside data_directory and unusable models; changes nothing that runs."""
        for parameter in parameters:
            if parameter.name in {'model_file', 'calibration.recordings'}:
                self._validate(parameter.name, parameter.value)

    def _validate(self, name: str, value: Any) -> None:
        store = self.store
        for given in [value] if name == 'model_file' else value or []:
            if given and not store.contains(store.locate(given)):
                raise SettingsError(
                    f'{name} set at run time must lie inside data_directory ({store.directory}); '
                    f'got {given}. Copy the file there, or give it at start-up.'
                )
        if name == 'model_file':
            self._validated = self.load(store.locate(value)) if value else None

    def apply_parameters(self, parameters: Sequence[Any]) -> None:
        """Make the model of a changed model_file live, which was loaded to check it."""
        stored, self._validated = self._validated, None
        if stored is not None and any(given.name == 'model_file' for given in parameters):
            self._make_live(stored)
            self.history = self.history or [HistoryEntry(None)]
            self._go_on(f'a person set model_file to {stored.path.name}')

    def roll_back(self, *_: Any) -> str:
        """Go back to the model before the live one; say which."""
        history = self.history
        standing = [n for n, entry in enumerate(history) if not entry.withdrawn]
        if len(standing) < 2:
            raise SettingsError(
                'There is no earlier model to go back to; the running model stays.'
            )
        before, live = standing[-2:]
        path, left = history[before].path, history[live].path
        try:
            self._make_live(None if path is None else self.load(path))
        except WristFtCompError as error:
            # Withdrawn, or those before it could never be reached.
            history[before] = replace(history[before], withdrawn=True)
            self._remember(history)
            raise SettingsError(
                f'{error} The running model stays; call again for the model before that one.'
            ) from error
        for n in (before, live):
            history[n] = replace(history[n], withdrawn=True)
        back_to = 'no model' if path is None else path.name
        problem = self._go_on(
            f'a person went back from {left.name if left else "no model"} to {back_to} with '
            '~/rollback', 'back')  # fmt: skip
        now = (
            'no model was live before: wrenches pass uncompensated'
            if path is None
            else f'compensating with {path} again'
        )
        return f'{now}\nwarning: {problem}' if problem else now


def summary(stored: StoredModel) -> str:
    """Say how many axes a live model compensates."""
    count = len(stored.model.axes)
    return f'compensating {count} {"axis" if count == 1 else "axes"}'
