"""The part that publishes ~/drift and ~/correction, and judges what is subtracted."""

from collections.abc import Iterator, Sequence
import math
import time
from typing import Any

from geometry_msgs.msg import WrenchStamped
import numpy as np

from wrist_ft_comp.channels import AXES, axis_unit
from wrist_ft_comp.node.raw_wrench import Counts, is_silent
from wrist_ft_comp.ros.diagnostics import doubtful, ERROR, Growth, Status, WARN
from wrist_ft_comp.ros.hub import Part
from wrist_ft_comp.ros.topics import wrench_message
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.stream.thermal_cells import ThermalCell

#: Topics that nobody else may publish.
_OWN = 'wrench', 'wrench_external', '~/drift', '~/correction'
#: Another publisher of them is said when it has been there for this time, s: one that was
#: killed stays in the graph for 20 s with Fast DDS.
_TWINS_S = 30.0


class DriftTopic(Part):
    """
    Publishes the zero drift once per thermal cell, and the correction; judges what is subtracted.

    The correction is the compensated minus the raw wrench of the newest wrench. A controller that
    adds its last message to each raw wrench, such as admittance_controller by its
    ~/wrench_reference, is compensated without the wrench going through this node.
    """

    title = 'output'
    topics = (
        ('~/drift', 'zero drift being subtracted, once per thermal cell'),
        ('~/correction', 'compensated minus raw, ten times a second: what controllers add'),
    )

    def __init__(self, compensator: Compensator, counts: Counts) -> None:
        self._compensator, self._counts, self._growth = compensator, counts, Growth()
        #: Which topic of this node another one publishes, too, and when none did last, by the
        #: steady clock, s.
        self._shared, self._alone_s = '', time.monotonic()

    def start(self) -> None:
        """Offer the topics."""
        self.drift = self.hub.advertise(WrenchStamped, '~/drift')
        self.correction = self.hub.advertise(WrenchStamped, '~/correction')

    def on_cells(self, _cells: Sequence[ThermalCell], stamp_ns: int) -> None:
        """Publish what is subtracted at the end of cells."""
        if self._compensator.compensating:
            zero = self._compensator.compensation.zero
            self.drift.publish(wrench_message(stamp_ns, self.hub.hardware_id(), zero))

    def poll(self) -> None:
        """
        Publish the correction, unless there was no wrench yet or the drift has not been found.

        Then the controller holds the last one, which a restarted node sent before it ended.
        Without a model the parameter ``uncalibrated`` decides, as it does for the wrench.
        """
        stream, newest = self._compensator, self._counts.newest
        waits = stream.model is not None and not stream.compensating
        if newest is None or waits or is_silent(self.hub, stream):
            return
        stamp_ns, raw, _ = newest
        correction = np.subtract(stream.correct(stamp_ns, raw), raw)
        self.correction.publish(wrench_message(stamp_ns, self.hub.hardware_id(), correction))

    def statuses(self) -> Iterator[Status]:
        """Report what is subtracted, whether it hits a limit, and who else publishes it."""
        hub, stream, counts = self.hub, self._compensator, self._counts
        ours = (hub.resolve_topic_name(name) for name in _OWN)
        self._shared = next((topic for topic in ours if hub.count_publishers(topic) > 1), '')
        if not self._shared:
            self._alone_s = time.monotonic()
        grown, _ = self._growth.since(failed=counts.failed, wrenches=counts.wrenches)
        comes = 'wrenches' in self._growth.lately()
        tare = 'active' if stream.tared else 'none'
        numbers = {'published': str(counts.published), 'tare': tare}
        columns: dict[str, Any] = {
            'drift': stream.compensation.zero, 'tare': stream.tare,
            'drift_deviation': stream.deviation,
        }  # fmt: skip
        if (newest := counts.newest) is not None and comes:
            columns |= {'raw': newest[1], 'compensated': stream.correct(*newest[:2])}
        for name, values in columns.items():
            numbers |= {
                f'{axis}_{name}': f'{value:.4g} {axis_unit(axis)}'
                for axis, value in zip(AXES, values, strict=True)
                if not math.isnan(value)
            }
        for axis, share in zip(AXES, stream.compensation.sensitivity, strict=True):
            numbers[f'{axis}_sensitivity'] = f'{100 * share:.3g} %'
        doubts = self._doubts(grown['failed'], comes=comes)
        level = ERROR if grown['failed'] or stream.limits.too_large else WARN
        yield doubtful(self.title, doubts, 'compensated', numbers, level)

    def _doubts(self, failed: int, *, comes: bool) -> Iterator[str]:
        """Say what is wrong with what is published, the worst first."""
        stream = self._compensator
        if self._counts.newest is not None and not comes:
            yield 'nothing is published, because no usable wrench comes; see the status input'
        large, fast = map(', '.join, (stream.limits.too_large, stream.limits.too_fast))
        if failed:
            yield f'wrenches were lost by a fault of this program: {self._counts.fault}'
        if large:
            yield f'drift of {large} is at its limit'
        if time.monotonic() - self._alone_s > _TWINS_S:
            yield (
                f'another node publishes {self._shared}, too: forces are mixed, or services such '
                'as ~/tare act on both; end one, or give it another namespace'
            )
        if fast:
            yield f'drift of {fast} moves at its limit (max_drift_rate) and lags behind the model'
        if not stream.compensating:
            yield 'not compensated: no model, or no thermometer has reported twice yet'
        elif stream.model is not None and not stream.model.axes:
            yield 'not compensated: the model compensates no axis'
        yield from filter(None, [self.hub.disagreement('wrench')])
        yield from stream.zero_doubts
        if not stream.tared:
            yield 'no tare: wrench still holds the zero of the sensor; call ~/tare'
