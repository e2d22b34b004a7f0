"""A bond between a parent and a child, from both sides: the lease, and the parent's slots.

*To enslave* a robot is to bind it to a slot: from then on its parent alone commands it, as long as it keeps
renewing the lease.

The child grants the lease, so the truth about who commands a robot lives with the robot, and its clock
decides when a lease ends. A parent that falls silent loses the robot without anyone having to notice. The
epoch grows with each grant and each end, so that a command which was delayed on its way comes with a smaller
one and is refused (fencing).

The parent holds it. It counts from the moment its request left, never from the answer, so it believes
the lease over before the child does. Round trips are estimated as TCP does (RFC 6298, section 2). A slot:

    empty ── begin ──► asking ── bind ──► bound
      ▲                  │ abort            │ free, lose
      └──────────────────┴──────────────────┘

A *group* is an array of slots of one kind, `rovers[0]`, `rovers[1]` …, each of them a slot like any other.
Only those that matter are kept: the first that are needed, those with a child or a lost one, and the lowest
that is empty. A child keeps its index; one that is lost leaves a gap, which can be filled again.

A child knows the next process of a parent that moves by a proof. Before it leaves, the parent makes a secret,
which travels with it, and gives each child only the hash of a proof that follows from the secret and from
the child. The next process shows the proof.

Pure: nothing here sends anything; `now` is any monotonic clock [s], `unix` seconds since 1970, both
given by the caller.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable
from typing import Literal

import msgspec

from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription, SlotSpec
from robotree.vr.base.errors import (
    CycleOfBonds,
    GroupFull,
    LeaseDenied,
    NoSuchSlot,
    NotInControl,
    OldParent,
    Retracted,
    SlotEmpty,
    SlotHeld,
    SlotOccupied,
    StaleEpoch,
)
from robotree.vr.base.newest import keep_newest
from robotree.vr.base.principal import ITSELF, Principal


def proof_of(secret: str, child: str) -> str:
    """Return what the next process shows to a child; empty: there is no secret.

    Args:
        secret: of the move.
        child: key of the child: no child can use its proof at another one.
    """
    return hashlib.sha256(f"{secret}\n{child}".encode()).hexdigest() if secret else ""


def seal_of(proof: str) -> str:
    """Return what the child is given before, by which it knows the proof; empty: there is none."""
    return hashlib.sha256(proof.encode()).hexdigest() if proof else ""


DEFAULT_TERM = 5.0
"""[s] Long enough for a link of 1 s each way, short enough that a tree heals while people watch."""
SHORTEST_TERM = 0.1
"""[s]"""
RETURN = 60.0
"""[s] after its end in which a lease that ended by silence can return, if the parent states no other time."""
LONGEST_WAIT = 3600.0
"""[s] that a child waits for a parent whose process has ended."""
LONGEST_RETURN = 3600.0
"""[s] that a parent may state."""
FRESH = 0
"""Instead of the epoch of a lease that shall return: it was on an earlier incarnation of the robot."""
MOST_RETRACTED = 64
"""Petitions taken back that a child remembers: those that may still be on their way to it."""

_MEMBER = re.compile(r"(\w+)\[(0|[1-9]\d{0,3})]")


class Lease(msgspec.Struct, frozen=True, kw_only=True):
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
    principal: Principal = ITSELF
    """Its holder: nobody else may use it."""
    waits: float = 0.0
    """[s] that the child waits for a parent whose process has ended; 0: it does not."""
    away: bool = False
    """Whether it waits: the parent's process has ended, and nobody has come back yet."""
    stopped: int = 0
    """Number of the last stop that came while the parent was away, which it has not heard; 0: none."""
    life: int = 0
    """How often its holder was started with its journal; 0: it keeps none."""
    heir: str = ""
    """Its parent may go on in another process, which shows what has this hash (`seal_of`); empty: it
    does not."""
    before: int = -1
    """Epoch that the present process of the parent has named first; -1: it is the one that asked for it."""

    def of(self, parent: Address, principal: Principal) -> bool:
        """Whether a parent holds it, or is another incarnation of the one that does.

        A robot of the same name at another site is another robot.
        """
        another = self.parent.identity == parent.identity and self.principal.site == principal.site
        return parent == self.parent or another

    def under(self, epoch: int, principal: Principal) -> bool:
        """Whether somebody who names this epoch means this lease.

        Its holder may name the one before for a while: what it has sent crosses the grant of the new one.
        """
        return epoch == self.epoch or (epoch == self.before and principal == self.principal)


