"""Set-points: protocol's `SetpointReceiver` says which to follow, the device follows them within its limits.

A stream moves the robot only while no goal and no command does; a goal or a stop ends it. When it dries up
the robot holds.

Pure. `now` is controller time in whole milliseconds.
"""

from collections.abc import Callable
from typing import Final

import msgspec

from robotree.protocol.messages import GoalState, Reason, Setpoint
from robotree.protocol.services.peer import Peer
from robotree.protocol.services.setpoint import SetpointReceiver, SetpointStatistics
from robotree.sim.errors import GoalRefused
from robotree.sim.firmware.device import Device
from robotree.sim.firmware.movement import Job, Movement
from robotree.sim.firmware.outgoing import Outgoing
from robotree.sim.firmware.rights import Rights
from robotree.sim.firmware.telemetry import boot_ms

KEY: Final = "set-points"
"""Of the one job that all streams are."""
_HALF: Final = 1 << 31
"""[ms] that a moment on the wire may be ahead or behind."""


class Streaming:
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
        self._receiver = SetpointReceiver(device.setpoint_kinds, fence)
        self.arrived = 0
        """When what is being heard arrived [ms]."""

    @property
    def statistics(self) -> SetpointStatistics:
        """How many were obeyed, and why others were not."""
        return self._receiver.statistics

    def hear(self, setpoint: Setpoint, peer: Peer, now: int) -> list[Outgoing]:
        """Take a set-point; never answered."""
        job, seconds = self._movement.job, now / 1000
        speaker = (peer.system, peer.component)
        over = bool(self._movement.bar) or (job is not None and job.key != KEY)
        if over or setpoint.kind not in self._device.setpoint_kinds or self._rights.guard(peer) is not None:
            self._receiver.refuse(setpoint, seconds, speaker, over=over)
            return []
        try:
            start = self._device.follow(setpoint.kind, setpoint.args)
        except GoalRefused:
            self._receiver.refuse(setpoint, seconds, speaker)
            return []
        if not self._receiver.receive(self._dated(setpoint), seconds, speaker):
            return []
        if job is None:
            return self._movement.begin(Job(KEY, peer, _silence, self._finish), start, now)
        start()
        self._movement.adopt(peer, now)
        return []

    def tick(self, now: int) -> None:
        """Hold when the stream has dried up."""
        if self._receiver.active(now / 1000) is None:
            self._movement.leave(KEY)

    def _dated(self, setpoint: Setpoint) -> Setpoint:
        """A set-point with the moment at which it was made in controller time, which never begins anew.

        Who does not say it made it when it arrived.
        """
        word, arrived = setpoint.time_boot_ms, self.arrived
        ahead = boot_ms(word - arrived + _HALF) - _HALF if word else 0
        made = max(arrived + ahead, 1)  # 0 would mean that nobody knows
        return msgspec.structs.replace(setpoint, time_boot_ms=made)

    def _finish(self, _: GoalState, reason: Reason, text: str, now: int) -> list[Outgoing]:  # noqa: ARG002
        self._receiver.drop()
        return []


def _silence(_: float, __: int) -> list[Outgoing]:
    return []
