"""The wrench without drift and payload, and the parameters that say which payload is held."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
import math
from pathlib import Path
from typing import Any

from geometry_msgs.msg import WrenchStamped
import numpy as np

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.node.gravity import Gravity
from wrist_ft_comp.node.live_model import LiveModel
from wrist_ft_comp.payload.live_weight import Force, LivePayload, RecentForces
from wrist_ft_comp.payload.weight import ForceFrame, FrameIds, Payload
from wrist_ft_comp.ros.hub import Hub, Part
from wrist_ft_comp.ros.node_log import NodeLog
from wrist_ft_comp.signals import AXES, NANOSECONDS
from wrist_ft_comp.stored.payload_file import IDENTIFIED, Learnt, load_payloads, PAYLOADS
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.wire.cdr import Layout

#: What payload.active says for what payload.mass and payload.center_of_mass say.
MANUAL = 'manual'
#: Turns of specific force that differ by more, degrees, can't both be right: what is learnt is
#: within 3, and so is what people mount by hand.
_DISAGREE_DEG = 5.0
#: An IMU is not asked while its newest sample is no older: to take each at a kilohertz would cost
#: a third of what the wrench does, and this much leaves 0.03 N at 1 rad/s and 1.5 kg.
_FRESH_NS = 2_000_000
_NAMES = {'payload.active', 'payload.mass', 'payload.center_of_mass'}
#: Takes a stamp, ns, the wrench without drift, specific force, and speed, rad/s, or NaN.
Collect = Callable[[int, list[float], Force, float], None]


class Shelf:
    """Looks into a folder of models, and into that of the live model; source is this node's."""

    def __init__(self, models: Path, live: LiveModel, source: str) -> None:
        self._own, self._live, self.source = models / PAYLOADS, live, source

    def payloads(self) -> Learnt:
        """Read what there is, oldest first; of the same name the node's own counts."""
        stored, own = self._live.stored, load_payloads(self._own)
        beside = {} if stored is None else load_payloads(stored.path.parent / PAYLOADS)
        return {**{name: each for name, each in beside.items() if name not in own}, **own}

    def frames(self, here: FrameIds) -> dict[str, ForceFrame]:
        """
        Give the frames that this node's own source and sensor have told, oldest first.

        They were learnt with the live model, or by this node under the same frame_ids, as far as
        these are known.
        """
        stored, own = self._live.stored, load_payloads(self._own)
        stem = None if stored is None else stored.path.stem
        return {
            name: frame
            for name, (_, frame) in self.payloads().items()
            if frame.source == self.source
            and (name.rpartition('-')[0] == stem or (name in own and frame.wrench_frame))
            and not changed_frames(frame, here)
        }

    def sensor(self, here: FrameIds) -> ForceFrame | None:
        """Tell what the last calibration found of the accelerometer: it saw more than a minute."""
        frames = self.frames(here).items()
        calibrated = [each for name, each in frames if not name.startswith(f'{IDENTIFIED}-')]
        return calibrated[-1] if calibrated else None


def changed_frames(frame: ForceFrame, here: FrameIds) -> str:
    """Say which frame_ids are not those of when a frame was learnt, where both are known."""
    then = FrameIds(frame.force_frame, frame.wrench_frame)
    known = [(before, now) for before, now in zip(then, here, strict=True) if before and now]
    return ' and '.join(f'{before} is now {now}' for before, now in known if before != now)


class _UnknownTurnError(SettingsError):
    """Nobody knows how the IMU is mounted."""


