"""Which model is live: calibrating, rolling back, loading, remembering."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wrist_ft_comp import RecordingError, SettingsError, WristFtCompError
from wrist_ft_comp.core.calibration import CalibrationSettings
from wrist_ft_comp.core.identification import IdentificationSettings
from wrist_ft_comp.core.recording import NANOSECONDS
from wrist_ft_comp.files.calibration_job import CalibrationJob
from wrist_ft_comp.files.model_file import StoredModel, load_model, restore_model
from wrist_ft_comp.files.recordings import Topics
from wrist_ft_comp.ros.calibration_process import CalibrationProcess
from wrist_ft_comp.ros.compensator_parameters import PARAMETERS
from wrist_ft_comp.ros.deferred_service import Reply
from wrist_ft_comp.ros.parameters import values

if TYPE_CHECKING:
    from wrist_ft_comp.ros.compensator_node import CompensatorNode


class CalibrationControl:
    """
    Owns the live model of a node, and the process that makes the next one.

    Parameters
    ----------
    node : CompensatorNode
        The owner.

    """

    def __init__(self, node: 'CompensatorNode') -> None:
        self.stored: StoredModel | None = None
        self.last_outcome = ''
        self.refused = False
        self._node = node
        self._history: list[Path | None] = []
        self._running: tuple[CalibrationProcess, Reply, float] | None = None

    @property
    def running_s(self) -> float | None:
        """How long a calibration has been running, s; None when none is."""
        return None if self._running is None else time.monotonic() - self._running[2]

    def start_with(self, model_file: str) -> None:
        """
        Take the model a parameter names, or the one that was live last.

        Parameters
        ----------
        model_file : str
            The operator's choice; empty for the last one. An unusable choice ends the node; an
            unusable last one is reported, and the node starts without a model.

        Raises
        ------
        WristFtCompError
            When model_file cannot be used.

        """
        logger = self._node.get_logger()
        if model_file:
            path = Path(model_file).expanduser()
            self._swap(load_model(path))
            self._history = [path]
            return
        try:
            self._history = self._node.store.history()
            last = self._history[-1] if self._history else None
            if last is not None:
                self._swap(load_model(last))
        except WristFtCompError as error:
            self.last_outcome, self.refused = str(error), True
            logger.error(f'The last model cannot be used: {error}')
        if self.stored is None:
            logger.warning(
                'no model: wrenches are not compensated. Record a warm-up (~/record), then call '
                '~/calibrate.'
            )

    def _swap(self, stored: StoredModel | None) -> None:
        """Make a model live, without a step in the output; the old one stays when this raises."""
        self._node.compensator.go_live(None if stored is None else stored.model)
        self.stored = stored
        if stored is not None:
            self._node.get_logger().info(
                f'compensating {len(stored.model.axes)} axes with {stored.path} '
                f'({stored.sha256[:12]})'
            )

    def judge(self, name: str, value: Any) -> None:
        """
        Check a parameter that names files, without side effects.

        Parameters
        ----------
        name : str
            Parameter.
        value : object
            What it would become.

        Raises
        ------
        WristFtCompError
            When a file lies outside data_directory, or the model cannot be used.

        """
        store = self._node.store
        paths = (
            [value] if name == 'model_file' else value if name == 'calibration.recordings' else []
        )
        for path in paths or []:
            if path and not store.contains(Path(path)):
                raise SettingsError(
                    f'{name} set at run time must lie inside data_directory ({store.directory}); '
                    f'got {path}. Copy the file there, or give it at start-up.'
                )
        if name == 'model_file' and value:
            model = load_model(Path(value)).model
            if model.thermometers != self._node.compensator.thermometers:
                raise SettingsError(
                    f'{value} expects {model.thermometers} thermometers, the node has '
                    f'{self._node.compensator.thermometers} (temperature_topics).'
                )

    def use_file(self, path: Path) -> None:
        """Make a file's model live and remember it; it was judged before."""
        try:
            self._swap(load_model(path))
            self._remember([*self._history, path])
        except WristFtCompError as error:
            self._node.get_logger().error(str(error))

    def on_request(self, _request: Any, reply: Reply) -> None:
        """Start a calibration; the answer comes when it is done."""
        if self._running is not None:
            reply(
                success=False,
                message=f'A calibration has been running for {self.running_s:.0f} s; wait for its '
                'answer, then call again.',
            )
            return
        try:
            job = self._job()
        except WristFtCompError as error:
            self._refuse(str(error), reply)
            return
        self._running = (CalibrationProcess(job), reply, time.monotonic())

    def _job(self) -> CalibrationJob:
        """Build the job from the parameters."""
        node = self._node
        given = values(node, PARAMETERS)
        named = tuple(Path(path).expanduser() for path in given['calibration.recordings'])
        recordings = named or tuple(node.store.recordings())
        if not recordings:
            raise RecordingError(
                f'There is no recording in {node.store.directory / "recordings"}. Record a '
                'warm-up with ~/record, or set calibration.recordings.'
            )
        return CalibrationJob(
            recordings=recordings,
            output=node.store.new_model_path(),
            settings=CalibrationSettings(
                reference=given['calibration.reference'],
                min_temperature_span_k=given['calibration.min_temperature_span'],
                identification=IdentificationSettings(method=given['calibration.method']),
            ),
            period_s=node.compensator.grid.period_ns / NANOSECONDS,
            topics=Topics(
                wrench=node.raw_subscription.topic_name,
                temperatures=tuple(s.topic_name for s in node.temperature_subscriptions),
                reference=node.resolve_topic_name('wrench_reference'),
            ),
            skip_unusable=not named,
        )

    def poll(self) -> None:
        """Look whether the calibration is done; if so, swap its model in and answer."""
        if self._running is None:
            return
        process, reply, _ = self._running
        outcome = process.poll()
        if outcome is None:
            return
        self._running = None
        if not outcome['success']:
            self._refuse(outcome['message'], reply)
            return
        try:
            path = Path(outcome['path'])
            self._swap(restore_model(path, outcome['sha256'], outcome['document']))
            self._remember([*(self._history or [None]), path])
        except WristFtCompError as error:
            self._refuse(str(error), reply)
            return
        self.last_outcome, self.refused = outcome['message'], False
        self._node.get_logger().info(f'calibrated: {outcome["message"]}')
        reply(success=True, message=outcome['message'])

    def _refuse(self, why: str, reply: Reply) -> None:
        """Answer that nothing changed, and why."""
        self.last_outcome, self.refused = why, True
        self._node.get_logger().error(f'not calibrated: {why}')
        reply(success=False, message=why)

    def on_rollback(self, _request: Any, response: Any) -> Any:
        """Go back to the model before the last calibration."""
        try:
            response.message, response.success = self._roll_back(), True
        except WristFtCompError as error:
            response.message, response.success = str(error), False
        return response

    def _roll_back(self) -> str:
        """Swap the previous model in; say which."""
        if len(self._history) < 2:
            raise SettingsError(
                'There is no earlier model to go back to; the running model stays.'
            )
        before = self._history[-2]
        self._swap(None if before is None else load_model(before))
        self._remember(self._history[:-1])
        if before is None:
            return 'no model was live before: wrenches pass uncompensated'
        return f'compensating with {before} again'

    def _remember(self, history: list[Path | None]) -> None:
        """Keep the history over a restart."""
        self._history = history
        self._node.store.activate(history)

    def end(self) -> None:
        """Stop a running calibration; its asker is told."""
        if self._running is not None:
            process, reply, _ = self._running
            self._running = None
            process.end()
            reply(success=False, message='The node is shutting down; the model is unchanged.')
