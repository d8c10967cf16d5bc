"""
The node ``compensator``: raw wrench and temperatures in, compensated wrench out.

A callback converts, steps, publishes. What it means is the core's business: this module wires topics,
services and parameters to it.
"""

import math
import os
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import Temperature
from std_srvs.srv import SetBool, Trigger

from wrist_ft_comp import RecordingError, SettingsError, WristFtCompError
from wrist_ft_comp.core.compensator import Compensator, StreamSettings
from wrist_ft_comp.core.recording import AXES, NANOSECONDS, axis_unit
from wrist_ft_comp.core.taring import TareCollector
from wrist_ft_comp.files.cdr import TEMPERATURE_DOUBLES, WRENCH_DOUBLES
from wrist_ft_comp.files.model_file import StoredModel, load_model
from wrist_ft_comp.files.model_store import ModelStore
from wrist_ft_comp.ros import qos, wire
from wrist_ft_comp.ros.calibration_control import CalibrationControl
from wrist_ft_comp.ros.compensator_parameters import PARAMETERS
from wrist_ft_comp.ros.deferred_service import DeferredService, Reply
from wrist_ft_comp.ros.diagnostics import diagnostic_array
from wrist_ft_comp.ros.own_recording import OwnRecording
from wrist_ft_comp.ros.parameters import declare, values
from wrist_ft_comp.ros.running import run_node
from wrist_ft_comp.ros.status import Counts, concerns

_HOUSEKEEPING_PERIOD_S = 0.1
_DIAGNOSTICS_PERIOD_S = 1.0
#: A tare that gets no wrenches is answered this long after it should have been done, s.
_TARE_GRACE_S = 2.0


