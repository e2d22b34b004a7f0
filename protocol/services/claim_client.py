"""Claims, the holder's side: ask for the command of a controller, keep it, and notice its loss. Pure.

The controller's life comes from its MODE. In each life, and on each link, the claim is requested anew. It is
repeated until it is answered, then every `PERIOD`, and five times within the silence that the controller
allows while something moves for us: three in a row may be lost.

An epoch that the controller refuses as over is replaced by the one above the controller's, unless somebody
else holds the claim: then the request is repeated, and granted when the other holder is gone. If the holder
is away (its link has ended, or the controller has restarted), nothing is denied yet: we wait for a short
time. A take-over is requested only if a person asked for it, and only until it was granted once.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.messages import Claim, ClaimStatus, ClaimWish, Reason
from robotree.protocol.services.heartbeat import BEATS, PERIOD, SILENCE
from robotree.protocol.services.peer import Send

if TYPE_CHECKING:
    from collections.abc import Hashable

RESEND = 0.25
"""[s] between two repetitions of what was not answered."""
TERM = SILENCE
"""[s] of silence after which we want the claim to end: three heartbeats."""
LONGEST_TERM = 60.0
"""[s] The term is as long as the silence that the controller bears, but not longer; the wire has 65 s."""
NAME_BYTES = 24
_LARGEST = 2**32 - 1
"""The largest epoch that the wire has room for."""


class ClaimGranted(msgspec.Struct, frozen=True):
    """The controller obeys us and nobody else."""

    taken_from: str = ""
    """Name of the former holder; empty: there was none."""


class ClaimDenied(msgspec.Struct, frozen=True):
    """The controller does not obey us: another holder is heard from, or the epoch is none."""

    reason: Reason
    """NOT_IN_CONTROL: another one holds it; BAD_EPOCH: there is no epoch above its own."""
    name: str
    """Of the holder; empty: nobody."""
    epoch: int
    """The highest that the controller has obeyed."""


ClaimClientEffect = Send | ClaimGranted | ClaimDenied


class ClaimClient:
    """Our claim on one controller.

    Args:
        system: the controller's.
        component: the controller's.
        holder: a random number that names this life of ours, 1 to 2^64 - 1.
        name: of ours, for people.
        take_over: take the claim from its holder, once.
        via: the link to it.
    """

    def __init__(
        self,
        system: int,
        component: int,
        *,
        holder: int,
        name: str = "",
        take_over: bool = False,
        via: Hashable = None,
    ) -> None:
        self._system, self._component, self._via = system, component, via
        self.holder, self._name = holder, name.encode()[:NAME_BYTES].decode(errors="ignore")
        self._take_over = take_over
        self._other = ""
        """The holder of the claim that we shall take over."""
        self.life = 0
        """Of the controller; 0: not told yet, or it understands no claims."""
        self.epoch = 0
        """The one that we claim."""
        self._lease = 0
        """The highest epoch of a lease under which the controller was commanded from here."""
        self._too_high = _LARGEST + 1
        """An epoch that the controller has found dishonest."""
        self.granted = False
        """Whether the controller has told that it obeys us."""
        self.denied: ClaimDenied | None = None
        """Why it does not; None: it does, or has not answered."""
        self._asked = float("-inf")
        self._given_up = False

    @property
    def settled(self) -> bool:
        """Whether the controller has answered, or understands no claims."""
        return not self.life or self.granted or self.denied is not None

    def opened(self) -> None:
        """There is a new link, over which nothing was answered."""
        self.granted, self.denied, self._asked, self._given_up = False, None, float("-inf"), False

    def meet(self, life: int, epoch: int) -> None:
        """The controller has told its life, and the highest epoch that it has obeyed, in its MODE."""
        if life != self.life:
            self.life, self.granted, self.denied, self._asked = life, False, None, float("-inf")
        if not self.epoch:
            self.epoch = _above(epoch)

    def raise_to(self, lease: int) -> None:
        """Command under a lease from now on. Each new one has a larger epoch on the wire than the one before.

        It is the lease's own where the controller obeys that; else the epoch that we claim counts on.

        Args:
            lease: its epoch.
        """
        if lease > self._lease:
            self._lease = lease
            self.epoch = lease if self.epoch < lease < self._too_high else _above(self.epoch)

    def receive(self, status: ClaimStatus, *, for_us: bool) -> list[ClaimClientEffect]:
        """Take the controller's report of its claim.

        Args:
            status: the report.
            for_us: whether it is addressed to our system and component.
        """
        if not self.life or status.life != self.life:
            return []
        if status.holder == self.holder:
            return self._have(status)
        if status.holder and self._take_over:
            self._other = status.name or "another program"
            if for_us and status.reason in {Reason.STALE_EPOCH, Reason.BAD_EPOCH}:
                self.epoch = _above(status.epoch)
            return []
        if status.holder and status.holder_system:
            return self._deny(status, Reason.NOT_IN_CONTROL)
        if for_us and status.reason == Reason.BAD_EPOCH and self.epoch == _above(status.epoch):
            return self._deny(status, Reason.BAD_EPOCH)
        if not status.holder:
            self._find_it_free(status, for_us=for_us)
        else:  # the holder is away
            self.granted, self.denied = False, None
        return []

    def due(self, silence: float, *, moving: bool) -> float:
        """Return when to call `tick` next [s]; its arguments are the same."""
        if not self.life or self._given_up:
            return inf
        return self._asked + self._period(silence, moving=moving)

    def tick(self, now: float, silence: float, *, moving: bool, beats: bool = False) -> list[Send]:
        """Say the claim, if it is due.

        Args:
            now: [s]
            silence: that the controller bears while something moves, [s].
            moving: whether something moves for us.
            beats: whether a heartbeat goes out: a claim that is granted goes with it, even before it is due,
                so that both sides wake up once for the two.
        """
        due = self.due(silence, moving=moving)
        if now < due and not (beats and self.granted and due < inf):
            return []
        period = self._period(silence, moving=moving)
        late = now - self._asked - period
        self._asked = now - (late if 0 < late < period / 2 else 0.0)
        term = min(max(TERM, silence), LONGEST_TERM)
        return [self._say(ClaimWish.TAKE_OVER if self._take_over else ClaimWish.KEEP, term)]

    def release(self) -> list[Send]:
        """Give the claim up, if we have it; on this link it is not asked for any more."""
        self._given_up = True
        if not self.granted:
            return []
        self.granted = False
        return [self._say(ClaimWish.RELEASE, TERM)]

    def _period(self, silence: float, *, moving: bool) -> float:
        if not self.granted:
            return PERIOD if self.denied else RESEND
        return min(PERIOD, silence / BEATS) if moving else PERIOD

    def _have(self, status: ClaimStatus) -> list[ClaimClientEffect]:
        if status.reason == Reason.BAD_EPOCH:  # of the lease that began last
            self.epoch, self._too_high = _above(status.epoch), self.epoch
        self.epoch, news = max(self.epoch, status.epoch), not self.granted
        self.granted, self.denied, self._take_over = True, None, False
        taken_from, self._other = self._other, ""
        return [ClaimGranted(taken_from)] if news else []

    def _find_it_free(self, status: ClaimStatus, *, for_us: bool) -> None:
        """Nobody holds the claim: ask at once where that is news."""
        if for_us and status.reason == Reason.STALE_EPOCH:
            self.epoch = max(self.epoch, _above(status.epoch))
        elif for_us and status.reason == Reason.BAD_EPOCH:
            self.epoch, self._too_high = _above(status.epoch), self.epoch
        elif not self.granted and (self.denied is None or self.denied.reason == Reason.BAD_EPOCH):
            return
        self.granted, self.denied, self._asked = False, None, float("-inf")

    def _deny(self, status: ClaimStatus, reason: Reason) -> list[ClaimClientEffect]:
        denied = ClaimDenied(reason, status.name, status.epoch)
        news = self.denied is None or self.granted or self.denied.name != denied.name
        self.granted, self.denied = False, denied
        return [denied] if news else []

    def _say(self, wish: ClaimWish, term: float) -> Send:
        ms = round(1000 * term)
        target = (self._system, self._component)
        return Send(Claim(self.holder, self.epoch, ms, self.life, *target, wish, self._name), self._via)


def _above(epoch: int) -> int:
    return min(epoch + 1, _LARGEST)
