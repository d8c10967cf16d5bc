"""The part that tells where down is, to all parts that want to know."""

from functools import partial
from typing import Any

from wrist_ft_comp.node.specific_force import GravitySource
from wrist_ft_comp.payload.weight import ForceFrame, FrameIds
from wrist_ft_comp.ros.hub import Hub, Part


class Gravity(Part):
    """Hears what the parameters ``gravity.…`` say, and tells all parts each specific force."""

    title = 'gravity'

    def __init__(self, chosen: dict[str, Any]) -> None:
        self._chosen = chosen
        self.source: GravitySource | None = None

    def start(self, hub: Hub) -> None:
        """Subscribe; SettingsError when what is asked for cannot be had."""

        def on_force(
            stamp_ns: int, force: tuple[float, float, float], speed: float | None
        ) -> None:
            hub.tell('on_force', stamp_ns or hub.now_ns(), force, speed)

        guard = partial(hub.guarded, self)
        self.source = GravitySource(self._chosen, hub, hub.hardware_id, on_force, guard)

    def poll(self) -> None:
        """Take what an IMU has sent."""
        if self.source is not None and not self.stopped:
            self.source.poll()

    def frames(self) -> FrameIds:
        """Tell the frame_ids of specific force and wrench, as far as they are known yet."""
        return FrameIds() if self.source is None else self.source.frames()

    def mount(self) -> ForceFrame | None:
        """Tell how TF turns specific force into the wrench's frame; None where it does not."""
        return None if self.source is None else self.source.mount()

    def doubt(self) -> str:
        """Say what is wrong with what specific force comes from; or nothing."""
        return '' if self.source is None else self.source.doubt()

    def problem(self) -> str:
        """Say why TF tells nothing; empty where it tells something, or is not asked."""
        return '' if self.source is None else self.source.problem()
