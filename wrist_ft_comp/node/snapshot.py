"""What the node knows about its inputs when it judges them."""

from collections.abc import Mapping
from typing import NamedTuple

from wrist_ft_comp.node.input_health import Counts, InputHealth
from wrist_ft_comp.node.live_model import LiveModel
from wrist_ft_comp.node.state_keeper import StateKeeper
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.wire.temperature_source import TemperatureSource


class Snapshot(NamedTuple):
    """Thermometer 0 is called 1; times are those of a steady clock, s."""

    now_s: float
    health: InputHealth
    #: Per topic, by relative name, the policy on which some other side does not agree.
    incompatible: dict[str, str]
    stream: Compensator
    live: LiveModel
    state_keeper: StateKeeper
    #: What had been counted at the report before, and how long ago that was.
    before: Counts
    elapsed_s: float
    #: Full name, and relative ones; how many publishers each has.
    wrench_topic: str
    #: How the temperature of each thermometer is read.
    sources: tuple[TemperatureSource, ...]
    #: What the topic carries instead of wrenches; empty when it is right.
    wrench_problem: str
    #: Messages of which no temperature could be read.
    unreadable: int
    #: Why a thermometer, counted from 0, can't be read; only those that can't.
    thermometer_problems: Mapping[int, str]
    wrench_publishers: int
    temperature_publishers: tuple[int, ...]

    def rate_hz(self, what: str) -> float:
        """Messages of one count per second, since the report before."""
        return self.grown(what) / max(self.elapsed_s, 1e-9)

    def grown(self, what: str) -> int:
        """Messages of one count since the report before."""
        return int(getattr(self.health.counts, what) - getattr(self.before, what))

    def age(self, at_s: float | None) -> str:
        """Write how long ago something was, s."""
        return 'never' if at_s is None else f'{self.now_s - at_s:.1f}'
