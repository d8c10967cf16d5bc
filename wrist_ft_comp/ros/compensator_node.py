"""
The node ``compensator``: raw wrench and temperatures in, compensated wrench out.

A callback converts, steps, publishes. What it means is the core's business: this module wires
topics, services and parameters to it.
"""

from collections.abc import Sequence
from functools import partial
import math
from pathlib import Path
import sys
import time
from typing import Any, cast

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import Temperature
from std_srvs.srv import SetBool, Trigger

from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.files.cdr import TEMPERATURE_DOUBLES, WRENCH_DOUBLES
from wrist_ft_comp.files.model_store import default_directory, ModelStore
from wrist_ft_comp.ros import messages as qos
from wrist_ft_comp.ros import messages as wire
from wrist_ft_comp.ros.diagnostics import ConcernLog, concerns, diagnostic_array
from wrist_ft_comp.ros.input_health import Counts, InputWatch
from wrist_ft_comp.ros.live_model import LiveModel
from wrist_ft_comp.ros.messages import wrench_message
from wrist_ft_comp.ros.parameters import declare, NODE_NAME, PARAMETERS, values
from wrist_ft_comp.ros.running import node_per_sensor, run_nodes
from wrist_ft_comp.ros.services.calibrate import CalibrationControl
from wrist_ft_comp.ros.services.deferred import DeferredService
from wrist_ft_comp.ros.services.record import RecordingControl
from wrist_ft_comp.ros.services.tare import TareControl
from wrist_ft_comp.ros.state_keeper import StateKeeping
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings
from wrist_ft_comp.stream.input_checks import is_plausible

_HOUSEKEEPING_PERIOD_S = 0.1


_DIAGNOSTICS_PERIOD_S = 1.0


#: What is asked for may be as long as the asker likes; diagnostics repeat it every second.
_LONGEST_REFUSAL = 1000


#: An answer that the asker has not taken yet is lost when its sender leaves the network.
_FAREWELL_S = 0.5


