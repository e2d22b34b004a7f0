"""The rights to move the robot and to change it: operator control, the claim, and the lease's epoch.

While a ground station is in control, only it may command. Otherwise only the holder of the claim may. Without
a claim, a goal counts by its epoch. A command has none: while a lease is in force its sender must take
control first. A claim that has ended leaves no lease behind. Stops are accepted from all.

Pure. `now` is controller time in whole milliseconds.
"""

from collections.abc import Hashable

from robotree.protocol.messages import ControlStatus, Reason
from robotree.protocol.services.claim_server import ClaimServer
from robotree.protocol.services.control import ControlChanged, OperatorControl
from robotree.protocol.services.fence import Refusal
from robotree.protocol.services.goal_server import OTHER_LIFE
from robotree.protocol.services.peer import Peer
from robotree.sim.firmware.outgoing import Outgoing, sends


class Rights:
    """Decides for one controller.

    Args:
        claims: who holds the claim, and the epochs that are obeyed.
    """

    def __init__(self, claims: ClaimServer) -> None:
        self.control = OperatorControl()
        self.claims = claims

    def guard(self, peer: Peer) -> Refusal | None:
        """Why a peer may not have a goal or a set-point carried out; None: it may."""
        owner = self.control.owner
        if owner is None:
            return self.claims.guard(peer)
        if self.control.may(peer):
            return None
        return Reason.NOT_IN_CONTROL, f"System {owner.system} is in control; ask it, or wait."

    def voice(self, peer: Peer) -> Hashable:
        """The sender that must be heard while something moves for a peer."""
        return peer if peer == self.control.owner else self.claims.voice(peer)

    def objection(self, epoch: int, life: int) -> Refusal | None:
        """Why a word of an epoch, made for a life of this controller, is not obeyed; None: it is.

        Args:
            epoch: of the speaker's lease.
            life: that the word names; 0: any.
        """
        if life not in {0, self.claims.life}:
            return Reason.OTHER_LIFE, OTHER_LIFE
        return self.claims.fence.objection(epoch)

    def may_set(self, peer: Peer) -> bool:
        """Whether a peer may set parameters: as it may command, but without an epoch."""
        return self.guard(peer) is None

    def why_not(self, peer: Peer) -> str | None:
        """Return why a peer may not command; None: it may."""
        held, epoch = self.claims.holding, self.claims.fence.epoch
        if self.control.owner is None and self.claims.leased:
            by = f"{held.name}, " if held is not None and held.name else ""
            return (
                f"A lease ({by}epoch {epoch}) commands this robot, and a command carries none; "
                "take operator control first (command 32100)."
            )
        refusal = self.guard(peer)
        return None if refusal is None else refusal[1]

    def heard(self, peer: Peer, now: int) -> None:
        """Note a sign of life."""
        self.control.heard(peer, now / 1000)

    def link_closed(self, via: Hashable, now: int) -> None:
        """A link ended; who was in control on it is no more."""
        self.control.link_closed(via, now / 1000)

    def tick(self, now: int) -> tuple[list[Outgoing], Peer | None]:
        """Return the messages that are due, and the peer that has just taken control, if there is one."""
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
