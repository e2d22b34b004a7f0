"""Stops and pauses of one robot: whether its commands may go on. Pure.

A protective stop is a wanted state with generations. Each stop that begins, ordered from outside or
reported by the robot itself (a controller in a stop of its own), is one more generation. A release names
the generation that it ends and is refused when a later one has begun (docs/decisions/0013). What stands
behind the robot and all its children, its *parts*, answer each ordered stop: they confirm it, or an error
says who has not. The robot stays stopped until a release of the newest generation is confirmed by all of
them.

In a pause commands wait before each step, but for steps that may pass nevertheless. It is ordered by who
may command the robot, or it holds because the robot's parent is paused. A parent says so with each renewal
of its lease, together with how often its own pause has changed: an order that was lost is made up for by
the next renewal, and a renewal that comes late changes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from robotree.vr.base.errors import NotConfirmed
from robotree.vr.base.newest import keep_newest
from robotree.vr.base.requests import Done, Raised
from robotree.vr.core.confirmation import Confirmations

HARDWARE = ""
"""The part that stands behind the robot; the others are its children, by slot."""

MOST_ORDERS = 64
"""Orders of stops in force that are remembered; a copy of an older one counts as a new stop."""


class StopPart(msgspec.Struct):
    """One that has to confirm a stop."""

    name: str
    """Of the robot, for people."""
    answer: Done | Raised | None = None
    """None: it has not answered."""


class Stop(msgspec.Struct, kw_only=True):
    """Whether a robot is stopped, why, and how often it was."""

    reason: str = ""
    """Of the ordered stop that is in force; empty: none is."""
    halted: str = ""
    """The reason if the robot itself reports a stop; empty: it reports none."""
    generation: int = 0
    """How many stops have begun."""
    moment: float = 0.0
    """[s] When the newest of them began."""
    confirmed: int = 0
    """The newest generation that everything below has confirmed."""
    latest: str = ""
    """Reason of the newest stop, also after its release."""
    orders: dict[str, int] = {}
    """Generation of each order that is in force."""
    parts: dict[int, dict[str, StopPart]] = {}
    """The robots that have to confirm a stop, by generation, for stops in force and unanswered ones."""

    @property
    def in_force(self) -> str:
        """Why nothing that moves may begin; empty: it may."""
        return self.reason or self.halted

    def known(self, order: str) -> int:
        """Return the generation of an order that is obeyed already; 0: it is new."""
        return self.orders.get(order, 0) if self.reason else 0

    def known_to(self, asker: float, now: float) -> bool:
        """Whether somebody who gave an order at the moment `asker` [s] can know of the newest stop.

        A moment in the future was kept by an earlier life, on another clock: it counts as long ago.
        """
        return not asker < self.moment <= now

    def begin(self, reason: str, order: str, parts: Mapping[str, str], now: float) -> int:
        """Stop once more; returns the generation.

        Args:
            reason: for people.
            order: that it is part of; empty: of none.
            parts: who has to confirm it: names of robots, by part.
            now: [s] on the machine's monotonic clock, as in `hear`.
        """
        if not self.reason:
            self.orders.clear()  # those before the last release
        self.generation += 1
        self.moment = now
        self.reason = self.latest = reason
        if order:
            keep_newest(self.orders, order, self.generation, MOST_ORDERS)
        self._forget()
        self.parts[self.generation] = {part: StopPart(name) for part, name in parts.items()}
        return self.generation

    def note_halted(self, halted: str, now: float) -> bool:
        """Take the robot's own report of a stop; return whether a stop begins with it."""
        begins = bool(halted) and not self.halted
        if begins:
            self.generation += 1
            self.moment = now
            self.latest = halted
        self.halted = halted
        return begins

    def take(self, generation: int, part: str, answer: Done | Raised) -> Done | Raised | None:
        """Take what one part has answered; its first answer counts.

        Returns:
            What the whole robot answers, if this was the last part of it.
        """
        asked_part = self.parts.get(generation, {}).get(part)
        if asked_part is None or asked_part.answer is not None:
            return None
        asked_part.answer = answer
        reply = self.reply(generation)
        if isinstance(reply, Done):
            self.confirmed = max(self.confirmed, generation)
        if reply is not None:
            self._forget()
        return reply

    def reply(self, generation: int) -> Done | Raised | None:
        """Return what the robot and all below it answer to a stop; None: not all of its parts have."""
        confirmations = Confirmations("the protective stop")
        for part in self.parts.get(generation, {}).values():
            match part.answer:
                case Done(confirmed=names):
                    confirmations.take(part.name, names)
                case Raised() as raised:
                    confirmations.take(part.name, raised.revive())
                case None:
                    return None
        try:
            return Done(confirmed=tuple(confirmations.settle()))
        except NotConfirmed as error:
            return Raised.of(error)

    def unanswered(self, generation: int) -> list[str]:
        """Return the parts that have not answered a stop."""
        return [
            part for part, asked_part in self.parts.get(generation, {}).items() if asked_part.answer is None
        ]

    def release(self) -> None:
        """End the ordered stop."""
        self.reason = ""
        self.orders.clear()
        self._forget()

    def _forget(self) -> None:
        """Forget the answers to stops that are not in force any more, once they are complete."""
        in_force = set(self.orders.values())
        for generation in [number for number in self.parts if number not in in_force and self.reply(number)]:
            del self.parts[generation]


MOST_LET = 64
"""Steps let through that are remembered; an older one that has not begun waits again."""


class PauseState(msgspec.Struct, kw_only=True):
    """See the module."""

    by: str = ""
    """The one who ordered it, for people; empty: nobody."""
    above: str = ""
    """The one who ordered the pause of its parent, for people; empty: that is not paused."""
    changes: int = 0
    """How often an order, or its parent, has changed it: its children hear of it."""
    heard: int = -1
    """The latest number of changes that its parent has named; -1: none yet under this lease."""
    let: dict[str, None] = {}
    """Keys of the steps that may pass, the oldest first."""

    @property
    def in_force(self) -> str:
        """The one who has paused it, for people; empty: it is not paused."""
        return self.by or self.above

    def may_pass(self, step: str) -> bool:
        """Whether the step of a key may be taken."""
        return not self.in_force or step in self.let

    def begin(self, by: str) -> None:
        """Pause."""
        self.by, self.changes = by, self.changes + 1

    def pass_one(self, step: str) -> None:
        """Let the step of a key pass."""
        keep_newest(self.let, step, None, MOST_LET)

    def end(self) -> None:
        """Let all go on."""
        self.by, self.above, self.changes = "", "", self.changes + 1
        self.let.clear()

    def hear(self, above: str, changes: int) -> bool:
        """Take what the parent says of its own pause; returns whether something has changed.

        Args:
            above: who has paused it; empty: nobody.
            changes: how often its pause has changed. The end of a pause above, if it is new, ends one here.
        """
        if changes <= self.heard:
            return False
        ends_all, self.heard = self.heard >= 0 and not above, changes
        if above == self.above and not (ends_all and self.by):
            return False
        if ends_all:
            self.end()
        else:
            self.above, self.changes = above, self.changes + 1
        return True

    def leave_parent(self) -> bool:
        """Take note that the lease is over; returns whether something has changed."""
        above, self.above, self.heard = self.above, "", -1
        if not above:
            return False
        self.changes += 1
        if not self.by:
            self.let.clear()
        return True
