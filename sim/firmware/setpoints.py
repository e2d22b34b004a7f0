"""Set-points: protocol's `SetpointReceiver` selects them, the device follows them within its limits.

A stream moves the robot only while no goal and no command does; a goal or a stop ends it. When no set-point
arrives any more, the robot holds.

Pure. `now` is controller time in whole milliseconds.
"""

from collections.abc import Callable
from typing import Final

from robotree.protocol.messages import GoalState, Reason, Setpoint
from robotree.protocol.services.peer import Peer
from robotree.protocol.services.setpoint import SetpointReceiver, SetpointStatistics
from robotree.sim.errors import GoalRefused
from robotree.sim.firmware.device import Device
from robotree.sim.firmware.movement import Job, Movement
from robotree.sim.firmware.outgoing import Outgoing
from robotree.sim.firmware.rights import Rights

KEY: Final = "set-points"
"""Of the one job that all streams are."""


class Setpoints:
    """The set-points of one controller.

    Args:
        device: follows them.
        movement: whose job the stream is.
        rights: who may send them.
        fence: obeys an epoch, or says that it is over.
    """

    def __init__(
        self, device: Device, movement: Movement, rights: Rights, fence: Callable[[int], bool]
    ) -> None:
        self._device, self._movement, self._rights = device, movement, rights
        self._receiver = SetpointReceiver(device.setpoint_kinds, fence, rights.claims.life)

    @property
    def statistics(self) -> SetpointStatistics:
        """How many were obeyed, and why others were not."""
        return self._receiver.statistics

    def receive(self, setpoint: Setpoint, peer: Peer, now: int, arrived: int) -> list[Outgoing]:
        """Take a set-point that arrived at a moment [ms]; never answered."""
        job, seconds, voice = self._movement.job, now / 1000, self._rights.voice(peer)
        speaker = (peer.system, peer.component)
        if job is not None and job.passed:
            job = None  # nobody waits for it any more: the stream goes on from its motion
        over = bool(self._movement.bar) or (job is not None and job.key != KEY)
        if over or setpoint.kind not in self._device.setpoint_kinds or self._rights.guard(peer) is not None:
            self._receiver.refuse(setpoint, seconds, speaker, over=over)
            return []
        try:
            start = self._device.follow(setpoint.kind, setpoint.args)
        except GoalRefused:
            self._receiver.refuse(setpoint, seconds, speaker)
            return []
        if not self._receiver.receive(setpoint, seconds, speaker, arrived=arrived / 1000):
            return []
        if job is None:
            return self._movement.begin(Job(KEY, peer, voice, _silence, self._finish), start, now)
        start()
        self._movement.adopt(peer, voice, now)
        return []

    def tick(self, now: int) -> None:
        """Hold when the stream has dried up."""
        if self._receiver.active(now / 1000) is None:
            self._movement.leave(KEY)

    def _finish(self, _: GoalState, reason: Reason, text: str, now: int) -> list[Outgoing]:  # noqa: ARG002
        self._receiver.drop()
        return []


def _silence(_: float, __: int) -> list[Outgoing]:
    return []
