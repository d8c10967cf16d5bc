"""The wrench without drift and payload, and the parameters that say which payload is held."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
import math
from pathlib import Path
from typing import Any

from geometry_msgs.msg import WrenchStamped
import numpy as np

from wrist_ft_comp.errors import SettingsError, WristFtCompError
from wrist_ft_comp.files.cdr import Layout
from wrist_ft_comp.files.payload_file import add_payloads, Learnt, load_payloads, PAYLOADS
from wrist_ft_comp.model.payload.weight import ForceFrame, Payload
from wrist_ft_comp.model.signals import NANOSECONDS
from wrist_ft_comp.ros.gravity.part import Gravity
from wrist_ft_comp.ros.hub import Hub, Part
from wrist_ft_comp.ros.live_model import LiveModel
from wrist_ft_comp.ros.node_log import NodeLog
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.stream.payload import Force, LivePayload, RecentForces

#: What payload.active says for what payload.mass and payload.center_of_mass say.
MANUAL = 'manual'
#: What the names of payloads that were identified in operation begin with.
_IDENTIFIED = 'identified'
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

    def frames(self) -> dict[str, ForceFrame]:
        """Give the frames of payloads, but for those that another source told, oldest first."""
        known = {name: frame for name, (_, frame) in self.payloads().items()}
        return {name: each for name, each in known.items() if each.source in ('', self.source)}

    def sensor(self) -> ForceFrame | None:
        """Tell what the last calibration found of the accelerometer: it saw more than a minute."""
        calibrated = [
            each for name, each in self.frames().items() if not name.startswith(f'{_IDENTIFIED}-')
        ]
        return calibrated[-1] if calibrated else None

    def keep(self, payload: Payload, frame: ForceFrame) -> str:
        """Keep a payload that was identified, and name it."""
        frame = replace(frame, source=self.source)
        return add_payloads(self._own, _IDENTIFIED, [payload], frame, self.payloads())[0]


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
    _chosen: bool = False

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
        if self._chosen:
            return
        self._chosen = True
        try:
            self._hold(self._choose(self._settings()))
        except _UnknownTurnError as error:
            self.waiting = str(error)

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
        if changed:
            self._choose({**self._settings(), **changed})

    def apply_parameters(self, parameters: Sequence[Any]) -> None:
        """Hold another payload from the next wrench on; it was validated before."""
        for each in parameters:
            if each.name == 'gravity.timeout':
                self.forces.timeout_ns = round(each.value * NANOSECONDS)
        if not _NAMES.isdisjoint(each.name for each in parameters):
            try:
                self._hold(self._choose(self._settings()))
            except WristFtCompError as error:
                self._log.error(str(error))

    def poll(self) -> None:
        """Look whether TF tells now what a payload has waited for since the start."""
        if self.waiting and self.gravity.mount() is not None:
            self._hold(self._choose(self._settings()))

    def _hold(self, payload: LivePayload | None) -> None:
        """Hold a payload."""
        if payload is not None or self.payload is not None:
            self._log.info(f'payload: {payload or "none; wrench_external rests"}')
        self.payload, self.waiting = payload, ''
        self.collect(self._collect)

    def _choose(self, chosen: Mapping[str, Any]) -> LivePayload | None:
        """Find the payload that parameters name."""
        name = chosen['payload.active']
        if not name:
            return None
        if chosen['gravity.source'] == 'none':
            raise SettingsError(
                f'payload.active is {name}, but gravity.source is none, so nobody knows where '
                'down is. Start the node with -p gravity.source:=imu, or tf.'
            )
        learnt = self._shelf.payloads()
        if name == MANUAL:
            center = np.array(chosen['payload.center_of_mass'], dtype=float)
            payload = Payload(chosen['payload.mass'], center)
            return LivePayload(name, payload, self._turn())
        if name not in learnt:
            raise SettingsError(
                f'payload.active must be empty, {MANUAL}, or the name of a payload that was '
                f'learnt ({", ".join(learnt) or "there is none yet"}); got {name}. Learn it with '
                '~/identify_payload.'
            )
        if name not in self._shelf.frames():
            raise SettingsError(
                f'payload.active is {name}, which was learnt by {learnt[name][1].source}, and '
                f'gravity.source is {self._shelf.source}: another frame. Learn it again with '
                '~/identify_payload, or start the node with the source of then.'
            )
        return LivePayload(name, *learnt[name])

    def _turn(self) -> ForceFrame:
        """Find how specific force leads to the wrench's frame, for a payload nobody learnt."""
        frames = list(self._shelf.frames().values())
        frame = frames[-1] if frames else self.gravity.mount()
        if frame is None:
            raise _UnknownTurnError(
                f'payload.active is {MANUAL}, but nobody knows how specific force is turned in '
                "the wrench's frame: no payload has been learnt yet, and /tf_static has no way "
                'from the frame of the IMU to it. Call ~/identify_payload, or publish the way.'
            )
        return frame