class GrantedLease(msgspec.Struct, kw_only=True):
    """The child's side: grants its own command to one parent at a time."""

    robot: str
    """Name, for messages and for the search for cycles."""
    term: float
    """[s] Longest lease that it grants."""
    epoch: int
    term_granted: float
    """[s] of the present or the last lease."""
    current: Lease | None = None
    silent: Lease | None = None
    """The last lease, if its parent fell silent and nobody has used the robot since: it can return."""
    fresh: bool = True
    """Nobody has been granted this incarnation of the robot, nor moved it."""
    found: int | None = None
    """Epoch that what stands behind the robot obeyed when it was first heard."""
    rival: int = -1
    """The highest epoch that it has obeyed since and that is not ours."""
    retracted: dict[str, None] = {}
    """Keys of petitions that were taken back, the oldest first."""

    @classmethod
    def free(cls, robot: str, *, term: float = DEFAULT_TERM, unix: float) -> GrantedLease:
        """Begin without a lease.

        Args:
            robot: name.
            term: [s] longest lease that it grants.
            unix: [s] since 1970: the first epoch.
        """
        term = max(term, SHORTEST_TERM)
        return cls(robot=robot, term=term, epoch=int(unix), term_granted=term)

    def petition(  # noqa: PLR0913  what a petition says, and the clocks
        self,
        parent: Address,
        slot: str,
        lineage: tuple[str, ...],
        wanted: float,
        *,
        now: float,
        unix: float,
        key: str = "",
        returns: int | None = None,
        patience: float = 0.0,
        principal: Principal = ITSELF,
    ) -> Lease:
        """Grant the lease, anew if the same slot of the same parent asks again.

        Args:
            parent: who asks.
            slot: the parent's slot.
            lineage: the parent's ancestors and the parent.
            wanted: [s] term asked for.
            now: [s] monotonic.
            unix: [s] since 1970.
            key: of the petition, by which it can be retracted.
            returns: epoch of the lease that the parent has lost by silence; `FRESH`: it was a lease on an
                earlier incarnation; None: it asks anew.
            patience: [s] after its end in which that lease shall return; 0: `RETURN`.
            principal: who asks.

        Raises:
            CycleOfBonds: the robot is the parent itself or one of its ancestors.
            LeaseDenied: another slot holds the robot.
            StaleEpoch: that lease cannot return: the robot was released or used since, or too long ago.
            Retracted: the parent took the petition back before it came.
        """
        if key in self.retracted:
            raise Retracted(robot=self.robot, parent=parent.name)
        self._refuse_cycle(parent, lineage)
        held = self._in_force(now)
        # the same incarnation: a petition of an earlier one that comes late must not take the robot from it
        if held is not None and (held.parent, held.slot) != (parent, slot):
            raise LeaseDenied(robot=self.robot, holder=held.parent.name, slot=held.slot)
        within = min(patience or RETURN, LONGEST_RETURN)
        if returns is not None and not self._can_return(parent, slot, returns, now - within):
            raise StaleEpoch(robot=self.robot, epoch=returns, current=self.epoch)
        self.silent, self.fresh = None, False
        self.term_granted = max(SHORTEST_TERM, min(wanted, self.term))
        self.epoch = max(self._next_epoch(unix), self.rival + 1)
        self.current = Lease(
            parent=parent,
            slot=slot,
            epoch=self.epoch,
            expires=now + self.term_granted,
            lineage=lineage,
            petition=key,
            principal=principal,
        )
        return self.current

    def promise(self, waits: float, life: int = 0) -> None:
        """Promise to wait so long [s] for the parent if its process ends, until a later life of it comes."""
        if self.current is not None:
            waits = min(max(waits, 0.0), LONGEST_WAIT)
            self.current = msgspec.structs.replace(self.current, waits=waits, life=life)

    def wait_for(self, parent: Address, now: float) -> bool:
        """Wait for a parent whose process has ended; returns whether the lease has it so."""
        held = self.current
        if held is None or held.parent != parent or not held.waits or held.away:
            return False
        self.current = msgspec.structs.replace(held, away=True, expires=now + held.waits)
        return True

    def note_stop(self, number: int) -> None:
        """Note a stop: a parent that is away hears of it when it comes back."""
        if self.current is not None and self.current.away:
            self.current = msgspec.structs.replace(self.current, stopped=number)

    def _can_return(self, parent: Address, slot: str, epoch: int, earliest: float) -> bool:
        if epoch == FRESH:
            return self.fresh
        last = self.current or self.silent
        same = last is not None and (last.parent, last.slot, last.epoch) == (parent, slot, epoch)
        return last is not None and same and earliest <= last.expires

    def used(self) -> None:
        """Note that somebody without a lease moves the robot: what ended by silence cannot return."""
        self.silent, self.fresh = None, False

    def retract(
        self, parent: Address, key: str, *, unix: float, principal: Principal = ITSELF
    ) -> Lease | None:
        """Undo a petition whose answer its parent never heard, before or after it comes.

        Args:
            parent: who asked.
            key: of the petition. Twice is once.
            unix: [s] since 1970.
            principal: who asks.

        Raises:
            NotInControl: somebody else holds that lease.

        Returns:
            The lease that it had led to, which is over now; None: it led to none that is in force.
        """
        if not key:  # of somebody who gave it none: it cannot be known again
            return None
        keep_newest(self.retracted, key, None, MOST_RETRACTED)
        held = self.current
        if held is None or not held.of(parent, principal) or held.petition != key:
            return None
        self._expect_holder(held, parent, principal)
        return self.end(unix)

    def renew(  # noqa: PLR0913 # what a renewal says
        self,
        parent: Address,
        epoch: int,
        lineage: tuple[str, ...],
        *,
        now: float,
        unix: float = 0.0,
        principal: Principal = ITSELF,
        life: int = 0,
        is_there: bool = True,
        heir: str = "",
        proof: str = "",
    ) -> Lease:
        """Prolong the lease by the term first granted.

        A parent that moves to another process says so before (`heir`), and its next process proves that it is
        the one meant (`proof`), whether the one before is still there or not.

        The parent may be another incarnation than the one that asked for it, which holds the lease then. It
        may also be another process: then the epoch grows, so that the process before, which may only have
        been paused, commands nothing any more. One that is away
        is so until it asks while it is there.

        Raises:
            StaleEpoch: this is not the lease in force.
            NotInControl: somebody else holds it.
            OldParent: the parent comes back with an older state than it has left.
            CycleOfBonds: the robot has become an ancestor of its parent; the lease should `end`.
        """
        held = self._in_force(now)
        if held is None or not held.of(parent, principal):
            raise StaleEpoch(robot=self.robot, epoch=epoch, current=self.epoch)
        inherits = bool(held.heir) and principal != held.principal and seal_of(proof) == held.heir
        if not inherits:
            self.expect_later(parent, principal, life)
            if not held.under(epoch, held.principal if held.away else principal):
                raise StaleEpoch(robot=self.robot, epoch=epoch, current=self.epoch)
        heirs = inherits or self._expect_holder(held, parent, principal)
        self._refuse_cycle(parent, lineage)
        if heirs:
            self.epoch = self._next_epoch(unix)
        away, expires = held.away and not is_there, now + self.term_granted
        self.current = msgspec.structs.replace(
            held,
            life=life,
            parent=parent,
            epoch=self.epoch,
            heir="" if inherits else heir,
            before=epoch if heirs else held.before,  # it may be killed, too, before it has noted the new one
            expires=max(expires, held.expires) if away else expires,  # the wait does not become shorter
            lineage=lineage,
            principal=principal,
            away=away,
        )
        return self.current

    def release(
        self, parent: Address, epoch: int, *, unix: float, principal: Principal = ITSELF
    ) -> Lease | None:
        """End the lease if it is this one; return it, or None when it was over already.

        Raises:
            NotInControl: somebody else holds it.
        """
        held = self.current
        if held is None or not held.of(parent, principal) or not held.under(epoch, principal):
            return None
        if not (held.away and principal.person):
            self._expect_holder(held, parent, principal)
        return self.end(unix)

    def tick(self, now: float, unix: float) -> Lease | None:
        """End the lease if its time is over; return it if so."""
        return (
            self.end(unix, silent=True) if self.current is not None and self.current.expires <= now else None
        )

    def end(self, unix: float, *, silent: bool = False) -> Lease | None:
        """End the lease, whatever it is; return it. The epoch grows.

        Args:
            unix: [s] since 1970.
            silent: its parent is heard no more, so that it can return.
        """
        ended, self.current = self.current, None
        self.silent = ended if silent else None
        if ended is not None:
            # where somebody else commands the robot the clock must not lift us above them
            self.epoch = self.epoch + 1 if self.outranked else self._next_epoch(unix)
        return ended

    @property
    def outranked(self) -> bool:
        """Whether somebody else commands what stands behind the robot, under a later epoch."""
        return self.rival >= self.epoch

    def note_obeyed(self, obeyed: int) -> None:
        """Take note of the epoch that what stands behind the robot obeys, whenever it is looked at.

        What it obeys when it is first heard was granted by an earlier incarnation, whose clock was ahead, and
        whatever is smaller is refused there: ours goes above it, at once or after the lease. What goes above
        ours later was granted to somebody else, who commands it beside us: it stays above until a parent
        asks for this robot. The epoch of a lease in force stays in either case.
        """
        if self.found is None:
            self.found = obeyed
            if self.current is None and self.epoch < obeyed:  # the same epoch is our own, come back
                self.epoch = obeyed + 1
        elif obeyed > max(self.epoch, self.found):
            self.rival = obeyed

    def check(
        self, epoch: int | None, now: float, principal: Principal = ITSELF, *, ends: bool = False
    ) -> None:
        """Refuse a caller who may not command the robot.

        Args:
            epoch: of the caller's lease; None: the caller has none.
            now: [s] monotonic.
            principal: the caller. Who only knows the epoch, which every state publishes, has no lease.
            ends: whether the caller only wants to end something: while the parent is away anybody may.

        Raises:
            NotInControl: a parent commands the robot, and the caller has no lease.
            StaleEpoch: the caller's lease is not the one in force.
        """
        held = self._in_force(now)
        if epoch is None:
            if held is not None and not (ends and held.away):
                raise NotInControl(robot=self.robot, holder=held.parent.name, slot=held.slot)
        elif held is None or not held.under(epoch, principal):
            raise StaleEpoch(robot=self.robot, epoch=epoch, current=self.epoch)
        elif principal not in (held.principal, ITSELF):
            raise NotInControl(robot=self.robot, holder=held.parent.name, slot=held.slot)

    def _expect_holder(self, held: Lease, parent: Address, principal: Principal) -> bool:
        """Refuse somebody else in the name of the parent; returns whether it is the next process of it.

        Another incarnation of it is a holder, too, and so is its next process, when the one before has ended
        or is heard no more.
        """
        if principal in (held.principal, ITSELF) or parent != held.parent:
            return False
        heir = (principal.user, principal.agent) == (held.principal.user, parent.key)
        if not (held.away and heir):
            raise NotInControl(robot=self.robot, holder=held.parent.name, slot=held.slot)
        return True

    def expect_later(self, parent: Address, principal: Principal, life: int) -> None:
        """Refuse the next process of a parent that begins where an earlier one began: it would repeat that.

        Raises:
            OldParent: its journal was put back, or is a copy.
        """
        held = self.current or self.silent
        if held is None or not held.of(parent, principal) or principal == held.principal:
            return
        if 0 < life <= held.life:
            raise OldParent(robot=self.robot, parent=held.parent.name, known=held.life, life=life)

    def _in_force(self, now: float) -> Lease | None:
        return self.current if self.current is not None and now < self.current.expires else None

    def _next_epoch(self, unix: float) -> int:
        """Return an epoch above all before, and above those of earlier incarnations, which began earlier."""
        return max(self.epoch + 1, (self.found or 0) + 1, int(unix))

    def _refuse_cycle(self, parent: Address, lineage: tuple[str, ...]) -> None:
        if self.robot in {*lineage, parent.name}:
            raise CycleOfBonds(parent=parent.name, child=self.robot, lineage=" > ".join(lineage))