class CompensatorNode(Node):
    """
    Compensates one sensor.

    Parameters
    ----------
    sensor : str
        Its name where a process serves several; each has a folder of this name below
        ``data_directory``.
    **options
        Passed on to rclpy's Node, such as ``context``.

    Raises
    ------
    WristFtCompError
        When a parameter, or the model file it names, is unusable.

    """

    def __init__(self, sensor: str = '', **options: Any) -> None:
        super().__init__(NODE_NAME, **options)
        self.console: Any = cast('Any', self).get_logger()
        declare(self, PARAMETERS)
        given = values(self, PARAMETERS)
        topics = given['temperature_topics']
        if not topics:
            raise SettingsError(
                'temperature_topics must name at least one topic; got none. The first is the '
                'thermometer inside the sensor.'
            )
        settings = StreamSettings(
            thermal_period_s=given['thermal_period'],
            temperature_timeout_s=given['temperature_timeout'],
            max_drift_n=given['max_drift'],
            max_drift_rate_n_s=given['max_drift_rate'],
        )
        shared = given['data_directory']
        own = default_directory(self.get_fully_qualified_name())
        self.store = ModelStore(Path(shared, sensor).expanduser() if shared else own)
        self.model = LiveModel(self, len(topics))
        first = self.model.first(given['model_file'])
        self.compensator = Compensator(
            len(topics), settings, None if first is None else first.model
        )
        self.keeping = StateKeeping(self, given['save_period'])
        self.counts = Counts(len(topics))
        self.watch = InputWatch(self, len(topics))
        #: What was refused last, and why; empty before the first refusal.
        self.last_refusal = ''
        self._concern_log = ConcernLog(self.console)
        self.recording = RecordingControl(self)
        self.tare = TareControl(self)
        self.calibration = CalibrationControl(self)
        self._silent = given['uncalibrated'] == 'silent'
        self._wrench_wire = wire.Wire(WRENCH_DOUBLES)
        self._temperature_wire = wire.Wire(TEMPERATURE_DOUBLES)
        self._newest = b''
        self._create_topics(topics)
        self._create_services()
        self.add_on_set_parameters_callback(self.model.judge)
        self.add_post_set_parameters_callback(self._apply_parameters)
        # A steady clock: the node looks after itself where simulated time stands still, too.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_HOUSEKEEPING_PERIOD_S, self._keep_house, clock=steady)
        self.create_timer(_DIAGNOSTICS_PERIOD_S, self._diagnose, clock=steady)

    def _create_topics(self, temperature_topics: Sequence[str]) -> None:
        """Create publishers and subscriptions; QoS may be overridden by parameters."""
        override = QoSOverridingOptions.with_default_policies()
        self._output = self.create_publisher(
            WrenchStamped,
            'wrench',
            qos.own(qos.OUTPUT),
            qos_overriding_options=override,
            event_callbacks=self.watch.publisher_events('wrench'),
        )
        self._drift = self.create_publisher(WrenchStamped, '~/drift', qos.OUTPUT)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', qos.OUTPUT)
        self.raw_subscription: Any = self.create_subscription(
            WrenchStamped,
            'wrench_raw',
            self._on_wrench,
            qos.own(qos.FAST_SENSOR),
            raw=True,
            qos_overriding_options=override,
            event_callbacks=self.watch.subscription_events('wrench_raw'),
        )
        self.temperature_subscriptions: list[Any] = [
            self.create_subscription(
                Temperature,
                topic,
                partial(self._on_temperature, thermometer),
                qos.own(qos.SLOW_SENSOR),
                raw=True,
                qos_overriding_options=override,
                event_callbacks=self.watch.subscription_events(topic),
            )
            for thermometer, topic in enumerate(temperature_topics)
        ]

    def _create_services(self) -> None:
        """Create the services; two of them answer when their work is done."""
        self._offered = [
            DeferredService(self, Trigger, '~/calibrate', self.calibration.on_request),
            DeferredService(self, Trigger, '~/tare', self.tare.on_request),
            self.create_service(Trigger, '~/reset_tare', self.tare.on_reset),
            self.create_service(SetBool, '~/record', self.recording.on_request),
            self.create_service(Trigger, '~/rollback', self.model.on_rollback),
        ]

    def _on_wrench(self, data: bytes) -> None:
        """Correct one wrench and send it on; the header passes through untouched."""
        try:
            layout, stamp_ns, raw = self._wrench_wire.read(data)
        except RecordingError:
            self.counts.malformed += 1
            return
        if not math.isfinite(sum(raw)):
            self.counts.not_finite += 1
            return
        stamp_ns = stamp_ns or self._now_ns()
        corrected = self.compensator.correct(stamp_ns, raw)
        self.counts.wrench(stamp_ns)
        if not self._silent or self.compensator.compensating:
            self._output.publish(wire.replace(layout, data, corrected))
            self.counts.published += 1
        if self.recording.current is not None:
            self.recording.current.averager.add_raw(stamp_ns, raw)
        if self.tare.collector is not None:
            self.tare.add(stamp_ns, raw)
        self._newest = data

    @property
    def own_topics(self) -> tuple[str, str]:
        """Full names of the topics that no other sensor may use."""
        return self.raw_subscription.topic_name, self._output.topic_name

    @property
    def frame_id(self) -> str:
        """The sensor's frame; empty before the first wrench."""
        newest = self._newest
        return wire.frame_id(self._wrench_wire.layout(newest), newest) if newest else ''

    @property
    def stamped(self) -> bool:
        """Whether the newest wrench came with a stamp."""
        return any(self._newest[4:12])

    def on_reference(self, data: bytes) -> None:
        """Add one reference wrench, as serialized bytes, to the recording."""
        try:
            _, stamp_ns, reference = self._wrench_wire.read(data)
        except RecordingError:
            self.counts.bad_references += 1
            return
        if not math.isfinite(sum(reference)):
            self.counts.bad_references += 1
        elif self.recording.current is not None:
            self.recording.current.averager.add_reference(stamp_ns or self._now_ns(), reference)

    def _on_temperature(self, thermometer: int, data: bytes) -> None:
        """Give one temperature to the thermal grid; the drift moves when a cell is complete."""
        try:
            _, stamp_ns, (temperature_c, _) = self._temperature_wire.read(data)
        except RecordingError:
            self.counts.bad_temperatures += 1
            return
        if not is_plausible(temperature_c):
            self.counts.bad_temperatures += 1
            self.watch.unusable(thermometer, temperature_c)
            return
        self.watch.unstamped[thermometer] = not stamp_ns
        stamp_ns = stamp_ns or self._now_ns()
        self.counts.temperature(thermometer, stamp_ns)
        cells = self.compensator.add_temperature(thermometer, stamp_ns, temperature_c)
        if cells:
            self.recording.add_cells(cells)
            self.watch.cells(cells)
            if self.compensator.compensating:
                zero = self.compensator.compensation.zero
                self._drift.publish(wrench_message(stamp_ns, self.frame_id, zero))

    def _now_ns(self) -> int:
        """Time for drivers that do not stamp."""
        return int(self.get_clock().now().nanoseconds)

    def note_refusal(self, what: str, why: str) -> None:
        """Remember, for the diagnostics, what was refused and why."""
        self.last_refusal = f'{what}: {why}'[:_LONGEST_REFUSAL]

    def _apply_parameters(self, parameters: Sequence[Any]) -> None:
        """Make parameters that changed take effect; the others are read when they are needed."""
        for parameter in parameters:
            if parameter.name == 'uncalibrated':
                self._silent = parameter.value == 'silent'
            elif parameter.name == 'model_file' and parameter.value:
                self.model.use_file(parameter.value)

    def _keep_house(self) -> None:
        """Look after what does not come by message."""
        self.calibration.poll()
        self.recording.poll()
        self.tare.poll()
        self.keeping.poll()
        self.watch.poll()

    def _diagnose(self) -> None:
        """Publish diagnostics."""
        stamp = self.get_clock().now().to_msg()
        name = self.get_fully_qualified_name().lstrip('/')
        found = concerns(self)
        self._concern_log.tell(found)
        self._diagnostics.publish(diagnostic_array(stamp, name, self.frame_id, found))

    def destroy_node(self) -> None:
        """End what runs beside the node; an open recording is closed, and who waits is told."""
        waiting = [self.calibration.end(), self.tare.end()]
        self.recording.end()
        self.keeping.end()
        if any(waiting):
            time.sleep(_FAREWELL_S)
        super().destroy_node()  # type: ignore[no-untyped-call] # as rclpy declares it


def main(argv: Sequence[str] | None = None) -> int:
    """
    Run a node per sensor until a signal ends them.

    Parameters
    ----------
    argv : sequence of str, optional
        Command line; sys.argv by default.

    Returns
    -------
    int
        Exit code.

    """
    return run_nodes(partial(node_per_sensor, CompensatorNode), argv)


if __name__ == '__main__':
    sys.exit(main())