class CompensatorNode(Node):  # type: ignore[misc] # rclpy carries no types
    """
    Compensates one sensor.

    Parameters
    ----------
    **options
        Passed on to rclpy's Node, such as ``context``.

    Raises
    ------
    WristFtCompError
        When a parameter, or the model file it names, is unusable.

    """

    def __init__(self, **options: Any) -> None:
        super().__init__('wrist_ft_comp', **options)
        declare(self, PARAMETERS)
        given = values(self, PARAMETERS)
        self.store = ModelStore(_data_directory(given['data_directory'], self))
        topics = given['temperature_topics']
        if not topics:
            raise SettingsError(
                'temperature_topics must name at least one topic; got none. The first is the '
                'thermometer inside the sensor.'
            )
        self.compensator = Compensator(
            len(topics),
            StreamSettings(
                thermal_period_s=given['thermal_period'],
                temperature_timeout_s=given['temperature_timeout'],
                max_drift_n=given['max_drift'],
            ),
        )
        self.counts = Counts(len(topics))
        self.frame_id = ''
        self.recording: OwnRecording | None = None
        self._silent = given['uncalibrated'] == 'silent'
        self._tare: tuple[TareCollector, Reply, float] | None = None
        self._reference: Any = None
        self._wrench_wire = wire.Wire(WRENCH_DOUBLES)
        self._temperature_wire = wire.Wire(TEMPERATURE_DOUBLES)
        self._create_topics(topics)
        self.calibration = CalibrationControl(self)
        self.calibration.start_with(given['model_file'])
        self._create_services()
        self.add_on_set_parameters_callback(self._judge_paths)
        self.add_post_set_parameters_callback(self._apply_parameters)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_HOUSEKEEPING_PERIOD_S, self._keep_house, clock=steady)
        self.create_timer(_DIAGNOSTICS_PERIOD_S, self._diagnose, clock=steady)

    def _create_topics(self, temperature_topics: Sequence[str]) -> None:
        """Create publishers and subscriptions; QoS may be overridden by parameters."""
        override = QoSOverridingOptions.with_default_policies()
        self._output = self.create_publisher(
            WrenchStamped, 'wrench', qos.OUTPUT, qos_overriding_options=override
        )
        self._drift = self.create_publisher(WrenchStamped, '~/drift', qos.OUTPUT)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', qos.OUTPUT)
        self.raw_subscription = self.create_subscription(
            WrenchStamped,
            'wrench_raw',
            self._on_wrench,
            qos.FAST_SENSOR,
            raw=True,
            qos_overriding_options=override,
        )
        self.temperature_subscriptions = [
            self.create_subscription(
                Temperature,
                topic,
                partial(self._on_temperature, thermometer),
                qos.SLOW_SENSOR,
                raw=True,
                qos_overriding_options=override,
            )
            for thermometer, topic in enumerate(temperature_topics)
        ]

    def _create_services(self) -> None:
        """Create the services; two of them answer when their work is done."""
        self._offered = [
            DeferredService(self, Trigger, '~/calibrate', self.calibration.on_request),
            DeferredService(self, Trigger, '~/tare', self._on_tare),
            self.create_service(SetBool, '~/record', self._on_record),
            self.create_service(Trigger, '~/reset_tare', self._on_reset_tare),
            self.create_service(Trigger, '~/rollback', self.calibration.on_rollback),
        ]

    def _on_wrench(self, data: bytes) -> None:
        """Correct one wrench and send it on; the header passes through untouched."""
        try:
            layout = self._wrench_wire.layout(data)
        except RecordingError:
            self.counts.malformed += 1
            return
        stamp_ns, raw = wire.read(layout, data)
        if not math.isfinite(sum(raw)):
            self.counts.not_finite += 1
            return
        stamp_ns = stamp_ns or self._now_ns()
        corrected = self.compensator.correct(stamp_ns, raw)
        self.counts.wrenches += 1
        if self.compensator.compensating or not self._silent:
            self._output.publish(wire.replace(layout, data, corrected))
            self.counts.published += 1
        if self.recording is not None:
            self.recording.reducer.add_raw(stamp_ns, raw)
        if self._tare is not None and self._tare[0].add(stamp_ns, raw):
            self._finish_tare()
        if not self.frame_id:
            self.frame_id = data[16 : layout.offset].rstrip(b'\0').decode(errors='replace')

    def _on_reference(self, data: bytes) -> None:
        """Add one reference wrench to the recording."""
        try:
            stamp_ns, reference = wire.read(self._wrench_wire.layout(data), data)
        except RecordingError:
            self.counts.malformed += 1
            return
        if self.recording is not None and math.isfinite(sum(reference)):
            self.recording.reducer.add_reference(stamp_ns or self._now_ns(), reference)

    def _on_temperature(self, thermometer: int, data: bytes) -> None:
        """Give one temperature to the thermal grid; the drift moves when a cell is complete."""
        try:
            stamp_ns, numbers = wire.read(self._temperature_wire.layout(data), data)
        except RecordingError:
            self.counts.malformed += 1
            return
        self.counts.temperature(thermometer)
        stamp_ns = stamp_ns or self._now_ns()
        cells = self.compensator.add_temperature(thermometer, stamp_ns, numbers[0])
        if cells and self.compensator.compensating:
            self._publish_drift(stamp_ns)
        if cells and self.recording is not None:
            self.recording.reducer.add_cells(cells)
            self._write_rows(self.recording)

    def _now_ns(self) -> int:
        """Time for drivers that do not stamp."""
        return int(self.get_clock().now().nanoseconds)

    def _publish_drift(self, stamp_ns: int) -> None:
        """Publish the zero drift that is being subtracted from now on."""
        message = WrenchStamped()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NANOSECONDS)
        message.header.frame_id = self.frame_id
        for axis, value in zip(AXES, self.compensator.drift.zero, strict=True):
            part, component = axis.split('_')
            setattr(getattr(message.wrench, part), component, float(value))
        self._drift.publish(message)

    def _on_record(self, request: Any, response: Any) -> Any:
        """Start or end the node's own recording."""
        try:
            response.message = self._start_recording() if request.data else self._end_recording()
            response.success = True
        except WristFtCompError as error:
            response.success, response.message = False, str(error)
        return response

    def _start_recording(self) -> str:
        """Start recording; say where to."""
        if self.recording is not None:
            raise RecordingError(
                f'A recording runs already, into {self.recording.path}. End it first, with data: '
                'false.'
            )
        try:
            path = self.store.new_recording_path()
        except OSError as error:
            raise RecordingError(
                f'{self.store.directory} cannot be written: {error.strerror}. Choose another '
                'data_directory.'
            ) from error
        period_ns = self.compensator.grid.period_ns
        self.recording = OwnRecording(path, period_ns, self.compensator.thermometers)
        # Only while recording: a reference at a kilohertz costs as much as the wrench itself.
        self._reference = self.create_subscription(
            WrenchStamped, 'wrench_reference', self._on_reference, qos.FAST_SENSOR, raw=True
        )
        return f'recording into {path}'

    def _end_recording(self) -> str:
        """End the recording; say what it holds."""
        if self.recording is None:
            raise RecordingError('No recording runs. Start one with data: true.')
        recording, self.recording = self.recording, None
        self.destroy_subscription(self._reference)
        recording.close()
        seconds = recording.rows * self.compensator.grid.period_ns / NANOSECONDS
        return f'recorded {recording.rows} thermal cells ({seconds:.0f} s) into {recording.path}'

    def _write_rows(self, recording: OwnRecording) -> None:
        """Append complete rows; when the disk refuses, the recording ends and the stream goes on."""
        try:
            recording.write()
        except RecordingError as error:
            self.get_logger().error(f'{error} The recording has ended; the stream goes on.')
            self.recording = None
            self.destroy_subscription(self._reference)

    def _on_tare(self, _request: Any, reply: Reply) -> None:
        """Start to collect wrenches; the answer comes when there are enough."""
        if self._tare is not None:
            reply(
                success=False, message='A tare is running; wait for its answer, then call again.'
            )
            return
        given = values(self, PARAMETERS)
        collector = TareCollector(given['tare.duration'], given['tare.max_deviation'])
        deadline = time.monotonic() + given['tare.duration'] + _TARE_GRACE_S
        self._tare = (collector, reply, deadline)

    def _finish_tare(self) -> None:
        """Set the tare, or say why not."""
        if self._tare is None:
            return
        (collector, reply, _), self._tare = self._tare, None
        try:
            mean, stamp_ns = collector.result()
        except WristFtCompError as error:
            reply(success=False, message=str(error))
            return
        tare = self.compensator.set_tare(mean, stamp_ns)
        offsets = ', '.join(
            f'{axis} {value:.4g} {axis_unit(axis)}' for axis, value in zip(AXES, tare, strict=True)
        )
        self.get_logger().info(f'tared: {offsets}')
        reply(success=True, message=f'tared: {offsets}')

    def _on_reset_tare(self, _request: Any, response: Any) -> Any:
        """Forget the tare."""
        self.compensator.reset_tare()
        response.success, response.message = True, 'the tare is zero again'
        return response

    def _judge_paths(self, parameters: Sequence[Any]) -> SetParametersResult:
        """Refuse, without side effects, files that the graph may not name or that cannot be used."""
        try:
            for parameter in parameters:
                self.calibration.judge(parameter.name, parameter.value)
        except WristFtCompError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, parameters: Sequence[Any]) -> None:
        """Make parameters that changed take effect; the others are read when they are needed."""
        for parameter in parameters:
            if parameter.name == 'uncalibrated':
                self._silent = parameter.value == 'silent'
            elif parameter.name == 'model_file' and parameter.value:
                self.calibration.use_file(Path(parameter.value))

    def _keep_house(self) -> None:
        """Look after what does not come by message."""
        self.calibration.poll()
        if self._tare is not None and time.monotonic() > self._tare[2]:
            self._finish_tare()

    def _diagnose(self) -> None:
        """Publish diagnostics."""
        stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(
            diagnostic_array(stamp, self.get_name(), self.frame_id, concerns(self))
        )

    def destroy_node(self) -> None:
        """End what runs beside the node; an open recording is closed, not lost."""
        self.calibration.end()
        if self.recording is not None:
            try:
                self.get_logger().info(self._end_recording())
            except WristFtCompError as error:
                self.get_logger().error(str(error))
        super().destroy_node()


def load_for(store: ModelStore, path: Path) -> StoredModel:
    """Load a model file; relative paths are looked up in the store first."""
    inside = store.directory / path
    return load_model(inside if inside.exists() else path)


def _data_directory(given: str, node: Node) -> Path:
    """Choose the folder for models and recordings."""
    if given:
        return Path(given).expanduser()
    home = os.environ.get('ROS_HOME') or '~/.ros'
    name = node.get_fully_qualified_name().strip('/').replace('/', '__')
    return Path(home).expanduser() / 'wrist_ft_comp' / name


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run_node(CompensatorNode, argv)


if __name__ == '__main__':
    sys.exit(main())
