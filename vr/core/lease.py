"""Leases: who may command a robot, and until when.

The child is the lessor, so the truth about who commands a robot lives with the robot, and its clock decides
when a lease ends. A parent that falls silent loses the robot without anyone having to notice. The epoch
grows with each grant and each end, so that a command which was delayed on its way comes with a smaller one
and is refused (fencing).

The parent is the lessee. It counts from the moment its request left, never from the answer, so it believes
the lease over before the child does. Round trips are estimated as TCP does (RFC 6298, section 2).

Pure: `now` is any monotonic clock [s], `unix` seconds since 1970, both given by the caller.
"""

from __future__ import annotations

import msgspec

from robotree.vr.address import Address
from robotree.vr.errors import CycleOfBonds, LeaseDenied, NotInControl, Retracted, StaleEpoch

DEFAULT_TERM = 5.0
"""[s] Long enough for a link of 1 s each way, short enough that a tree heals while people watch."""
SHORTEST_TERM = 0.1
"""[s]"""
MOST_RETRACTED = 64
"""Petitions taken back that a child remembers: those that may still be on their way to it."""


class Tenure(msgspec.Struct, frozen=True, kw_only=True):
    """The lease that a child has granted."""

    parent: Address
    slot: str
    epoch: int
    expires: float
    """[s] on the child's clock."""
    lineage: tuple[str, ...]
    """Names from the topmost ancestor down to the parent."""
    petition: str = ""
    """Key of the petition by which it was granted."""


class Lessor(msgspec.Struct, kw_only=True):
    """The child's side: grants its own command to one parent at a time."""

    robot: str
    """Name, for messages and for the search for cycles."""
    term: float
    """[s] Longest lease that it grants."""
    epoch: int
    term_granted: float
    """[s] of the present or the last lease."""
    tenure: Tenure | None = None
    found: int | None = None
    """Epoch that what stands behind the robot obeyed when it was first heard."""
    rival: int = -1
    """The highest epoch that it has obeyed since and that is not ours."""
    retracted: dict[str, None] = {}
    """Keys of petitions that were taken back, the oldest first."""

    @classmethod
    def free(cls, robot: str, *, term: float = DEFAULT_TERM, unix: float) -> Lessor:
        """Begin without a lease.

        Args:
            robot: name.
            term: [s] longest lease that it grants.
            unix: [s] since 1970: the first epoch.
        """
        term = max(term, SHORTEST_TERM)
        return cls(robot=robot, term=term, epoch=int(unix), term_granted=term)

    def petition(
        self,
        parent: Address,
        slot: str,
        lineage: tuple[str, ...],
        wanted: float,
        *,
        now: float,
        unix: float,
        key: str = "",
    ) -> Tenure:
        """Grant the lease, anew if the same slot of the same parent asks again.

        Args:
            parent: who asks.
            slot: the parent's slot.
            lineage: the parent's ancestors and the parent.
            wanted: [s] term asked for.
            now: [s] monotonic.
            unix: [s] since 1970.
            key: of the petition, by which it can be retracted.

        Raises:
            CycleOfBonds: the robot is the parent itself or one of its ancestors.
            LeaseDenied: another slot holds the robot.
            Retracted: the parent took the petition back before it came.
        """
        if key in self.retracted:
            raise Retracted(robot=self.robot, parent=parent.name)
        self._refuse_cycle(parent, lineage)
        held = self._in_force(now)
        # the same incarnation: a petition of an earlier one that comes late must not take the robot from it
        if held is not None and (held.parent, held.slot) != (parent, slot):
            raise LeaseDenied(robot=self.robot, holder=held.parent.name, slot=held.slot)
        self.term_granted = max(SHORTEST_TERM, min(wanted, self.term))
        self.epoch = max(self._next_epoch(unix), self.rival + 1)
        self.tenure = Tenure(
            parent=parent,
            slot=slot,
            epoch=self.epoch,
            expires=now + self.term_granted,
            lineage=lineage,
            petition=key,
        )
        return self.tenure

    def retract(self, parent: Address, key: str, *, unix: float) -> Tenure | None:
        """Undo a petition whose answer its parent never heard, before or after it comes.

        Args:
            parent: who asked.
            key: of the petition. Twice is once.
            unix: [s] since 1970.

        Returns:
            The lease that it had led to, which is over now; None: it led to none that is in force.
        """
        if not key:  # of somebody who gave it none: it cannot be known again
            return None
        self.retracted[key] = None
        while len(self.retracted) > MOST_RETRACTED:
            del self.retracted[next(iter(self.retracted))]
        held = self.tenure
        if held is None or (held.parent.identity, held.petition) != (parent.identity, key):
            return None
        return self.end(unix)

    def renew(self, parent: Address, epoch: int, lineage: tuple[str, ...], *, now: float) -> Tenure:
        """Prolong the lease by the term first granted.

        The parent may be another incarnation than the one that asked for it: who knows the epoch goes on.

        Raises:
            StaleEpoch: this is not the lease in force.
            CycleOfBonds: the robot has become an ancestor of its parent; the lease should `end`.
        """
        held = self._in_force(now)
        if held is None or (held.parent.identity, held.epoch) != (parent.identity, epoch):
            raise StaleEpoch(robot=self.robot, epoch=epoch, current=self.epoch)
        self._refuse_cycle(parent, lineage)
        self.tenure = msgspec.structs.replace(
            held, parent=parent, expires=now + self.term_granted, lineage=lineage
        )
        return self.tenure

    def release(self, parent: Address, epoch: int, *, unix: float) -> Tenure | None:
        """End the lease if it is this one; return it, or None when it was over already."""
        held = self.tenure
        if held is None or (held.parent.identity, held.epoch) != (parent.identity, epoch):
            return None
        return self.end(unix)

    def tick(self, now: float, unix: float) -> Tenure | None:
        """End the lease if its time is over; return it if so."""
        return self.end(unix) if self.tenure is not None and self.tenure.expires <= now else None

    def end(self, unix: float) -> Tenure | None:
        """End the lease, whatever it is; return it. The epoch grows."""
        ended, self.tenure = self.tenure, None
        if ended is not None:
            # where somebody else commands the robot the clock must not lift us above them
            self.epoch = self.epoch + 1 if self.outranked else self._next_epoch(unix)
        return ended

    @property
    def outranked(self) -> bool:
        """Whether somebody else commands what stands behind the robot, under a later epoch."""
        return self.rival >= self.epoch

    def hear(self, obeyed: int) -> None:
        """Take note of the epoch that what stands behind the robot obeys, whenever it is looked at.

        What it obeys when it is first heard was granted by an earlier incarnation, whose clock was ahead, and
        whatever is smaller is refused there: ours goes above it, at once or after the lease. What goes above
        ours later was granted to somebody else, who commands it beside us: it stays above until a parent
        asks for this robot. The epoch of a lease in force stays in either case.
        """
        if self.found is None:
            self.found = obeyed
            if self.tenure is None and self.epoch < obeyed:  # the same epoch is our own, come back
                self.epoch = obeyed + 1
        elif obeyed > max(self.epoch, self.found):
            self.rival = obeyed

    def check(self, epoch: int | None, now: float) -> None:
        """Refuse a caller who may not command the robot.

        Args:
            epoch: of the caller's lease; None: the caller has none.
            now: [s] monotonic.

        Raises:
            NotInControl: a parent commands the robot, and the caller has no lease.
            StaleEpoch: the caller's lease is not the one in force.
        """
        held = self._in_force(now)
        if epoch is None:
            if held is not None:
                raise NotInControl(robot=self.robot, holder=held.parent.name, slot=held.slot)
        elif held is None or epoch != held.epoch:
            raise StaleEpoch(robot=self.robot, epoch=epoch, current=self.epoch)

    def _in_force(self, now: float) -> Tenure | None:
        return self.tenure if self.tenure is not None and now < self.tenure.expires else None

    def _next_epoch(self, unix: float) -> int:
        """Return an epoch above all before, and above those of earlier incarnations, which began earlier."""
        return max(self.epoch + 1, (self.found or 0) + 1, int(unix))

    def _refuse_cycle(self, parent: Address, lineage: tuple[str, ...]) -> None:
        if self.robot in {*lineage, parent.name}:
            raise CycleOfBonds(parent=parent.name, child=self.robot, lineage=" > ".join(lineage))


