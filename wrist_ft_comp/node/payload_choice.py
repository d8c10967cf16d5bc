"""Which payload is subtracted: the one that parameters name, of those that are known here."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.node.live_model import LiveModel
from wrist_ft_comp.node.specific_force import SpecificForceInput
from wrist_ft_comp.payload.weight import ForceFrame, FrameIds, LivePayload, Payload
from wrist_ft_comp.stored.payload_file import Learnt, load_payloads, PAYLOADS

#: Value of payload.active for the payload of payload.mass and payload.center_of_mass.
MANUAL = 'manual'


def changed_frames(frame: ForceFrame, here: FrameIds) -> str:
    """Say which frame_ids differ from those of a learnt frame, where both are known."""
    then = FrameIds(frame.force_frame, frame.wrench_frame)
    pairs = [(before, now) for before, now in zip(then, here, strict=True) if before and now]
    return ' and '.join(f'{before} is now {now}' for before, now in pairs if before != now)


def unknown_turn(here: FrameIds) -> str:
    """Say that an IMU's rotation is not known, where its frame_id is not that of the wrench."""
    if here.wrench_frame and here.force_frame == here.wrench_frame:
        return ''
    return (
        f'payload.active is {MANUAL}, but the rotation from the IMU to the frame of the wrench is '
        'not known: this sensor has learnt no payload yet, and they have no frame_id in common '
        f'({here.force_frame or "none"} and {here.wrench_frame or "none"}). Call '
        '~/identify_payload first; that takes a minute of motion.'
    )


@dataclass(eq=False)
class PayloadChoice:
    """The payloads that are known here, and how specific force is turned with each of them."""

    live: LiveModel
    specific_force: SpecificForceInput

    @property
    def own_path(self) -> Path:
        """Path of the payloads that this node has learnt; others lie beside the live model."""
        return self.live.store.directory / 'models' / PAYLOADS

    def payloads(self) -> Learnt:
        """Read all payloads, oldest first; of two with the same name, the node's own one."""
        files = [*(model.with_name(PAYLOADS) for model in self._models()), self.own_path]
        return {name: one for path in files for name, one in load_payloads(path).items()}

    def _models(self) -> list[Path]:
        """Find the models of this sensor whose payloads count: model_file, and the live one."""
        given, stored = self.specific_force.hub.chosen()['model_file'], self.live.stored
        models = [self.live.store.locate(given)] if given else []
        return models if stored is None else [*models, stored.path]

    def frames(self) -> dict[str, ForceFrame]:
        """
        Find the frames that were learnt with this source and this sensor, oldest first.

        Those are the frames learnt with the live model, with model_file, or by this node under the
        same frame_ids. An empty frame_id is not compared.
        """
        own, here = load_payloads(self.own_path), self.specific_force.frames()
        stems = {model.stem for model in self._models()}
        return {
            name: frame
            for name, (_, frame) in self.payloads().items()
            if frame.source == self.specific_force.source
            and (name.rpartition('-')[0] in stems or (name in own and frame.wrench_frame))
            and not changed_frames(frame, here)
        }

    def choose(self, chosen: Mapping[str, Any]) -> LivePayload | None:
        """Find the payload that parameters name."""
        center_m = np.array(chosen['payload.center_of_mass'], float)
        by_hand = Payload(chosen['payload.mass'], center_m)
        name, source = chosen['payload.active'], self.specific_force.source
        if not name:
            return None
        if source == 'none':
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
            # With TF no rotation is needed. That of an IMU is the newest learnt one.
            if source == 'tf':
                return LivePayload(name, by_hand, ForceFrame(source=source), 'as TF gives it')
            if found := list(self.frames().items()):
                return LivePayload(name, by_hand, found[-1][1], f'learnt with {found[-1][0]}')
            here = self.specific_force.frames()
            if any(here) and (problem := unknown_turn(here)):
                raise SettingsError(problem)
            # At a start neither has come yet; the status says it until they are one.
            said = f'because both frame_ids are {here.wrench_frame or "taken for one"}'
            frame = ForceFrame(source=source, **here._asdict())
            return LivePayload(name, by_hand, frame, said, is_assumed=True)
        learnt = self.payloads()
        if name not in learnt:
            raise SettingsError(
                f'payload.active must be empty, {MANUAL}, or the name of a payload that was '
                f'learnt ({", ".join(learnt) or "there is none yet"}); got {name}. Learn it with '
                '~/identify_payload.'
            )
        frame = learnt[name][1]
        # A frame of an unknown source that turns is an IMU's: by TF force needs no turn.
        unknown = 'imu' if source == 'tf' and not frame.does_nothing else source
        learnt_by = frame.source or unknown
        if learnt_by != source:
            raise SettingsError(
                f'payload.active is {name}, which was learnt by {learnt_by}, and gravity.source '
                f'is {source}, which has another frame. Learn the payload again with '
                '~/identify_payload, or start the node with the old gravity.source.'
            )
        turned = f'learnt with it by {frame.source or "an unknown source"}'
        return LivePayload(name, *learnt[name], turned)
