"""The epoch fence of a controller: which epochs it obeys. Pure.

An epoch numbers leases. An epoch below the highest obeyed one is over (fencing tokens: Kleppmann 2016).
Epochs come from clocks (seconds since 1970), or count on from the highest reported one. So an honest epoch is
at most a number of leases ahead of the highest obeyed one, or not after the present time. An epoch that is
further ahead comes from a fault or a forger. To obey it would refuse everybody else for ever, so it is
refused.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.protocol.messages import Reason

if TYPE_CHECKING:
    from collections.abc import Callable

Refusal = tuple[Reason, str]
"""Why something is not obeyed: the reason, and one sentence."""

LAST_EPOCH = 2**32 - 2**20
"""The last possible epoch; no clock reaches it before 2106."""
LEASES = 2**10
"""How far ahead counting may lead in one step: more leases than a robot grants between two claims.

A forger who climbs in such steps needs more than two million frames to reach the last epoch.
"""
CLOCK_FROM = 1_767_225_600
"""[s since 1970] 2026-01-01: a controller's clock before that was never set."""
CLOCK_SKEW = 86_400
"""[s] by which the clock that makes epochs may be ahead of the controller's."""
CLOCK_UNTIL = 4_102_444_800
"""[s since 1970] 2100-01-01: what a controller without a clock takes for the latest honest time.

Below `LAST_EPOCH` by 191 million leases, so that one forged epoch leaves room above itself.
"""


class Fence:
    """The highest epoch obeyed, and who was granted it.

    Args:
        epoch: obeyed in an earlier life.
        holder: of that epoch; 0: unknown.
        name: of the holder, for people.
        clock: returns the time [s since 1970]; 0: unknown.
        keep: called at each change, so that it survives a restart.
    """

    def __init__(
        self,
        epoch: int = 0,
        holder: int = 0,
        name: str = "",
        *,
        clock: Callable[[], float] = lambda: 0.0,
        keep: Callable[[Fence], None] = lambda _: None,
    ) -> None:
        self.epoch, self.holder, self.name = epoch, holder, name
        self._clock, self._keep = clock, keep

    @property
    def limit(self) -> int:
        """The highest epoch that would be obeyed now."""
        clock = self._clock()
        latest = int(clock) + CLOCK_SKEW if clock >= CLOCK_FROM else CLOCK_UNTIL
        return min(max(self.epoch + LEASES, latest), LAST_EPOCH)

    def objection(self, epoch: int) -> Refusal | None:
        """Why an epoch is not obeyed; None: it would be. Nothing changes."""
        if epoch < self.epoch:
            return Reason.STALE_EPOCH, f"Epoch {epoch} is over; {self.epoch} was already obeyed."
        if epoch > max(self.limit, self.epoch):
            return Reason.BAD_EPOCH, f"Epoch {epoch} is above {self.limit}, the latest that is honest."
        return None

    def admit(self, epoch: int) -> Refusal | None:
        """Obey an epoch from now on, or say why not."""
        if (why := self.objection(epoch)) is None and epoch != self.epoch:
            self.epoch = epoch
            self._keep(self)
        return why

    def grant(self, epoch: int, holder: int, name: str) -> None:
        """An epoch that was found free of objections is granted to a holder; 0: to nobody any more."""
        if (epoch, holder, name) != (self.epoch, self.holder, self.name):
            self.epoch, self.holder, self.name = epoch, holder, name
            self._keep(self)
