"""Who may move the robot and change it: operator control on the wire, and the lease's epoch.

While a ground station is in control, only it may. While nobody is, a goal counts by its epoch, as always; a
command, which carries none, counts as epoch 0: where the epoch of a lease was obeyed, it takes control first.
Stops are everyone's.

Pure. `now` is controller time in whole milliseconds.
"""

from collections.abc import Callable, Hashable

from robotree.protocol.messages import ControlStatus, Reason
from robotree.protocol.services.control import ControlChanged, OperatorControl
from robotree.protocol.services.goal_server import Refusal
from robotree.protocol.services.peer import Peer
from robotree.sim.firmware.outgoing import Outgoing, sends


class Rights:
    """Decides for one controller.

    Args:
        epoch: the highest that was obeyed.
    """

    def __init__(self, epoch: Callable[[], int]) -> None:
        self.control = OperatorControl()
        self._epoch = epoch

    def guard(self, peer: Peer) -> Refusal | None:
        """Why a peer may not have a goal or a set-point carried out; None: it may."""
        owner = self.control.owner
        if owner is None or self.control.may(peer):
            return None
        return Reason.NOT_IN_CONTROL, f"System {owner.system} is in control; ask it, or wait."

    def may_set(self, peer: Peer) -> bool:
        """Whether a peer may set parameters."""
        return self.guard(peer) is None

    def why_not(self, peer: Peer) -> str | None:
        """What to tell a peer that may not command; None: it may."""
        if (refusal := self.guard(peer)) is not None:
            return refusal[1]
        if self.control.owner is None and self._epoch():
            return (
                f"A lease (epoch {self._epoch()}) commands this robot, and a command carries none; "
                "take operator control first (command 32100)."
            )
        return None

    def heard(self, peer: Peer, now: int) -> None:
        """Note a sign of life."""
        self.control.heard(peer, now / 1000)

    def link_closed(self, via: Hashable, now: int) -> None:
        """A link ended; who was in control on it is no more."""
        self.control.link_closed(via, now / 1000)

    def tick(self, now: int) -> tuple[list[Outgoing], Peer | None]:
        """What to say, and who has just taken control, if somebody has."""
        out: list[Outgoing] = []
        new: Peer | None = None
        for effect in self.control.tick(now / 1000):
            if isinstance(effect, ControlStatus):
                out.append(Outgoing(effect, telemetry=True))
            elif isinstance(effect, ControlChanged):
                new = effect.owner
            else:
                out += sends([effect])
        return out, new