def _delays(lease: HeldLease) -> dict[str, float]:
    """Return what is told of the way to a child, in steps: each change is news to all who watch."""
    way = round(lease.round_trip, 1)
    return {"way": way, "bears": math.floor(2 * lease.bears) / 2} if way else {}


class HeldLease(msgspec.Struct, kw_only=True):
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
    def begin(cls, *, epoch: int, term: float, sent: float, now: float) -> HeldLease:
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

    @property
    def bears(self) -> float:
        """[s] for which nothing may arrive, wherever in the term that begins, and the lease still holds.

        The worst moment to begin is when a renewal leaves, which is lost then. The next one that is not lost
        leaves at the latest one pause after the cut has ended, and must be back before the term ends.
        """
        least = self.term / 10
        before = max(least, min(self.term / 3, self.term - 3 * self.patience))
        pause = max(least, min(self.patience, self.term / 3))
        return max(self.term - before - pause - self.round_trip, 0.0)

    def asked(self, now: float) -> None:
        """Note that a request leaves."""
        self.last_asked = max(self.last_asked, now)

    def granted(self, *, sent: float, now: float, term: float) -> None:
        """Note the grant of the request that left at `sent`. Grants may arrive in any order."""
        sample = max(now - sent, 0.0)
        self.deviation += (abs(sample - self.round_trip) - self.deviation) / 4
        self.round_trip += (sample - self.round_trip) / 8
        waited = self.confirmed > now  # a restored parent, for a child whose host might be starting, too
        if sent > self.confirmed or waited:
            self.confirmed, self.term = sent, term


