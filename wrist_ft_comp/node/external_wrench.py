"""The part that publishes the wrench without drift and payload, and judges the weight."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
import math
import time
from typing import Any

from geometry_msgs.msg import WrenchStamped
import numpy as np

from wrist_ft_comp.channels import AXES, axis_unit
from wrist_ft_comp.node.payload_choice import changed_frames, PayloadChoice, unknown_turn
from wrist_ft_comp.node.raw_wrench import Counts, is_silent
from wrist_ft_comp.node.specific_force import SpecificForceInput
from wrist_ft_comp.payload.motion_collector import MotionCollector
from wrist_ft_comp.payload.weight import FARTHEST_M, ForceFrame, LivePayload, MOST_KG
from wrist_ft_comp.payload.weight_check import (
    ExchangeCheck,
    HiddenWeight,
    LAG_STEP_S,
    LagCheck,
    TareCheck,
    WeightCheck,
)
from wrist_ft_comp.ros.diagnostics import doubtful, Growth, Status
from wrist_ft_comp.ros.hub import Part
from wrist_ft_comp.ros.parameters import Parameter
from wrist_ft_comp.series import FloatArray, NANOSECONDS
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.wire.cdr import Layout

#: Two rotations of specific force contradict each other where they differ by more, degrees. Learnt
#: ones are right within 3, and so is an IMU that a person mounts.
_CONTRADICTION_DEG = 5.0
#: An IMU is polled where its newest sample is older, ns. Polled for each wrench at 1 kHz, it would
#: cost a third of the wrench itself; this age causes 0.03 N at 1 rad/s and 1.5 kg.
_FRESH_NS = 2_000_000
#: As many payloads are judged by turns.
_CHECKS = 16
#: A tare that is not older, s, when these reports say that specific force is wrong, holds it.
_JUDGED_S = 15.0
#: Said where a weight shows with the wrong sign.
_AGAINST = (
    'the force of {} is against its weight: is z of gravity.frame up, is the IMU upside down, or '
    'does it send gravity, not specific force; or is {} named when it is let go? Mend that, then '
    'call ~/tare'
)


@dataclass(eq=False)
class ExternalWrench(Part):
    """Subtracts the weight of the active payload from every wrench; judges payload and force."""

    compensator: Compensator
    choice: PayloadChoice
    specific_force: SpecificForceInput
    counts: Counts
    #: Wrenches that came, and those that were not published because specific force was too old.
    came: int = 0
    missed: int = 0
    #: What is mounted and taken off; None when no payload is active.
    payload: LivePayload | None = None
    #: Averages the minute in which a payload is being identified; None when none is.
    collector: MotionCollector | None = None
    #: Whether the wrench moves with the weight of the payload.
    check: WeightCheck = field(default_factory=WeightCheck)
    #: That and those of the payloads before, by what was logged of them, the oldest first.
    _checks: dict[str, WeightCheck] = field(default_factory=dict)
    #: Why the weight that is taken off is wrong; '' where nothing says so.
    wrong: str = ''
    #: When wrench_external was tared, by the steady clock, s.
    tared_s: float = -math.inf
    #: Whether a payload was on at a tare without its name.
    _hidden: HiddenWeight = field(default_factory=HiddenWeight)
    #: Whether the last tare was of another one.
    _tare_check: TareCheck = field(default_factory=TareCheck)
    _lag_check: LagCheck = field(default_factory=LagCheck)
    #: Whether the wrench moves with the weight in swings, as far as TF shows that.
    _swings: WeightCheck = field(default_factory=WeightCheck)
    #: Whether it moves against the weight where payloads are exchanged.
    _exchanges: ExchangeCheck = field(default_factory=ExchangeCheck)
    #: What was chosen at run time before a restart, in words, if it is another one than now.
    _before: str = ''
    #: The payload before the present one.
    _last: LivePayload | None = None
    _growth: Growth = field(default_factory=Growth)

    title = 'payload'
    parameters = (
        Parameter(
            'payload.active', '',
            'What is mounted, and subtracted on wrench_external: the name of a payload that was '
            'learnt, manual for what payload.mass and payload.center_of_mass say, or empty for '
            'none.'),
        Parameter(
            'payload.mass', 0.0,
            'With payload.active manual: mass of all that is mounted on the sensor.',
            'kg', 0.0, MOST_KG),
        Parameter(
            'payload.center_of_mass', (0.0, 0.0, 0.0),
            'With payload.active manual: its x, y and z in the frame of the wrench.',
            'm', -FARTHEST_M, FARTHEST_M),
    )  # fmt: skip
    topics = (('wrench_external', 'what the world does to the tool, while a payload is active'),)

    def start(self) -> None:
        """Offer the topic wrench_external, and choose the payload; a refusal ends the node."""
        self.output = self.hub.advertise(WrenchStamped, 'wrench_external', negotiable=True)
        self._hold(self.choice.choose(self.hub.chosen()))
        before, now = self.counts.weighed, self._weighed()
        # Another name is that of another tool, and the sensor's zero is the same.
        is_corrected = before != now and before.startswith(now.partition(',')[0] + ',')
        if is_corrected and self.compensator.external_tare.any():
            self.compensator.doubt_zero(
                f'the tare of wrench_external was taken with {before}, and the node was started '
                f'with {now}: unless that is another tool, call ~/tare'
            )
        if self.counts.payload == str(self.payload):
            self.counts.payload = ''
        self._before = self.counts.payload

    def note_tare(self) -> None:
        """Take that wrench_external was tared just now."""
        self.tared_s, self._tare_check = time.monotonic(), TareCheck()
        self.counts.weighed = self._weighed()

    def _weighed(self) -> str:
        """Say what is taken off, and how it is turned; '' where nothing is."""
        if self.payload is None:
            return ''
        by = self.hub.chosen()
        above = f'{by["gravity.source"]} {by["gravity.frame"]}'.rstrip()
        return f'{self.payload}, {self.payload.frame}, by {above}'

    def collect(self, collector: MotionCollector | None) -> None:
        """Hand wrenches and specific force to a collector until it is full; None ends that."""
        self.collector = collector
        self.hub.listen(self, wanted=self.wanted)

    @property
    def wanted(self) -> bool:
        """Whether specific force is needed."""
        return self.payload is not None or self.collector is not None

    def on_wrench(self, stamp_ns: int, raw: Sequence[float], data: bytes, layout: Layout) -> None:
        """Subtract the payload from one wrench and publish it; its header stays as it is."""
        forces, self.came = self.specific_force.forces, self.came + 1
        if forces.newest is None or stamp_ns - forces.newest[0] > _FRESH_NS:
            self.hub.do(self.specific_force, self.specific_force.poll)
        force = forces.at(stamp_ns)
        if force is None:
            self.missed += 1
            return
        external = self.compensator.correct(stamp_ns, raw, external=True)
        if self.payload is not None and not is_silent(self.hub, self.compensator):
            self.output.publish(layout.encode(data, self.payload.taken_off(external, force)))
        if self.collector is not None and self.collector.share < 1:
            felt = force if self.specific_force.is_calm(stamp_ns) else (math.nan,) * 3
            self.collector.add(stamp_ns, external, felt, self.specific_force.speed)

    def weight_at(self, stamp_ns: int) -> list[float] | None:
        """Compute the payload's weight at a stamp, ns: N and N m; None where it is not known."""
        force = self.specific_force.forces.at(stamp_ns)
        return None if self.payload is None or force is None else self.payload.weight(force)

    def check_parameters(self, parameters: Sequence[Any]) -> None:
        """Refuse payloads that cannot be chosen; change nothing."""
        if changed := self._changed(parameters):
            self.choice.choose({**self.hub.chosen(), **changed})

    def apply_parameters(self, parameters: Sequence[Any]) -> None:
        """Subtract another payload from the next wrench on; it was checked before."""
        if changed := self._changed(parameters):
            before = str(self.payload)
            self._hold(self.choice.choose(self.hub.chosen()))
            # A mass that is set ahead, for when manual is chosen, says nothing of what is mounted.
            if 'payload.active' in changed or str(self.payload) != before:
                self._before, self.counts.payload = '', str(self.payload)

    def _changed(self, parameters: Sequence[Any]) -> dict[str, Any]:
        """Pick the new values of the own parameters."""
        names = {row.name for row in self.parameters}
        return {one.name: one.value for one in parameters if one.name in names}

    def _hold(self, payload: LivePayload | None) -> None:
        """Subtract a payload from now on; a tare that was taken with another rotation is reset."""
        now = f'{payload}; {payload.turn}' if payload else 'none; wrench_external rests'
        if payload or self.payload:
            self.hub.log.info(f'payload: {now}')
        if str(payload) != str(self.payload):
            self._exchanges.exchange()
        self.payload = payload
        # Poses between two grips are too few to judge one: what is known of a payload stays.
        check = self._checks.pop(now, None) or WeightCheck(payload.name if payload else '')
        self._checks[now] = check
        while len(self._checks) > _CHECKS:
            del self._checks[next(iter(self._checks))]
        if check is not self.check:
            check.begin()
            self._swings = WeightCheck(payload.name if payload else '')
        self.check, self.wrong = check, check.found
        self.collect(self.collector)
        if payload is None:
            return
        before, self._last = self._last or payload, payload
        apart_deg = payload.frame.apart_deg(before.frame)
        tare, external_tare = self.compensator.tare, self.compensator.external_tare
        tared = external_tare.any()
        if tared and apart_deg > _CONTRADICTION_DEG:
            none = np.zeros(len(AXES))
            self.compensator.restore_tare(tare, none, tared=self.compensator.tared)
            self.compensator.doubt_zero(
                f'specific force is turned otherwise than for {before.name}, by {apart_deg:.0f} '
                'degrees, and the tare of wrench_external is zero again; call ~/tare'
            )
        elif tared and np.allclose(tare, external_tare):
            self._hidden.expect(time.monotonic(), self.tared_s)

    def statuses(self) -> Iterator[Status]:
        """Judge payload and specific force at the stamp of the newest wrench."""
        payload, forces, newest = self.payload, self.specific_force.forces, self.counts.newest
        grown, elapsed_s = self._growth.since(
            forces=forces.count, came=self.came, missed=self.missed
        )
        numbers = {
            'active': str(payload or 'none'),
            'turn': 'none' if payload is None else payload.turn,
            'force_rate_hz': f'{grown["forces"] / elapsed_s:.1f}',
        }
        for axis, value in zip(AXES, self.compensator.external_tare, strict=True):
            numbers[f'{axis}_tare'] = f'{value:.4g} {axis_unit(axis)}'
        said = self.specific_force.doubt(), self.hub.disagreement('wrench_external')
        doubts = list(filter(None, said))
        if self.wanted:
            mass_kg = payload.payload.mass_kg if payload else 1.0  # it is being identified
            at_ns = newest and newest[0]
            doubts += self.specific_force.timing_doubts(at_ns, grown, mass_kg)
        if payload and newest and grown['came'] and (force := forces.at(newest[0])):
            wrench = np.array(self.compensator.correct(*newest[:2], external=True))
            weight = np.array(payload.weight(force))
            for axis, value in zip(AXES, wrench - weight, strict=True):
                numbers[f'{axis}_external'] = f'{value:.4g} {axis_unit(axis)}'
            doubts += self._compare(payload, newest[0], wrench, weight)
        well = 'no payload is active'
        if self.collector is not None:
            well = f'identifying a payload: {self.collector.share:.0%} of a minute'
        elif payload is not None:
            well = f'subtracting {payload.name}'
        wrong = list(self._weight_doubts()) if self.wanted or self._before else []
        self.wrong = wrong[0] if wrong and payload is not None else ''
        late = self.check.found or time.monotonic() - self.tared_s < _JUDGED_S
        if wrong and late and self.compensator.external_tare.any():
            self.compensator.doubt_zero(
                'the tare of wrench_external may hold the weight of a payload, or a specific '
                'force, that did not fit; when the status payload is OK, call ~/tare'
            )
        yield doubtful(self.title, doubts + wrong, well, numbers)

    def _compare(
        self, payload: LivePayload, stamp_ns: int, wrench: FloatArray, weight: FloatArray
    ) -> Iterator[str]:
        """Say how a wrench shows that the weight is late, or that the tare was not of it."""
        rest_n, weight_n = (wrench - weight)[:3], weight[:3]
        before = self.specific_force.forces.at(stamp_ns - round(LAG_STEP_S * NANOSECONDS))
        if before is not None:
            change_n = weight_n - payload.weight(before)[:3]
            yield from filter(None, [self._lag_check.look(rest_n, weight_n, change_n)])
        if not self.specific_force.is_calm(stamp_ns):
            self._swings.add(wrench, weight)
            if self._swings.is_far:
                yield self._swings.found
            return
        self.check.add(wrench, weight)
        is_against = self._exchanges.look(wrench[:3], weight_n)
        off_n = self._tare_check.off_n(time.monotonic(), rest_n, weight_n)
        if off_n and self.compensator.tared and not self.check.found:
            yield (
                f'wrench_external rests at {off_n:.2g} N in all directions: at the tare, another '
                'payload was mounted than was named, or the zero is another one since, or a '
                'process presses; free the tool, name what is mounted, and call ~/tare'
            )
        if self._hidden.look(time.monotonic(), self.tared_s, rest_n, weight_n):
            yield (
                f'the weight of {payload.name} does not show, and the tare was taken while '
                'payload.active was empty: if it was mounted then, call ~/tare'
            )
            is_against |= bool(wrench[:3] @ weight_n < -0.5 * weight_n @ weight_n)
        if is_against:
            yield _AGAINST.format(payload.name, payload.name)

    def _weight_doubts(self) -> Iterator[str]:
        """Say why the weight is wrong that is taken off, or is to be identified."""
        payload = self.payload
        yield from self.specific_force.value_doubts(payload.frame if payload else ForceFrame())
        if self._before:
            yield (
                f'before the restart payload.active was {self._before}, set while the node ran; '
                'set it to what is mounted, also where that is the one that is named now'
            )
        if payload is None:
            return
        here, came = self.specific_force.frames(), self.specific_force.forces.newest
        if changed := changed_frames(payload.frame, here):
            yield (
                f'{payload.name} was learnt under other frame_ids: {changed}; is it another '
                'sensor?'
            )
        elif payload.is_assumed and came and (problem := unknown_turn(here)):
            yield problem
        yield from filter(None, [self.check.found])