class Lessee(msgspec.Struct, kw_only=True):
    """The parent's side: when to ask again, and when to believe the lease lost."""

    epoch: int
    term: float
    """[s] as granted."""
    confirmed: float
    """[s] When the last request left that was granted."""
    last_asked: float
    """[s] When the last request left."""
    round_trip: float
    """[s] that a request and its answer take, on average."""
    deviation: float
    """[s] Mean deviation from that."""

    @classmethod
    def begin(cls, *, epoch: int, term: float, sent: float, now: float) -> Lessee:
        """Begin with a grant.

        Args:
            epoch: as granted.
            term: [s] as granted.
            sent: [s] when the request left.
            now: [s] when the grant arrived.
        """
        way = max(now - sent, 0.0)
        return cls(epoch=epoch, term=term, confirmed=sent, last_asked=sent, round_trip=way, deviation=way / 2)

    @property
    def expires(self) -> float:
        """[s] when the lease is over unless a later request is granted; never after the child's moment."""
        return self.confirmed + self.term

    @property
    def patience(self) -> float:
        """[s] after which an answer that has not come is late."""
        return self.round_trip + 4 * self.deviation

    @property
    def due(self) -> float:
        """[s] when the next request should leave.

        A third of the term after the last granted one left, sooner when the way is slow; while an answer is
        out, whenever it is late: requests may overlap.
        """
        least = self.term / 10
        if self.last_asked > self.confirmed:
            return self.last_asked + max(least, min(self.patience, self.term / 3))
        return self.confirmed + max(least, min(self.term / 3, self.term - 3 * self.patience))

    def asked(self, now: float) -> None:
        """Note that a request leaves."""
        self.last_asked = max(self.last_asked, now)

    def granted(self, *, sent: float, now: float, term: float) -> None:
        """Note the grant of the request that left at `sent`. Grants may arrive in any order."""
        sample = max(now - sent, 0.0)
        self.deviation += (abs(sample - self.round_trip) - self.deviation) / 4
        self.round_trip += (sample - self.round_trip) / 8
        if sent > self.confirmed:
            self.confirmed, self.term = sent, term