class Bond(msgspec.Struct, kw_only=True):
    """A child in a slot, with the lease on it."""

    child: Address
    lease: HeldLease
    description: RobotDescription
    """As the child last gave it."""
    depth: int = 0
    """Levels of robots below the child, in its latest report."""
    ways: float = 0.0
    """[s] for the way down through these levels and back, in its latest report."""
    stopped: int = 0
    """Number of the last stop of the child that came while the parent's process was away."""
    returns: float = 0.0
    """[s] in which the child comes back after a crash, if its lease holds so long; 0: it does not."""
    why: str = ""
    """Why the parent has chosen this child, as a sentence; empty: a person has put it in."""

    def copied(self) -> Bond:
        """Return a copy, which stays as it is now."""
        return msgspec.structs.replace(self, lease=msgspec.structs.replace(self.lease))


class Slot(msgspec.Struct):
    """One slot. Its state follows from what is in it."""

    spec: SlotSpec
    asked: Address | None = None
    """The child that is being asked."""
    bond: Bond | None = None
    lost: str = ""
    """Why the last child was lost; empty: it was not."""
    was: str = ""
    """Name of the child that was lost."""
    released: str = ""
    """Name of the child that was released last; empty: none since the last one came."""
    watched: Address | None = None
    """The robot that is watched in it, in its latest life."""

    @property
    def state(self) -> Literal["empty", "asking", "bound"]:
        """Where it is in its life."""
        if self.bond is not None:
            return "bound"
        return "empty" if self.asked is None else "asking"

    @property
    def child(self) -> Address | None:
        """The child that is in it, or is being asked."""
        return self.asked if self.bond is None else self.bond.child