@dataclass(eq=False)
class ExternalWrench(Part):
    """Knows the payload that is held, and what it weighs at every wrench."""

    _compensator: Compensator
    _settings: Callable[[], Mapping[str, Any]]
    _shelf: Shelf
    gravity: Gravity
    _log: NodeLog
    #: Of the newest specific force, rad/s; NaN where nobody knows.
    speed: float = math.nan
    #: Wrenches that went, and that did not, because specific force was too old.
    published: int = 0
    missed: int = 0
    #: The payload that is held; None when none is active.
    payload: LivePayload | None = None
    _collect: Collect | None = None
    #: Why a payload is not held yet: TF may take its time.
    waiting: str = ''
    _hub: Hub = field(init=False)
    #: The frame_ids when a payload was chosen last, and what was held last.
    _chosen: FrameIds | None = None
    _last: LivePayload | None = None

    title = 'wrench_external'

    def __post_init__(self) -> None:
        """Begin without specific force."""
        self.forces = RecentForces(self._settings()['gravity.timeout'])

    def start(self, hub: Hub) -> None:
        """Publish what the world does to the tool."""
        self._hub = hub
        output = hub.advertise(WrenchStamped, 'wrench_external', negotiable=True)
        self.output, self.publish = output, output.publish

    def on_model(self) -> None:
        """Hold what is to be held from the start, when it is known which model is live."""
        if self._chosen is None:
            self._settle()

    def on_force(self, stamp_ns: int, force: Force, speed: float | None) -> None:
        """Take one specific force, m/s², and its speed of rotation, rad/s."""
        self.forces.add(stamp_ns, force)
        self.speed = math.nan if speed is None else speed

    def collect(self, collect: Collect | None) -> None:
        """Give wrenches to somebody, too; to nobody by None."""
        self._collect = collect
        self._hub.listen(self, wanted=self.wanted)

    @property
    def wanted(self) -> bool:
        """Whether somebody wants to know specific force."""
        return self.payload is not None or self._collect is not None

    def on_wrench(self, stamp_ns: int, raw: Sequence[float], data: bytes, layout: Layout) -> None:
        """Take the payload off one wrench and send it on; the header passes through untouched."""
        if stamp_ns - self.forces.newest_ns > _FRESH_NS:
            self._hub.do(self.gravity, self.gravity.poll)
        force = self.forces.at(stamp_ns)
        if force is None:
            self.missed += 1
            return
        external = self._compensator.correct(stamp_ns, raw, external=True)
        if self.payload is not None:
            self.publish(layout.encode(data, self.payload.taken_off(external, force)))
            self.published += 1
        if self._collect is not None:
            self._collect(stamp_ns, external, force, self.speed)

    def weight_at(self, stamp_ns: int) -> list[float] | None:
        """Weigh the payload at a stamp, ns: N and N m; None where nobody knows."""
        force = self.forces.at(stamp_ns)
        return None if self.payload is None or force is None else self.payload.weight(force)

    def check_parameters(self, parameters: Sequence[Any]) -> None:
        """Refuse payloads that can't be had; changes nothing that runs."""
        changed = {each.name: each.value for each in parameters if each.name in _NAMES}
        try:
            if changed:
                self._choose({**self._settings(), **changed})
        except _UnknownTurnError:
            if not self.waiting or 'payload.active' in changed:
                raise

    def apply_parameters(self, parameters: Sequence[Any]) -> None:
        """Hold another payload from the next wrench on; it was validated before."""
        for each in parameters:
            if each.name == 'gravity.timeout':
                self.forces.timeout_ns = round(each.value * NANOSECONDS)
        if not _NAMES.isdisjoint(each.name for each in parameters):
            self._settle()

    def poll(self) -> None:
        """Look whether the turn that a payload by hand needs is known now, or is another one."""
        by_hand = self.payload is not None and self.payload.name == MANUAL
        renamed = (by_hand or self.waiting) and self.gravity.frames() != self._chosen
        if renamed or (self.waiting and self.gravity.mount() is not None):
            self._settle()

    def _settle(self) -> None:
        """Hold what parameters say, or wait for its turn."""
        self._chosen = self.gravity.frames()
        try:
            self._hold(self._choose(self._settings()))
        except _UnknownTurnError as error:
            self._hold(None)
            self.waiting = str(error)

    def _hold(self, payload: LivePayload | None) -> None:
        """Hold a payload; a tare that was taken with another turn is none."""
        if payload is not None or self.payload is not None:
            said = f'{payload}; {payload.turn}' if payload else 'none; wrench_external rests'
            self._log.info(f'payload: {said}')
        self.payload, self.waiting = payload, ''
        self.collect(self._collect)
        if payload is None:
            return
        before, self._last = self._last or payload, payload
        apart_deg = payload.frame.apart_deg(before.frame)
        if apart_deg > _DISAGREE_DEG and self._compensator.external_tare.any():
            self._compensator.restore_tare(self._compensator.tare, np.zeros(len(AXES)))
            self._log.warning(
                f'payload: specific force is turned otherwise than for {before.name}, by '
                f'{apart_deg:.0f} degrees; the tare of wrench_external is zero again. Call ~/tare.'
            )

    def disagreement(self, frame: ForceFrame) -> str:
        """Say by how much TF turns specific force otherwise than a frame; empty if it agrees."""
        mounted = self.gravity.mount()
        apart_deg = 0.0 if mounted is None else frame.apart_deg(mounted)
        if apart_deg <= _DISAGREE_DEG:
            return ''
        who = '/tf_static' if self._shelf.source == 'imu' else 'TF'
        return f'{who} says otherwise, by {apart_deg:.0f} degrees: a frame of the driver is wrong'

    def _choose(self, chosen: Mapping[str, Any]) -> LivePayload | None:
        """Find the payload that parameters name."""
        by_hand = Payload(
            chosen['payload.mass'], np.array(chosen['payload.center_of_mass'], float)
        )
        name = chosen['payload.active']
        if not name:
            return None
        if chosen['gravity.source'] == 'none':
            raise SettingsError(
                f'payload.active is {name}, but gravity.source is none, so nobody knows where '
                'down is. Start the node with -p gravity.source:=imu, or tf.'
            )
        if name == MANUAL:
            if not by_hand.mass_kg:
                raise SettingsError(
                    f'payload.active is {MANUAL}, and payload.mass is 0. Set payload.mass and '
                    'payload.center_of_mass of all that is mounted first, or in one request.'
                )
            return LivePayload(name, by_hand, *self._turn())
        learnt = self._shelf.payloads()
        if name not in learnt:
            raise SettingsError(
                f'payload.active must be empty, {MANUAL}, or the name of a payload that was '
                f'learnt ({", ".join(learnt) or "there is none yet"}); got {name}. Learn it with '
                '~/identify_payload.'
            )
        source, frame = self._shelf.source, learnt[name][1]
        # By TF it comes in the wrench's frame: what was turned was told by an accelerometer.
        by = frame.source or ('imu' if source == 'tf' and not frame.does_nothing else source)
        if by != source:
            raise SettingsError(
                f'payload.active is {name}, which was learnt by {by}, and gravity.source is '
                f'{source}: another frame. Learn it again with ~/identify_payload, or by '
                'calibrate with --gravity-frame (tf) or --imu-topic (imu) where the file does not '
                'say, or start the node with the source of then.'
            )
        turned = f'learnt with it by {frame.source or "an unknown source"}'
        return LivePayload(name, *learnt[name], turned)

    def _turn(self) -> tuple[ForceFrame, str]:
        """Find how specific force leads to the wrench's frame, and who says so."""
        # For a payload that nobody learnt: TF gives it in that frame; of an IMU what was learnt
        # counts before what people publish.
        if self._shelf.source == 'tf':
            return ForceFrame(source='tf'), 'as TF gives it'
        learnt = self._shelf.frames(self.gravity.frames())
        if learnt:
            name, frame = list(learnt.items())[-1]
            return frame, f'learnt with {name}'
        if (mounted := self.gravity.mount()) is not None:
            return mounted, 'by /tf_static'
        raise _UnknownTurnError(
            f'payload.active is {MANUAL}, but nobody knows how specific force is turned in the '
            "wrench's frame: this sensor has learnt no payload yet, and /tf_static has no way "
            'from the frame of the IMU to it. Call ~/identify_payload, or publish the way.'
        )
