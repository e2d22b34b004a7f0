"""Goals: protocol's `GoalServer` keeps keys and epochs, `Movement` moves the robot.

A preview says whether a goal would begin now, and which way it would lead; nothing moves. The device's own
planner answers (`Device.prepare`), so a preview can neither allow what a goal is refused nor the other way
round. Anybody may ask: it changes nothing, and who does not hold the controller wants to know.

Pure. `now` is controller time in whole milliseconds.
"""

import logging
from collections.abc import Iterable

from robotree.protocol.messages import Goal, GoalCancel, GoalState, Reason, WayRequest, WayStatus
from robotree.protocol.services.fence import Refusal
from robotree.protocol.services.goal_server import (
    Abandon,
    Begin,
    GoalId,
    GoalServer,
    GoalServerEffect,
    misfit,
)
from robotree.protocol.services.peer import Peer
from robotree.sim.errors import GoalRefused
from robotree.sim.firmware.device import POINTS, Device, Start, WayAhead
from robotree.sim.firmware.movement import Job, Movement
from robotree.sim.firmware.outgoing import Outgoing, sends
from robotree.sim.firmware.rights import Rights

_log = logging.getLogger(__name__)


class Goals:
    """The goals of one controller.

    Args:
        device: plans them.
        movement: carries them out.
        rights: who may have one begun.
    """

    def __init__(self, device: Device, movement: Movement, rights: Rights) -> None:
        self._device, self._movement = device, movement
        self._rights = rights
        claims = rights.claims
        self._server = GoalServer(
            device.verbs, self._check, rights.guard, fence=claims.fence, life=claims.life
        )
        self._prepared: Start = device.hold
        """Begins the goal that was checked last."""

    @property
    def epoch(self) -> int:
        """The highest epoch obeyed."""
        return self._server.epoch

    def fence(self, epoch: int) -> bool:
        """Obey an epoch from now on; False: it is older than one already obeyed."""
        return self._server.fence(epoch)

    def receive(self, message: Goal | GoalCancel, peer: Peer, now: int) -> list[Outgoing]:
        """Take a goal or the end of one."""
        out = self._carry_out(self._server.receive(message, peer, now / 1000), now)
        self._hand_over(now)
        whichever = isinstance(message, GoalCancel) and not message.key
        if whichever and self._rights.objection(message.epoch, message.life) is None:
            out += self._movement.interrupt(Reason.OPERATOR, "", now)
        return out

    def tick(self, now: int) -> list[Outgoing]:
        """End the goals whose time to live is over."""
        return self._carry_out(self._server.tick(now / 1000), now)

    def preview(self, question: WayRequest, peer: Peer, now: int) -> list[Outgoing]:  # noqa: ARG002  as all hear
        """Whether a goal would begin now, and which way it would lead; for its asker alone."""
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

    def _hand_over(self, now: int) -> None:
        """Follow a peer that may command to the link over which it asks for the running goal, by its key."""
        job = self._movement.job
        if job is not None and isinstance(job.key, GoalId):
            asker = self._server.asker(job.key)
            if asker != job.speaker:
                self._movement.adopt(asker, self._rights.voice(asker), now)

    def _check(self, goal: Goal) -> Refusal | None:
        """Why a goal cannot be begun now; what was planned meanwhile is kept for its beginning."""
        if bar := self._movement.bar:
            return Reason.STOPPED, bar
        try:
            self._prepared = self._device.prepare(goal.verb, goal.args)
        except GoalRefused as refusal:
            return refusal.reason, str(refusal)
        return None

    def _carry_out(self, effects: Iterable[GoalServerEffect], now: int) -> list[Outgoing]:
        out: list[Outgoing] = []
        for effect in effects:
            if isinstance(effect, Begin):
                values = " ".join(f"{value:.6f}" for value in effect.args)
                _log.debug("begin %d verb %d: %s", effect.id.key, effect.verb, values)
                out += self._begin(effect.id, now)
            elif isinstance(effect, Abandon):
                self._movement.leave(effect.id)
            else:
                out += sends([effect])
        return out

    def _begin(self, goal: GoalId, now: int) -> list[Outgoing]:
        def progress(fraction: float, now: int) -> list[Outgoing]:
            return sends(self._server.progress(goal, fraction, now / 1000))

        def finish(state: GoalState, reason: Reason, text: str, now: int) -> list[Outgoing]:
            _log.debug("end %d %s", goal.key, state.name)
            return sends(self._server.finish(goal, state, now / 1000, reason, text))

        asker = self._server.asker(goal)
        job = Job(goal, asker, self._rights.voice(asker), progress, finish)
        out = self._movement.begin(job, self._prepared, now)
        return out + sends(self._server.activate(goal, now / 1000))