class Slots(msgspec.Struct):
    """All slots of one virtual robot, by name."""

    robot: str
    """Name of the virtual robot, for messages."""
    by_name: dict[str, Slot] = {}
    """Replaced as a whole when a group grows or shrinks: other threads read it."""
    groups: dict[str, SlotSpec] = {}

    @classmethod
    def empty(cls, robot: str, specs: Iterable[SlotSpec]) -> Slots:
        """Begin with nobody in them.

        Args:
            robot: name of the virtual robot.
            specs: the slots and groups that its class declares.
        """
        specs = tuple(specs)
        slots = cls(robot, groups={spec.name: spec for spec in specs if spec.group})
        for spec in specs:
            if spec.group:
                slots._tidy(spec.group)
            else:
                slots.by_name[spec.name] = Slot(spec)
        return slots

    def __getitem__(self, name: str) -> Slot:
        """Return a slot.

        Raises:
            NoSuchSlot: there is none of this name.
        """
        slot = self.by_name.get(name)
        if slot is not None:
            return slot
        group, index = _member(name)
        spec = self.groups.get(group)
        if spec is None or not index < spec.most:
            known = ", ".join(self._declared()) or "none"
            raise NoSuchSlot(robot=self.robot, slot=name, known=known) from None
        return _new_member(spec, index)

    def _declared(self) -> list[str]:
        """Return the names of slots and groups, a group as `rovers[0…3]`."""
        alone = [name for name, slot in self.by_name.items() if not slot.spec.group]
        return [*alone, *(f"{name}[0…{spec.most - 1}]" for name, spec in self.groups.items())]

    def place(self, name: str, child: str) -> str:
        """Return the slot into which a child goes; only for a group there is a choice.

        Args:
            name: of a slot, or of a group: there it goes where it was lost, else into the lowest empty slot.
            child: its name.

        Raises:
            GroupFull: the group has no slot left.
        """
        if name not in self.groups:
            return name
        empty = {index: slot for index, slot in self.members(name).items() if slot.child is None}
        if not empty:
            raise GroupFull(robot=self.robot, slot=name, most=self.groups[name].most)
        index = min(empty, key=lambda index: (empty[index].was != child, index))
        return f"{name}[{index}]"

    def filled(self, name: str) -> list[str]:
        """Return the slots with children that a name means: itself, or those of the group.

        Raises:
            SlotEmpty: the group has none.
        """
        if name not in self.groups:
            return [name]
        found = [slot.spec.name for slot in self.members(name).values() if slot.bond is not None]
        if not found:
            kind, reason = self.groups[name].kind, "no child was bound to it"
            raise SlotEmpty(robot=self.robot, slot=name, reason=reason, kind=kind)
        return found

    def members(self, group: str) -> dict[int, Slot]:
        """Return the slots of a group that matter, by index."""
        found = {
            _member(name)[1]: slot for name, slot in list(self.by_name.items()) if slot.spec.group == group
        }
        return dict(sorted(found.items()))

    def _tidy(self, group: str) -> None:
        """Keep those slots of a group that matter, in order."""
        if not group:
            return
        spec = self.groups[group]
        found = {index: slot for index, slot in self.members(group).items() if slot.child or slot.lost}
        lowest = next((index for index in range(spec.most) if index not in found), None)
        for index in {*range(spec.least), *([] if lowest is None else [lowest])} - found.keys():
            found[index] = _new_member(spec, index)
        kept: dict[str, Slot] = {}
        for name, slot in [*self.by_name.items(), (group, Slot(spec))]:
            if slot.spec.group == group:
                kept |= {found[index].spec.name: found[index] for index in sorted(found)}
            else:
                kept[name] = slot
        self.by_name = kept

    def revise(self, specs: Iterable[SlotSpec]) -> None:
        """Have the slots that another page declares; children stay in those of their name.

        Args:
            specs: the slots and groups that the other page declares.

        Raises:
            SlotHeld: a slot with a child is not among them, or takes another kind; nothing has changed.
        """
        fresh = Slots.empty(self.robot, specs)
        stay: dict[str, Slot] = {}
        for name, slot in self.by_name.items():
            if slot.child is None and slot.watched is None and not slot.lost:
                continue
            same = name in fresh.by_name or _member(name)[0] in fresh.groups
            try:
                spec = fresh[name].spec
                same = same and (spec.kind, spec.watch) == (slot.spec.kind, slot.spec.watch)
            except NoSuchSlot:  # the group is shorter now
                same = False
            if same:
                stay[name] = slot
            elif (held := slot.child or slot.watched) is not None:
                raise SlotHeld(robot=self.robot, slot=name, child=held.name, kind=slot.spec.kind)
        for name, slot in stay.items():
            slot.spec = fresh[name].spec
        declared = {name: stay.get(name, slot) for name, slot in fresh.by_name.items()}
        self.by_name, self.groups = {**declared, **stay}, fresh.groups
        for group in self.groups:
            self._tidy(group)

    def specs(self) -> tuple[SlotSpec, ...]:
        """Describe the slots and what is in them."""
        return tuple(
            msgspec.structs.replace(
                slot.spec,
                child=None if slot.bond is None else slot.bond.child,
                **({} if slot.bond is None else _delays(slot.bond.lease)),
                lost=slot.lost,
                was=slot.was,
                why="" if slot.bond is None else slot.bond.why,
                watched=slot.watched,
            )
            for slot in self.by_name.values()
        )

    def bonds(self) -> dict[str, Bond]:
        """Return the bonds in force, by slot."""
        return {name: slot.bond for name, slot in self.by_name.items() if slot.bond is not None}

    @property
    def due(self) -> float:
        """[s] when the next lease of a child is to be renewed, or over."""
        due = math.inf
        for slot in self.by_name.values():
            if slot.bond is not None:
                due = min(due, slot.bond.lease.due, slot.bond.lease.expires)
        return due

    @property
    def depth(self) -> int:
        """Levels of robots below: 1 with children that have none."""
        return max((1 + bond.depth for bond in self.bonds().values()), default=0)

    @property
    def ways(self) -> float:
        """[s] that the ways down to the last of those below and back take together."""
        return max((bond.lease.round_trip + bond.ways for bond in self.bonds().values()), default=0.0)

    def children(self) -> list[Address]:
        """Return who is bound or is being asked."""
        return [slot.child for slot in self.by_name.values() if slot.child is not None]

    def require(self, name: str) -> Bond:
        """Return the bond in a slot.

        Raises:
            NoSuchSlot: there is no such slot.
            SlotEmpty: nobody is in it, and why.
        """
        slot = self.by_name.get(name)
        if slot is None or slot.bond is None:
            raise self.emptiness(name)
        return slot.bond

    def copied(self) -> dict[str, Bond]:
        """Return copies of the bonds in force, by slot: they stay as they are now."""
        return {name: bond.copied() for name, bond in self.bonds().items()}

    def emptiness(self, name: str) -> SlotEmpty:
        """Return the error for an empty slot, with the reason.

        Raises:
            NoSuchSlot: there is no such slot.
        """
        slot = self[name]
        nobody = "no robot is watched in it" if slot.spec.watch else "no child was bound to it"
        before = f"{slot.released} was released" if slot.released else nobody
        reason = slot.lost or ("its child is just being asked" if slot.asked else before)
        return SlotEmpty(robot=self.robot, slot=name, reason=reason, kind=slot.spec.kind)

    def begin(self, name: str, child: Address) -> Slot:
        """Reserve an empty slot while the child is being asked.

        Raises:
            NoSuchSlot: there is no such slot.
            SlotOccupied: somebody is in it or is being asked.
        """
        slot = self[name]
        if slot.child is not None:
            raise SlotOccupied(robot=self.robot, slot=name, child=slot.child.name)
        slot.asked = child
        if name not in self.by_name:
            self.by_name = {**self.by_name, name: slot}
        self._tidy(slot.spec.group)
        return slot

    def bind(self, name: str, bond: Bond) -> None:
        """Fill the slot with the child that was asked."""
        slot = self[name]
        if slot.asked != bond.child:
            msg = f"{bond.child} was not asked to come into {self.robot}.{name}"
            raise ValueError(msg)
        slot.asked, slot.bond, slot.lost, slot.was, slot.released = None, bond, "", "", ""

    def abort(self, name: str) -> None:
        """Take the question back: the child refused or did not answer."""
        slot = self[name]
        slot.asked = None
        self._tidy(slot.spec.group)

    # -- watching, which takes no lease

    def watch(self, name: str, robot: Address) -> Address | None:
        """Watch a robot in a slot that is made for it, or the next life of the one that is watched.

        Returns:
            The life that was watched before; None: nobody was.

        Raises:
            NoSuchSlot: there is no such slot.
            SlotOccupied: another robot is watched in it.
            ValueError: the slot takes children.
        """
        slot = self[name]
        before = slot.watched
        if not slot.spec.watch:
            msg = f"{self.robot}.{name} takes a child, and {robot.name} was to be watched only"
            raise ValueError(msg)
        if before is not None and before.identity != robot.identity:
            raise SlotOccupied(robot=self.robot, slot=name, child=before.name)
        slot.watched, slot.released = robot, ""
        return before

    def unwatch(self, name: str) -> Address:
        """Watch nobody in a slot any more; returns who was.

        Raises:
            NoSuchSlot: there is no such slot.
            SlotEmpty: nobody was.
        """
        slot = self[name]
        if slot.watched is None:
            raise self.emptiness(name)
        before, slot.watched = slot.watched, None
        slot.released = before.name
        return before

    def watched(self) -> dict[str, Address]:
        """Return who is watched, by slot."""
        return {name: slot.watched for name, slot in self.by_name.items() if slot.watched is not None}

    def held(self, name: str, child: Address, epoch: int) -> Bond | None:
        """Return the bond in a slot if it is the one with this child, in any incarnation, and epoch.

        News of a child may come when another page no longer declares its slot: then there is none.
        """
        slot = self.by_name.get(name)
        bond = None if slot is None else slot.bond
        if bond is None or (bond.child.identity, bond.lease.epoch) != (child.identity, epoch):
            return None
        return bond

    def lose(self, name: str, child: Address, epoch: int, reason: str) -> bool:
        """Empty the slot because the child is lost.

        Args:
            name: the slot.
            child: the incarnation that is lost.
            epoch: of the bond that is lost; if the slot holds another one by now, nothing happens.
            reason: why, for everybody who uses the slot from now on.

        Returns:
            Whether the slot has been emptied.
        """
        bond = self.held(name, child, epoch)
        if bond is None or bond.child != child:
            return False
        slot = self[name]
        slot.bond, slot.lost, slot.was = None, reason, child.name
        self._tidy(slot.spec.group)
        return True

    def free(self, name: str) -> Bond:
        """Empty the slot on request and return what was in it.

        Raises:
            NoSuchSlot: there is no such slot.
            SlotEmpty: nothing was in it.
        """
        bond, slot = self.require(name), self[name]
        slot.bond, slot.lost, slot.released = None, "", bond.child.name
        self._tidy(slot.spec.group)
        return bond


def _new_member(group: SlotSpec, index: int) -> Slot:
    optional = index >= group.least
    return Slot(msgspec.structs.replace(group, name=f"{group.name}[{index}]", optional=optional))


def _member(name: str) -> tuple[str, int]:
    """Return group and index of `rovers[2]`; an empty group for another name."""
    found = _MEMBER.fullmatch(name)
    return (found[1], int(found[2])) if found else ("", 0)
