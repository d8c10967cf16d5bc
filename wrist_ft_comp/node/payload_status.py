"""What the diagnostics say of the payload: ``PayloadReport`` judges it once a second."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
import math
import time
from typing import Any

import numpy as np

from wrist_ft_comp.node.external_wrench import changed_frames, ExternalWrench, MANUAL
from wrist_ft_comp.node.identify_payload import IdentifyService
from wrist_ft_comp.payload.live_weight import Force
from wrist_ft_comp.payload.weight import ForceFrame
from wrist_ft_comp.ros.hub import Part
from wrist_ft_comp.ros.node_log import doubtful, Status
from wrist_ft_comp.signals import AXES, axis_unit, FloatArray, GRAVITY, NANOSECONDS
from wrist_ft_comp.stream.compensator import Compensator

#: Specific force and wrench whose stamps differ by more come from different clocks, s.
_SAME_CLOCK_S = 3600.0
#: No unit but m/s² gives a norm between these at rest; and so many reports without a change of any
#: bit are a frozen sensor.
_NORMS, _FROZEN = (0.5 * GRAVITY, 2.0 * GRAVITY), 5
#: An accelerometer that was learnt is off by less, as a share of gravity; motion adds more, but
#: not to one side in as many reports in a row.
_OFF, _OFF_REPORTS = 0.03, 10


@dataclass(eq=False)
class PayloadReport(Part):
    """Judges the payload in operation."""

    _compensator: Compensator
    _external: ExternalWrench
    _identify: IdentifyService
    #: Tells the newest wrench, of which the stamp, ns, comes first; None before there is one.
    _newest: Callable[[], tuple[int, Any, Any] | None]
    _before: tuple[float, int, int, int] = field(
        default_factory=lambda: (time.monotonic(), 0, 0, 0)
    )
    _same: tuple[Force | None, int] = None, 0
    #: In how many reports in a row it was too large, or, negative, too small.
    _off: float = 0.0

    title = 'payload'

    def statuses(self) -> Iterator[Status]:
        """Judge how it stands at the stamp of the newest wrench."""
        external, forces, newest = self._external, self._external.forces, self._newest()
        now = time.monotonic(), forces.count, external.published, external.missed
        elapsed_s, *grown = (a - b for a, b in zip(now, self._before, strict=True))
        (heard, sent, missed), self._before = grown, now
        age_s = None
        if newest is not None and forces.newest is not None:
            age_s = (newest[0] - forces.newest[0]) / NANOSECONDS
        numbers = {
            'active': str(external.payload or 'none'),
            'turn': 'none' if external.payload is None else external.payload.turn,
            'force_rate_hz': f'{heard / max(elapsed_s, 1e-9):.1f}',
            'force_age_s': 'never' if age_s is None else f'{age_s:.3f}',
            'rate_hz': f'{sent / max(elapsed_s, 1e-9):.1f}',
            'published': str(external.published),
            'last_identification': self._identify.last_outcome or 'none yet',
        }
        for axis, value in zip(AXES, self._compensator.external_tare, strict=True):
            numbers[f'{axis}_tare'] = f'{value:.4g} {axis_unit(axis)}'
        yield doubtful(self.title, self._troubles(age_s, heard, missed), self._well(), numbers)

    def _well(self) -> str:
        """Say what is done where nothing is wrong."""
        progress, payload = self._identify.progress, self._external.payload
        if progress is not None:
            return f'identifying a payload: {progress:.0%} of a minute'
        if payload is None:
            return 'no payload is active'
        other = self._external.disagreement(payload.frame)
        return f'subtracting {payload.name}{other and "; "}{other}'

    def _troubles(self, age_s: float | None, heard: float, missed: float) -> Iterator[str]:
        """Say what is wrong with specific force that somebody wants, the worst first."""
        yield from filter(None, (self._external.waiting, self._external.gravity.doubt()))
        newest, rests = self._external.forces.newest, 'wrench_external rests'
        if not self._external.wanted:
            return
        if newest is None:
            yield f'{self._external.gravity.problem() or "no specific force has come"}; {rests}'
            return
        force = newest[1]
        self._same = force, self._same[1] + 1 if heard and force == self._same[0] else 0
        if age_s is not None and abs(age_s) > _SAME_CLOCK_S:
            yield f'wrench and specific force are {abs(age_s):.0f} s apart: two clocks; {rests}'
        if missed:
            yield f'specific force is older than gravity.timeout, or stays away; {rests}'
        yield from self._off_gravity(np.array(force))
        if self._same[1] >= _FROZEN:
            yield 'specific force has not changed by a bit for seconds; is the IMU frozen?'
        held = self._external.payload
        if held is None:
            return
        if changed := changed_frames(held.frame, self._external.gravity.frames()):
            yield f'{held.name} was learnt under other frame_ids: {changed}; is it another sensor?'
        if held.name == MANUAL and (other := self._external.disagreement(held.frame)):
            yield f'{held.turn}; {other}'

    def _off_gravity(self, force: FloatArray) -> Iterator[str]:
        """Doubt a specific force, (3,), that is no gravity by what was learnt."""
        held = self._external.payload
        norm = float(np.linalg.norm((ForceFrame() if held is None else held.frame).turn(force)))
        if not _NORMS[0] < norm < _NORMS[1]:
            yield f'specific force is {norm:.3g} m/s², and {GRAVITY} at rest; check its unit'
        off = norm / GRAVITY - 1
        lasts = abs(off) > _OFF and off * self._off > 0
        self._off = (self._off if lasts else 0.0) + math.copysign(abs(off) > _OFF, off)
        if held is not None and abs(self._off) >= _OFF_REPORTS:
            yield (
                f'specific force is {off:+.0%} off gravity by the accelerometer of {held.name}, '
                'and so is the weight that is taken off; call ~/identify_payload'
            )
