"""The rights to move the robot and to change it: operator control, the claim, and the lease's epoch.

While a ground station is in control, only it may command. Otherwise only the holder of the claim may. Without
a claim, a goal counts by its epoch. A command has none: while a lease is in force its sender must take
control first. A claim that has ended leaves no lease behind. Stops are accepted from all.

Protocol's `ClaimServer` decides who holds the claim. A motion under a claim is kept alive by the holder's
CLAIM alone, and ends with the claim.

Pure. `now` is controller time in whole milliseconds.
"""

from collections.abc import Hashable, Iterable

from robotree.protocol.messages import Claim, ControlStatus, MavSeverity, Reason
from robotree.protocol.services.claim_server import (
    ClaimChanged,
    ClaimRefused,
    ClaimServer,
    ClaimServerEffect,
    Holder,
    Holding,
)
from robotree.protocol.services.control import ControlChanged, OperatorControl
from robotree.protocol.services.fence import Refusal
from robotree.protocol.services.goal_server import OTHER_LIFE
from robotree.protocol.services.peer import Peer
from robotree.sim.firmware.movement import Movement
from robotree.sim.firmware.outgoing import Announcer, Outgoing, sends


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


class Claims:
    """The claim on one controller.

    Args:
        movement: what runs under it.
        rights: whose claim server decides.
        announcer: for sentences to people.
    """

    def __init__(self, movement: Movement, rights: Rights, announcer: Announcer) -> None:
        self._movement, self._rights, self._announcer = movement, rights, announcer
        self._server = rights.claims

    def receive(self, claim: Claim, peer: Peer, now: int, arrived: int) -> list[Outgoing]:
        """Take a claim that arrived at a moment [ms]; answered by who holds the controller."""
        out = self._carry_out(self._server.receive(claim, peer, now / 1000), now)
        held, job = self._server.holding, self._movement.job
        if held is not None and (held.holder, held.peer) == (claim.holder, peer):
            voice = Holder(held.holder)
            self._movement.watchdog.receive(voice, arrived)
            by_another_link = job is not None and job.voice == voice and job.speaker != peer
            before_its_claim = job is not None and job.voice != voice and job.speaker == peer
            if by_another_link or before_its_claim:
                self._movement.adopt(peer, voice, now)
        return out

    def tick(self, now: int) -> list[Outgoing]:
        """End the claim of a holder that is silent, and what moves under it."""
        return self._carry_out(self._server.tick(now / 1000), now)

    def link_closed(self, via: Hashable, now: int) -> None:
        """A link has ended."""
        self._server.link_closed(via, now / 1000)

    def _carry_out(self, effects: Iterable[ClaimServerEffect], now: int) -> list[Outgoing]:
        out: list[Outgoing] = []
        for effect in effects:
            if isinstance(effect, ClaimChanged):
                out += self._change(effect, now)
            elif isinstance(effect, ClaimRefused):
                out += self._tell_both(effect)
            else:
                out += sends([effect])
        return out

    def _change(self, change: ClaimChanged, now: int) -> list[Outgoing]:
        """End what moved under the claim before, and tell all."""
        before, after = change.before, change.after
        out = [Outgoing(self._server.status(), telemetry=True)]
        if after is not None:
            out += self._give_way(before, after, now)
        elif before is not None and self._moves_under(before):
            text = f"{_name(before)} was not heard any more, or has released its claim."
            out += self._movement.interrupt(Reason.LINK_SILENT, text, now)
        return out

    def _give_way(self, before: Holding | None, after: Holding, now: int) -> list[Outgoing]:
        """Somebody new holds the claim: what others move ends, but for who is in operator control."""
        out: list[Outgoing] = []
        job = self._movement.job
        others = before is not None and self._moves_under(before)  # the same ids do not make it ours
        if job is not None and (others or job.speaker not in {after.peer, self._rights.control.owner}):
            text = f"{_name(after)} commands this robot from now on."
            out += self._movement.interrupt(Reason.NOT_IN_CONTROL, text, now)
        if before is not None:
            out += self._announcer.announce(
                MavSeverity.WARNING, f"{_name(after)} took over from {_name(before)}."
            )
        return out

    def _tell_both(self, refused: ClaimRefused) -> list[Outgoing]:
        by, claimant = refused.by, refused.name or "Another program"
        why = f"{_name(by)} holds this robot; end it, or start your proxy with --take-over."
        out = self._announcer.announce(MavSeverity.WARNING, why, refused.peer.via)
        if by.peer is not None:
            text = f"{claimant} wants to command this robot and was refused."
            out += self._announcer.announce(MavSeverity.NOTICE, text, by.peer.via)
        return out

    def _moves_under(self, held: Holding) -> bool:
        job = self._movement.job
        return job is not None and job.voice == Holder(held.holder)


def _name(held: Holding) -> str:
    return held.name or "Another program"
