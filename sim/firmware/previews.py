"""Previews: whether a goal would begin now, and which way it would lead. Nothing moves.

The device's own planner answers (`Device.prepare`), so a preview can neither allow what a goal is refused nor
the other way round. Anybody may ask: it changes nothing, and who does not hold the controller wants to know.

Pure. `now` is controller time in whole milliseconds.
"""

from robotree.protocol.messages import Reason, WayRequest, WayStatus
from robotree.protocol.services.goal_server import misfit
from robotree.protocol.services.peer import Peer
from robotree.sim.errors import GoalRefused
from robotree.sim.firmware.device import POINTS, Device, WayAhead
from robotree.sim.firmware.movement import Movement
from robotree.sim.firmware.outgoing import Outgoing


class Previews:
    """Answers previews for one controller.

    Args:
        device: plans.
        movement: knows what forbids every movement.
    """

    def __init__(self, device: Device, movement: Movement) -> None:
        self._device, self._movement = device, movement

    def receive(self, question: WayRequest, peer: Peer, now: int) -> list[Outgoing]:  # noqa: ARG002  as all hear
        """The answer to a question, for its asker alone."""
        reason, text, way = Reason.NONE, "", WayAhead()
        if objection := misfit(question.verb, question.args, self._device.verbs):
            reason, text = objection
        elif bar := self._movement.bar:
            reason, text = Reason.STOPPED, bar
        else:
            try:
                way = self._device.way(question.verb, question.args)
                if not way.points:
                    self._device.prepare(question.verb, question.args)
            except GoalRefused as refusal:
                reason, text = refusal.reason, str(refusal)
        points = [*way.points][:POINTS]
        x, y, z = ([point[axis] for point in points] for axis in range(3))
        empty = [0.0] * (POINTS - len(points))
        status = WayStatus(
            number=question.number,
            x=(*x, *empty),
            y=(*y, *empty),
            z=(*z, *empty),
            duration=way.duration,
            reason=reason,
            target_system=peer.system,
            target_component=peer.component,
            count=len(points),
            text=text,
        )
        return [Outgoing(status, peer.via)]
