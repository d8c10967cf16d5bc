"""Which model is live: choosing the first, swapping, rolling back, remembering."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TYPE_CHECKING

from rcl_interfaces.msg import SetParametersResult

from wrist_ft_comp.errors import SettingsError, WristFtCompError
from wrist_ft_comp.files.model_file import load_model
from wrist_ft_comp.model.drift_model import StoredModel

if TYPE_CHECKING:
    from wrist_ft_comp.ros.compensator_node import CompensatorNode


class LiveModel:
    """
    Owns the live model of a node and the list of those before it.

    Parameters
    ----------
    node : CompensatorNode
        The owner.
    thermometers : int
        Number of thermometers J that the node listens to.

    """

    def __init__(self, node: 'CompensatorNode', thermometers: int) -> None:
        #: What is live; None is no compensation.
        self.stored: StoredModel | None = None
        #: Why the model that should be live is not, or will not be after a restart.
        self.problem = ''
        self._node = node
        self._thermometers = thermometers
        self._judged: StoredModel | None = None
        #: Newest last, the live one included; None stands for no compensation.
        self._history: list[Path | None] = []

    def first(self, model_file: str) -> StoredModel | None:
        """
        Choose the model to start with: the newest decision counts.

        A model_file that differs from the one of the last start, in name or in content, is a new
        decision of the operator's. One that does not is as old as that start, so what a
        calibration or a rollback made live since goes on.

        Parameters
        ----------
        model_file : str
            The operator's choice; empty for the one that was live last. An unusable choice ends
            the node; an unusable last one is reported.

        Returns
        -------
        StoredModel or None
            None when there is none.

        Raises
        ------
        WristFtCompError
            When model_file cannot be used.

        """
        self._node.store.sweep()
        chosen = self._load(self._node.store.locate(model_file)) if model_file else None
        self._recall()
        if chosen is not None:
            self._choose(chosen)
        if self.stored is None:
            self._node.console.warning(
                'no model: wrenches are not compensated. Record a warm-up (~/record), then call '
                '~/calibrate.'
            )
        else:
            self._announce(self.stored)
        return self.stored

    def _choose(self, chosen: StoredModel) -> None:
        """Decide between the operator's model and the one that was live last."""
        last = self.stored
        if chosen.sha256 == self._node.store.given() and self._history and not self.problem:
            if last is None or last.sha256 != chosen.sha256:
                now = 'no model' if last is None else last.path
                self._node.console.warning(
                    f'model_file is {chosen.path} as at the last start, and {now} was made live '
                    'after that: the latter goes on. Call ~/rollback, or set model_file while '
                    'running, to go back.'
                )
            return
        self.stored = chosen
        if not self._history or self._history[-1] != chosen.path:
            self._history = [*self._history, chosen.path]
        self._remember(self._history, chosen.sha256)

    def _recall(self) -> None:
        """Load the model that was live last; one that cannot be used leaves none live."""
        try:
            self._history = self._node.store.history()
            if self._history and self._history[-1] is not None:
                self.stored = self._load(self._history[-1])
        except WristFtCompError as error:
            self._history = [*self._history[:-1], None]
            self.problem = f'The last model cannot be used: {error}'
            self._node.console.error(self.problem)

    def _load(self, path: Path) -> StoredModel:
        """Load a model that fits this node."""
        stored = load_model(path)
        if stored.model.thermometers != self._thermometers:
            raise SettingsError(
                f'{path} expects {stored.model.thermometers} thermometers, the node has '
                f'{self._thermometers} (temperature_topics). Calibrate with these, or list the '
                "model's topics."
            )
        return stored

    @property
    def summary(self) -> str:
        """What is compensated, in a few words."""
        count = 0 if self.stored is None else len(self.stored.model.axes)
        return f'compensating {count} {"axis" if count == 1 else "axes"}'

    def _announce(self, stored: StoredModel) -> None:
        """Log what is live."""
        self._node.console.info(f'{self.summary} with {stored.path} ({stored.sha256[:12]})')

    def _swap(self, stored: StoredModel | None) -> None:
        """Make a model live, without a step in the output; the old one stays when this raises."""
        self._node.compensator.go_live(None if stored is None else stored.model)
        self.stored = stored
        self._node.recording.follow_period()
        if stored is not None:
            self._announce(stored)

    def _remember(self, history: list[Path | None], given: str | None = None) -> str:
        """Keep the history over a restart; return what went wrong, if anything did."""
        self._history, self.problem = history, ''
        try:
            self._node.store.activate(history, given)
        except WristFtCompError as error:
            self.problem = str(error)
            self._node.console.error(self.problem)
        return self.problem

    def take(self, stored: StoredModel) -> str:
        """
        Make a calibration's result live, and remember it.

        Parameters
        ----------
        stored : StoredModel
            The result.

        Returns
        -------
        str
            A sentence when it is live but could not be remembered, else empty.

        Raises
        ------
        WristFtCompError
            When it does not fit this node; the running model stays.

        """
        self._swap(stored)
        return self._remember([*(self._history or [None]), stored.path])

    def judge(self, parameters: Sequence[Any]) -> SetParametersResult:
        """
        Judge, without changing what runs, files that parameters name at run time.

        Parameters
        ----------
        parameters : sequence of rclpy.parameter.Parameter
            What is to be set.

        Returns
        -------
        SetParametersResult
            Refused when a file lies outside data_directory, or the model cannot be used.

        """
        try:
            for parameter in parameters:
                self._judge(parameter.name, parameter.value)
        except WristFtCompError as error:
            self._node.note_refusal('set_parameters', str(error))
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _judge(self, name: str, value: Any) -> None:
        """Refuse one parameter, if there is a reason."""
        if name not in {'model_file', 'calibration.recordings'}:
            return
        store = self._node.store
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
            # Kept, because it goes live next, and reading it takes tens of milliseconds.
            self._judged = self._load(path)

    def use_file(self, given: str) -> None:
        """Make the model of a file live and remember it; it was judged before."""
        try:
            path, judged = self._node.store.locate(given), self._judged
            stored = judged if judged and judged.path == path else self._load(path)
            self._judged = None
            self._swap(stored)
        except WristFtCompError as error:
            self._node.console.error(str(error))
            return
        before = self._history or [None]
        again = before[-1] == stored.path
        self._remember(before if again else [*before, stored.path])

    def on_rollback(self, _request: Any, response: Any) -> Any:
        """Go back to the model before the live one."""
        try:
            response.message, response.success = self._roll_back(), True
        except WristFtCompError as error:
            response.message, response.success = str(error), False
            self._node.note_refusal('~/rollback', str(error))
        return response

    def _roll_back(self) -> str:
        """Swap the model before in; say which."""
        if len(self._history) < 2:
            raise SettingsError(
                'There is no earlier model to go back to; the running model stays.'
            )
        before = self._history[-2]
        try:
            self._swap(None if before is None else self._load(before))
        except WristFtCompError as error:
            # Taken off the list, or it would bar the way to those before it.
            self._remember([*self._history[:-2], self._history[-1]])
            raise SettingsError(
                f'{error} The running model stays; call again for the model before that one.'
            ) from error
        problem = self._remember(self._history[:-1])
        now = (
            'no model was live before: wrenches pass uncompensated'
            if before is None
            else f'compensating with {before} again'
        )
        return f'{now}\nwarning: {problem}' if problem else now
