"""Claims, the controller's side: who commands it, and what keeps a motion alive. Pure.

A claim is a lease at the controller. It has one holder at a time; CLAIM requests it and keeps it. While the
holder is heard (a CLAIM within its own term), claims of others are refused, and both sides are told. A person
may take the claim over explicitly. A claim ends when the holder releases it, is silent for its term, or
`GRACE` after its link has ended, whichever comes first: a holder that reconnects at once still has it.

The holder is a number that a proxy draws at random in each of its lives, not its system and component ids:
others may have the same ids, and a ground station with the same ids must not keep the claim alive. Messages
that carry only ids belong to the claim if they come over the link and with the ids of the last CLAIM.

The claim is kept over the controller's restart (`Fence.keep`). After a restart the former holder has
`RESERVED` to come back before the claim is granted to anybody else.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.messages import Claim, ClaimStatus, ClaimWish, Reason
from robotree.protocol.services.peer import Peer, Send

if TYPE_CHECKING:
    from collections.abc import Hashable

    from robotree.protocol.services.fence import Fence, Refusal

PERIOD = 1.0
"""[s] between two CLAIM_STATUS that answer nobody."""
SHORTEST_TERM, LONGEST_TERM = 0.1, 60.0
"""[s] A holder that is gone keeps nobody out for longer."""
GRACE = 0.5
"""[s] after the end of its link in which the holder may come back on another one."""
RESERVED = 3.0
"""[s] after a start for which the last holder is waited for."""
BETWEEN_NEWS = 10.0
"""[s] between two sentences about the same claimant who is refused."""
MAX_PEERS = 64
"""Claimants who were refused and are remembered."""
_WISHES = frozenset(ClaimWish)


class Holder(msgspec.Struct, frozen=True):
    """The voice that keeps alive what moves under a claim."""

    id: int


class Holding(msgspec.Struct, frozen=True):
    """A claim in force."""

    holder: int
    name: str
    peer: Peer | None
    """Where the last CLAIM came from; None: it has yet to come, on this link or in this life."""
    until: float
    """[s]"""
    term: float
    """[s]"""


class ClaimChanged(msgspec.Struct, frozen=True):
    """Somebody else holds the claim, or nobody does."""

    before: Holding | None
    after: Holding | None


class ClaimRefused(msgspec.Struct, frozen=True):
    """Somebody was refused because another one holds the claim; told once in a while."""

    by: Holding
    peer: Peer
    name: str


ClaimServerEffect = Send | ClaimChanged | ClaimRefused


class ClaimServer:
    """The claim on one controller.

    Args:
        fence: the epochs that it obeys.
        life: names this life of the controller, 1 to 65535.
        now: [s]
    """

    def __init__(self, fence: Fence, life: int, now: float = 0.0) -> None:
        self.fence, self.life = fence, life
        self.holding: Holding | None = None
        """The claim in force."""
        if fence.holder:
            self.holding = Holding(fence.holder, fence.name, None, now + RESERVED, RESERVED)
        self._over = fence.epoch
        """The epoch that the fence had when the claim was free last: the leases up to it are over."""
        self._refused: dict[int, float] = {}

    # -- who may

    def guard(self, peer: Peer) -> Refusal | None:
        """Why a peer may not command; None: it may."""
        held = self.holding
        if held is None or held.peer == peer:
            return None
        return Reason.NOT_IN_CONTROL, _held_by(held)

    @property
    def leased(self) -> bool:
        """Whether a lease is in force: a claim, or an epoch that was obeyed since the last claim ended."""
        return self.holding is not None or self.fence.epoch > self._over

    def voice(self, peer: Peer) -> Hashable:
        """The sender that must be heard while something moves for a peer: the claim's holder, or the peer."""
        held = self.holding
        return Holder(held.holder) if held is not None and held.peer == peer else peer

    def status(self, to: Peer | None = None, reason: Reason = Reason.NONE) -> ClaimStatus:
        """The holder of the claim, for everybody, or as the answer to a claim."""
        held = self.holding
        return ClaimStatus(
            holder=held.holder if held else 0,
            epoch=self.fence.epoch,
            term_ms=round(1000 * held.term) if held else 0,
            life=self.life,
            target_system=to.system if to else 0,
            target_component=to.component if to else 0,
            holder_system=held.peer.system if held and held.peer else 0,
            holder_component=held.peer.component if held and held.peer else 0,
            reason=reason,
            name=held.name if held else "",
        )

    # -- what happens

    def receive(self, claim: Claim, peer: Peer, now: float) -> list[ClaimServerEffect]:
        """Take a claim that is addressed to this controller."""
        effects: list[ClaimServerEffect] = [*self.tick(now)]
        held = self.holding
        ours = held is not None and held.holder == claim.holder
        if (reason := self._malformed(claim)) != Reason.NONE:
            pass
        elif claim.wish == ClaimWish.RELEASE:
            effects += self._release() if ours else []
        elif held is not None and not ours and claim.wish != ClaimWish.TAKE_OVER:
            reason = Reason.NOT_IN_CONTROL
            effects += self._tell_both(held, claim, peer, now)
        elif (reason := self._objection(claim)) == Reason.NONE:
            effects += self._grant(claim, peer, now)
        return [*effects, Send(self.status(peer, reason), peer.via)]

    def link_closed(self, via: Hashable, now: float) -> None:
        """A link has ended; the holder on it has `GRACE` to come back."""
        held = self.holding
        if held is not None and held.peer is not None and held.peer.via == via:
            until = min(held.until, now + GRACE)
            self.holding = msgspec.structs.replace(held, peer=None, until=until)

    @property
    def due(self) -> float:
        """When to call `tick` next, [s]."""
        return inf if self.holding is None else self.holding.until

    def tick(self, now: float) -> list[ClaimChanged]:
        """End the claim whose holder was silent for its term."""
        if self.holding is None or now < self.holding.until:
            return []
        before, self.holding, self._over = self.holding, None, self.fence.epoch
        return [ClaimChanged(before, None)]

    # -- inside

    def _malformed(self, claim: Claim) -> Reason:
        if not claim.holder or claim.wish not in _WISHES:
            return Reason.BAD_ARGUMENT
        return Reason.NONE if claim.life in {0, self.life} else Reason.OTHER_LIFE

    def _objection(self, claim: Claim) -> Reason:
        """An epoch belongs to one holder: another one must bring a larger one."""
        ours = self.holding is not None and self.holding.holder == claim.holder
        if ours and claim.epoch <= self.fence.epoch:
            return Reason.NONE  # it was overtaken by a goal under a newer lease of the same holder
        if claim.epoch == self.fence.epoch and claim.holder != self.fence.holder:
            return Reason.STALE_EPOCH
        refusal = self.fence.objection(claim.epoch)
        return Reason.NONE if refusal is None else refusal[0]

    def _grant(self, claim: Claim, peer: Peer, now: float) -> list[ClaimServerEffect]:
        before, term = self.holding, min(max(claim.term_ms / 1000, SHORTEST_TERM), LONGEST_TERM)
        self.fence.grant(max(claim.epoch, self.fence.epoch), claim.holder, claim.name)
        self.holding = after = Holding(claim.holder, claim.name, peer, now + term, term)
        return [] if before is not None and before.holder == claim.holder else [ClaimChanged(before, after)]

    def _release(self) -> list[ClaimServerEffect]:
        before, self.holding, self._over = self.holding, None, self.fence.epoch
        self.fence.grant(self.fence.epoch, 0, "")
        return [ClaimChanged(before, None)]

    def _tell_both(self, held: Holding, claim: Claim, peer: Peer, now: float) -> list[ClaimServerEffect]:
        latest = self._refused.pop(claim.holder, -BETWEEN_NEWS)
        self._refused[claim.holder] = latest if now - latest < BETWEEN_NEWS else now
        while len(self._refused) > MAX_PEERS:
            del self._refused[next(iter(self._refused))]
        return [] if now - latest < BETWEEN_NEWS else [ClaimRefused(held, peer, claim.name)]


def _held_by(held: Holding) -> str:
    return f"{held.name or 'Another program'} holds this robot; end it, or take over."
