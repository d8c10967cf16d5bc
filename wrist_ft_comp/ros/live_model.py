"""Which model is live: choosing the first, swapping, rolling back, remembering."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wrist_ft_comp.errors import SettingsError, WristFtCompError
from wrist_ft_comp.files.model_file import load_model
from wrist_ft_comp.files.model_store import ModelStore
from wrist_ft_comp.model.drift_model import check_fits, DriftModel, StoredModel
from wrist_ft_comp.ros.diagnostics import summary
from wrist_ft_comp.ros.node_log import NodeLog


@dataclass(frozen=True, eq=False)
class Choice:
    """The model to start with."""

    #: None is no compensation.
    stored: StoredModel | None
    #: Newest last, the chosen one included; None stands for no compensation.
    history: list[Path | None]
    #: Why the model that should be live is not, or will not be after a restart.
    problem: str = ''


def choose_first_model(
    store: ModelStore, model_file: str, thermometers: int, node_log: NodeLog
) -> Choice:
    """Choose the model to start with: the newest decision counts; a given one must be usable."""
    # A model_file that differs from the one of the last start, in name or in content, is a new
    # decision of the operator's. One that does not is as old as that start, an empty one is none:
    # what a calibration or a rollback made live since goes on.
    store.sweep()
    given = load_fitting(store.locate(model_file), thermometers) if model_file else None
    choice = _last_choice(store, thermometers, node_log)
    if given is not None:
        choice = _newer(store, given, choice, node_log)
    if choice.stored is None:
        node_log.warning(
            'no model: wrenches are not compensated. Record a warm-up (~/record), then call '
            '~/calibrate.'
        )
    else:
        _announce(choice.stored, node_log)
    return choice


def _last_choice(store: ModelStore, thermometers: int, node_log: NodeLog) -> Choice:
    """Load the model that was live last; one that cannot be used leaves none live."""
    history: list[Path | None] = []
    try:
        history = store.history()
        last = history[-1] if history else None
        stored = None if last is None else load_fitting(last, thermometers)
    except WristFtCompError as error:
        problem = f'The last model cannot be used: {error}'
        node_log.error(problem)
        return Choice(None, [*history[:-1], None], problem)
    return Choice(stored, history)


def _newer(store: ModelStore, given: StoredModel, last: Choice, node_log: NodeLog) -> Choice:
    """Decide between the operator's model and the one that was live last."""
    if given.sha256 == store.given() and last.history and not last.problem:
        if last.stored is None or last.stored.sha256 != given.sha256:
            now = 'no model' if last.stored is None else last.stored.path
            node_log.warning(
                f'model_file is {given.path} as at the last start, and {now} was made live '
                'after that: the latter goes on. Call ~/rollback, or set model_file while '
                'running, to go back.'
            )
        return last
    history = last.history
    if not history or history[-1] != given.path:
        history = [*history, given.path]
    return Choice(given, history, _remember(store, history, node_log, given.sha256))


def _remember(
    store: ModelStore, history: list[Path | None], node_log: NodeLog, given: str | None = None
) -> str:
    """Keep the history over a restart; return what went wrong, if anything did."""
    try:
        store.activate(history, given)
    except WristFtCompError as error:
        node_log.error(str(error))
        return str(error)
    return ''


def _announce(stored: StoredModel, node_log: NodeLog) -> None:
    """Log what is live."""
    node_log.info(f'{summary(stored)} with {stored.path} ({stored.sha256[:12]})')


def load_fitting(path: Path, thermometers: int) -> StoredModel:
    """Load a model, and refuse one of other thermometers or units than the node has."""
    stored = load_model(path)
    check_fits(stored.model, thermometers, name=path)
    return stored


class LiveModel:
    """Owns the live model and those before it; ``swap`` makes one live, or raises and does not."""

    def __init__(
        self,
        store: ModelStore,
        thermometers: int,
        first: Choice,
        swap: Callable[[DriftModel | None], None],
        log: NodeLog,
    ) -> None:
        #: What is live; None is no compensation.
        self.stored = first.stored
        #: Why the model that should be live is not, or will not be after a restart.
        self.problem = first.problem
        self._history = first.history
        self._store = store
        self._thermometers = thermometers
        self._swap = swap
        self._log = log
        #: Kept, because it goes live next, and reading it takes tens of milliseconds.
        self._validated: StoredModel | None = None

    @property
    def sha256(self) -> str | None:
        """Hash of the live model's file."""
        return None if self.stored is None else self.stored.sha256

    def load(self, path: Path) -> StoredModel:
        """Load a model that could go live."""
        return load_fitting(path, self._thermometers)

    def take(self, stored: StoredModel) -> str:
        """Make a new model live; return why it could not be remembered, or nothing."""
        self._make_live(stored)
        return self._remember([*(self._history or [None]), stored.path])

    def _make_live(self, stored: StoredModel | None) -> None:
        """Swap a model in and say so."""
        self._swap(None if stored is None else stored.model)
        self.stored = stored
        if stored is not None:
            _announce(stored, self._log)

    def _remember(self, history: list[Path | None]) -> str:
        """Keep the history over a restart; return what went wrong, if anything did."""
        self._history = history
        self.problem = _remember(self._store, history, self._log)
        return self.problem

    def check_parameters(self, parameters: Sequence[Any]) -> None:
        """Refuse files outside data_directory and unusable models; changes nothing that runs."""
        for parameter in parameters:
            if parameter.name in {'model_file', 'calibration.recordings'}:
                self._validate(parameter.name, parameter.value)

    def _validate(self, name: str, value: Any) -> None:
        """Refuse one of these parameters, if there is a reason."""
        store = self._store
        for given in [value] if name == 'model_file' else value or []:
            if given and not store.contains(store.locate(given)):
                raise SettingsError(
                    f'{name} set at run time must lie inside data_directory ({store.directory}); '
                    f'got {given}. Copy the file there, or give it at start-up.'
                )
        if name == 'model_file' and value:
            path = store.locate(value)
            if path.exists() and not path.is_file():
                # A pipe would hold up the stream until somebody writes into it.
                raise SettingsError(
                    f'model_file must be a file; {path} is none. Make one with wrist_ft_comp '
                    'calibrate.'
                )
            self._validated = load_fitting(path, self._thermometers)

    def use_file(self, given: str) -> None:
        """Make the model of a file live and remember it; it was validated before."""
        try:
            path, stored = self._store.locate(given), self._validated
            self._validated = None
            if stored is None or stored.path != path:
                stored = load_fitting(path, self._thermometers)
            self._make_live(stored)
        except WristFtCompError as error:
            self._log.error(str(error))
            return
        before = self._history or [None]
        again = before[-1] == stored.path
        self._remember(before if again else [*before, stored.path])

    def roll_back(self) -> str:
        """Go back to the model before the live one; say which."""
        if len(self._history) < 2:
            raise SettingsError(
                'There is no earlier model to go back to; the running model stays.'
            )
        *earlier, before, live = self._history
        try:
            self._make_live(None if before is None else load_fitting(before, self._thermometers))
        except WristFtCompError as error:
            # Taken off the list, or it would bar the way to those before it.
            self._remember([*earlier, live])
            raise SettingsError(
                f'{error} The running model stays; call again for the model before that one.'
            ) from error
        problem = self._remember([*earlier, before])
        now = (
            'no model was live before: wrenches pass uncompensated'
            if before is None
            else f'compensating with {before} again'
        )
        return f'{now}\nwarning: {problem}' if problem else now
