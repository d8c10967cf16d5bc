"""The services ~/tare and ~/reset_tare."""

from collections.abc import Sequence
import time
from typing import Any, TYPE_CHECKING

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.model.signals import AXES, axis_unit
from wrist_ft_comp.ros.parameters import PARAMETERS, values
from wrist_ft_comp.ros.services.deferred import Reply
from wrist_ft_comp.stream.tare import TareCollector

if TYPE_CHECKING:
    from wrist_ft_comp.ros.compensator_node import CompensatorNode

#: A tare that gets no wrenches is answered this long after it should have been done, s.
_GRACE_S = 2.0


class TareControl:
    """
    Owns the tare that is being taken, if one is.

    Parameters
    ----------
    node : CompensatorNode
        The owner.

    """

    def __init__(self, node: 'CompensatorNode') -> None:
        #: Collects the wrenches of the tare that is being taken.
        self.collector: TareCollector | None = None
        self._node = node
        self._reply: Reply | None = None
        self._deadline = 0.0

    def on_request(self, _request: Any, reply: Reply) -> None:
        """Start to collect wrenches; the answer comes when there are enough."""
        if self.collector is not None:
            reply(
                success=False, message='A tare is running; wait for its answer, then call again.'
            )
            return
        given = values(self._node, PARAMETERS)
        self.collector = TareCollector(given['tare.duration'], given['tare.max_deviation'])
        self._reply = reply
        self._deadline = time.monotonic() + given['tare.duration'] + _GRACE_S

    def on_reset(self, _request: Any, response: Any) -> Any:
        """Forget the tare."""
        self._node.compensator.reset_tare()
        self._node.keeping.save()
        response.success, response.message = True, 'the tare is zero again'
        return response

    def add(self, stamp_ns: int, raw: Sequence[float]) -> None:
        """Take one wrench, N and N m; answer when there are enough."""
        if self.collector is not None and self.collector.add(stamp_ns, raw):
            self._finish(self.collector)

    def poll(self) -> None:
        """Answer with what there is when wrenches stay away."""
        if self.collector is not None and time.monotonic() > self._deadline:
            self._finish(self.collector)

    def _finish(self, collector: TareCollector) -> None:
        """Set the tare, or say why not."""
        self.collector = None
        try:
            mean, stamp_ns = collector.result()
        except WristFtCompError as error:
            self._answer(success=False, message=str(error))
            return
        tare = self._node.compensator.set_tare(mean, stamp_ns)
        self._node.keeping.save()
        offsets = ', '.join(
            f'{axis} {value:.4g} {axis_unit(axis)}' for axis, value in zip(AXES, tare, strict=True)
        )
        self._node.console.info(f'tared: {offsets}')
        self._answer(success=True, message=f'tared: {offsets}')

    def _answer(self, *, success: bool, message: str) -> None:
        """Answer the asker."""
        if not success:
            self._node.note_refusal('~/tare', message)
            self._node.console.warning(f'not tared: {message}')
        if self._reply is not None:
            self._reply(success=success, message=message)

    def end(self) -> bool:
        """Stop taking a tare; tell whether its asker was answered just now."""
        if self.collector is None:
            return False
        self.collector = None
        self._answer(success=False, message='The node is shutting down; the tare is unchanged.')
        return True
