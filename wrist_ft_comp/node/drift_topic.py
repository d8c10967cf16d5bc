"""The part that publishes ~/drift, and judges the output."""

from collections.abc import Iterator, Sequence
import time

from geometry_msgs.msg import WrenchStamped
import numpy as np

from wrist_ft_comp.channels import AXES, axis_unit
from wrist_ft_comp.node.inputs import Counts
from wrist_ft_comp.ros.diagnostics import ERROR, Growth, OK, Status, WARN
from wrist_ft_comp.ros.hub import Hub, Part
from wrist_ft_comp.ros.topics import wrench_message
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.stream.stream_grid import ThermalCell

#: Two nodes of one name are said when they have been there for this time, s: one that was killed
#: stays in the graph for 20 s with Fast DDS.
_TWINS_S = 30.0


class DriftTopic(Part):
    """Publishes the zero drift once per thermal cell, and judges what is subtracted."""

    title, logged = 'output', True
    topics = (('~/drift', 'zero drift being subtracted, once per thermal cell'),)
    hub: Hub

    def __init__(self, compensator: Compensator, counts: Counts) -> None:
        self._compensator, self._counts = compensator, counts
        self._growth = Growth()
        #: The publishers of raw wrenches, by their identity in the graph.
        self._drivers: set[bytes] = set()
        #: When this node was the only one of its name last, by the steady clock.
        self._alone_s = time.monotonic()

    def start(self) -> None:
        """Offer the topic."""
        self.drift = self.hub.advertise(WrenchStamped, '~/drift')

    def on_cells(self, _cells: Sequence[ThermalCell], stamp_ns: int) -> None:
        """Publish what is subtracted at the end of cells."""
        if self._compensator.compensating:
            zero = self._compensator.compensation.zero
            self.drift.publish(wrench_message(stamp_ns, self.hub.hardware_id(), zero))

    def _look_at_graph(self) -> None:
        """Look for a driver that has come instead of another one, and for a node of this name."""
        hub, now_s = self.hub, time.monotonic()
        topic = hub.resolve_topic_name('wrench_raw')
        drivers = {bytes(end.endpoint_gid) for end in hub.get_publishers_info_by_topic(topic)}
        if drivers and drivers.isdisjoint(self._drivers):
            if self._drivers:
                self._compensator.doubt_zero(
                    f'the publisher of {topic} has left and another one came: its zero may be '
                    'another one; call ~/tare'
                )
            self._drivers = drivers
        own = hub.get_name(), hub.get_namespace()
        if hub.get_node_names_and_namespaces().count(own) <= 1:
            self._alone_s = now_s

    def statuses(self) -> Iterator[Status]:
        """Report what is subtracted, and whether it hits a limit."""
        self._look_at_graph()
        stream, counts = self._compensator, self._counts
        grown, elapsed_s = self._growth.since(published=counts.published, failed=counts.failed)
        tare = 'active' if stream.tared else 'none'
        if not stream.tared and stream.tare.any():
            tare = 'none; an offset is kept since a change of model'
        numbers = {
            'rate_hz': f'{grown["published"] / elapsed_s:.1f}',
            'published': str(counts.published),
            'tare': tare,
            'origin': stream.tracker.origin,
            **_axis_numbers(stream),
        }
        large, fast = map(', '.join, (stream.limits.too_large, stream.limits.too_fast))
        level, why = WARN, 'not compensated: no model or no temperature yet'
        if grown['failed']:
            level, why = ERROR, f'wrenches were lost by a fault of this program: {counts.fault}'
        elif large:
            level, why = ERROR, f'drift of {large} is at its limit'
        elif time.monotonic() - self._alone_s > _TWINS_S:
            name = self.hub.get_fully_qualified_name()
            why = f'two nodes are called {name}, and both publish; end one, or rename it'
        elif fast:
            why = f'drift of {fast} moves at its limit (max_drift_rate) and lags behind the model'
        elif stream.compensating and stream.model is not None and not stream.model.axes:
            why = 'not compensated: the model compensates no axis'
        elif stream.zero_doubts and stream.compensating:
            why = '; '.join(stream.zero_doubts)
        elif stream.compensating and (policy := self.hub.incompatible.get('wrench')):
            why = f'a subscriber of wrench asks for more {policy} than is offered and gets nothing'
        elif stream.compensating:
            level, why = OK, 'compensated'
        yield Status(self.title, level, why, numbers)


def _axis_numbers(stream: Compensator) -> dict[str, str]:
    """Give drift, its deviation and the tare of every axis."""
    numbers: dict[str, str] = {}
    model, temperature_c = stream.model, stream.tracker.temperature_c
    deviations: FloatArray = np.full(len(AXES), np.nan)
    if model is not None and temperature_c is not None:
        deviations = model.uncertainty(temperature_c)
    for axis, zero, sensitivity, tare, deviation in zip(
        AXES, *stream.compensation, stream.tare, deviations, strict=True
    ):
        unit = axis_unit(axis)
        numbers[f'{axis}_drift'] = f'{zero:.4g} {unit}'
        if np.isfinite(deviation):
            numbers[f'{axis}_drift_deviation'] = f'{deviation:.4g} {unit}'
        if model is not None and axis in model.day_limits:
            numbers[f'{axis}_day_limit'] = f'{model.day_limits[axis]:.4g} {unit}'
        numbers[f'{axis}_sensitivity'] = f'{100 * sensitivity:.3g} %'
        numbers[f'{axis}_tare'] = f'{tare:.4g} {unit}'
    return numbers
