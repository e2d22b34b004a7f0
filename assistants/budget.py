"""What one assistant may still do: calls in a minute, metres and seconds of motion in an hour. Pure.

All that counts is what was used in the last minute or hour. It is kept outside of the process that serves the
assistant (`record.py`): one that is started again has used as much as before.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, Literal

import msgspec

from robotree.vr.base.errors import BudgetSpent
from robotree.vr.base.policy import AssistantTerms

MINUTE: Final = 60.0
HOUR: Final = 3600.0
What = Literal["calls", "seconds", "metres"]
LENGTHS: Final[dict[What, float]] = {"calls": MINUTE, "seconds": HOUR, "metres": HOUR}
"""[s] in which each is counted."""

PARTS: Final = 120
"""Parts of that time whose uses are kept one by one."""


class Use(msgspec.Struct, frozen=True, array_like=True):
    """Something that was used."""

    unix: float
    """[s] since 1970."""
    what: What
    amount: float
    booked: str = ""
    """By which command that goes on; empty: it was used."""


class Budget:
    """What one assistant has used lately."""

    def __init__(self, uses: list[Use] | None = None) -> None:
        """Take what is known of an earlier process."""
        self.uses = uses or []

    def used(self, what: What, now: float) -> float:
        """Return how much of something was used in its time [now in s since 1970].

        A clock that was put back gives nobody anything: what was used in the future counts, too.
        """
        return sum(use.amount for use in self.uses if use.what == what and use.unix > now - LENGTHS[what])

    def left(self, what: What, terms: AssistantTerms, now: float) -> float:
        """Return how much of something is left, 0 at least [now in s since 1970]."""
        limit: float = getattr(terms, what)
        return max(0.0, limit - self.used(what, now))

    def expect(
        self, what: What, terms: AssistantTerms, now: float, *, assistant: str, amount: float = 0
    ) -> None:
        """Check that something is left.

        Args:
            what: is needed.
            terms: of the policy.
            now: [s] since 1970.
            assistant: its name.
            amount: how much is needed; 0: anything.

        Raises:
            BudgetSpent: it is not.
        """
        left = self.left(what, terms, now)
        if left > 0 and left >= amount:
            return
        oldest = min((use.unix for use in self.uses if use.what == what and use.unix > now - LENGTHS[what]),
                     default=now)  # fmt: skip
        raise BudgetSpent(
            assistant=assistant,
            what=_WORDS[what],
            used=round(self.used(what, now), 2),
            limit=getattr(terms, what),
            per="a minute" if what == "calls" else "an hour",
            seconds=math.ceil(max(1.0, oldest + LENGTHS[what] - now)),
        )

    def use(self, what: What, amount: float, now: float) -> None:
        """Note that something was used, and forget what counts no more [now in s since 1970].

        What was used in the same part of its time is one use, as if all of it were of now: so the list stays
        short, and nobody gets anything back too early.
        """
        self.uses = [use for use in self.uses if use.unix > now - LENGTHS[use.what]]
        if amount <= 0:
            return
        part = LENGTHS[what] / PARTS
        same = [use for use in self.uses
                if use.what == what and not use.booked and use.unix // part == now // part]  # fmt: skip
        amount += sum(use.amount for use in same)
        latest = max([now, *(use.unix for use in same)])
        self.uses = [use for use in self.uses if use not in same]
        self.uses.append(Use(latest, what, amount))

    def book(self, by: str, what: What, wanted: float, terms: AssistantTerms, now: float) -> float:
        """Take something out for a command before it is used, instead of what it had booked of it.

        Args:
            by: key of the command.
            what: is wanted.
            wanted: how much at most.
            terms: of the policy.
            now: [s] since 1970.

        Returns:
            How much it has: what was left at most.
        """
        self.uses = [use for use in self.uses if (use.booked, use.what) != (by, what)]
        amount = min(wanted, self.left(what, terms, now))
        self.uses.append(Use(now, what, amount, by))
        return amount

    def settle(self, by: str, used: Mapping[What, float], now: float) -> None:
        """Note what a command has used in the end; what else it had booked can be used by others again."""
        self.uses = [use for use in self.uses if use.booked != by]
        for what, amount in used.items():
            self.use(what, amount, now)


_WORDS: Final[dict[What, str]] = {"calls": "calls", "seconds": "seconds of motion", "metres": "metres"}
