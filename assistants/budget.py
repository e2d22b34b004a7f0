"""What one assistant may still do: calls in a minute, metres and seconds of motion in an hour. Pure.

All that counts is what was used in the last minute or hour. It is kept outside of the process that serves the
assistant (`record.py`): one that is started again has used as much as before.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, Literal

import msgspec

from robotree.vr.base.errors import BudgetSpent
from robotree.vr.base.policy import AssistantTerms

MINUTE: Final = 60.0
HOUR: Final = 3600.0
Limited = Literal["calls", "seconds", "metres"]
"""What an assistant uses up."""
LENGTHS: Final[dict[Limited, float]] = {"calls": MINUTE, "seconds": HOUR, "metres": HOUR}
"""[s] in which each is counted."""

PARTS: Final = 120
"""Parts of that time whose uses are kept one by one."""


class Use(msgspec.Struct, frozen=True, array_like=True):
    """Something that was used."""

    unix: float
    """[s] since 1970."""
    kind: Limited
    amount: float
    booked: str = ""
    """By which command that goes on; empty: it was used."""


class Budget:
    """What one assistant has used lately."""

    def __init__(self, uses: list[Use] | None = None) -> None:
        """Take what is known of an earlier process."""
        self.uses = uses or []
        self.changes: list[list[Any]] = []
        """What `use`, `book` and `settle` were given since it was kept last; see `replay`."""

    def replay(self, changes: Sequence[Sequence[Any]]) -> None:
        """Change it as it was changed before.

        Raises:
            TypeError, ValueError, KeyError: that is no list of changes.
        """
        for change, *given in changes:
            match change:
                case "use":
                    self._use(*given)
                case "book":
                    self._book(*given)
                case "settle":
                    self._settle(*given)
                case _:
                    raise ValueError(change)

    def used(self, kind: Limited, now: float) -> float:
        """Return how much of something was used in its time [now in s since 1970].

        A clock that was put back gives nobody anything: what was used in the future counts, too.
        """
        return sum(use.amount for use in self.uses if use.kind == kind and use.unix > now - LENGTHS[kind])

    def left(self, kind: Limited, terms: AssistantTerms, now: float) -> float:
        """Return how much of something is left, 0 at least [now in s since 1970]."""
        limit: float = getattr(terms, kind)
        return max(0.0, limit - self.used(kind, now))

    def expect(self, kind: Limited, terms: AssistantTerms, now: float, *, assistant: str) -> None:
        """Check that something is left.

        Args:
            kind: of what is needed.
            terms: of the policy.
            now: [s] since 1970.
            assistant: its name.

        Raises:
            BudgetSpent: it is not.
        """
        if self.left(kind, terms, now) > 0:
            return
        oldest = min((use.unix for use in self.uses if use.kind == kind and use.unix > now - LENGTHS[kind]),
                     default=now)  # fmt: skip
        raise BudgetSpent(
            assistant=assistant,
            what=_WORDS[kind],
            used=round(self.used(kind, now), 2),
            limit=getattr(terms, kind),
            per="a minute" if kind == "calls" else "an hour",
            seconds=math.ceil(max(1.0, oldest + LENGTHS[kind] - now)),
        )

    def use(self, kind: Limited, amount: float, now: float) -> None:
        """Note that something was used, and forget what counts no more [now in s since 1970].

        What was used in the same part of its time is one use, as if all of it were of now: so the list stays
        short, and nobody gets anything back too early.
        """
        self.changes.append(["use", kind, amount, now])
        self._use(kind, amount, now)

    def _use(self, kind: Limited, amount: float, now: float) -> None:
        self.uses = [use for use in self.uses if use.unix > now - LENGTHS[use.kind]]
        if amount <= 0:
            return
        part = LENGTHS[kind] / PARTS
        same = [use for use in self.uses
                if use.kind == kind and not use.booked and use.unix // part == now // part]  # fmt: skip
        amount += sum(use.amount for use in same)
        latest = max([now, *(use.unix for use in same)])
        self.uses = [use for use in self.uses if use not in same]
        self.uses.append(Use(latest, kind, amount))

    def book(self, by: str, kind: Limited, wanted: float, terms: AssistantTerms, now: float) -> float:
        """Take something out for a command before it is used, instead of what it had booked of it.

        Args:
            by: key of the command.
            kind: of what is wanted.
            wanted: how much at most.
            terms: of the policy.
            now: [s] since 1970.

        Returns:
            How much it has: what was left at most.
        """
        others = [use for use in self.uses if (use.booked, use.kind) != (by, kind)]
        amount = min(wanted, Budget(others).left(kind, terms, now))
        self.changes.append(["book", by, kind, amount, now])
        self._book(by, kind, amount, now)
        return amount

    def _book(self, by: str, kind: Limited, amount: float, now: float) -> None:
        self.uses = [use for use in self.uses if (use.booked, use.kind) != (by, kind)]
        self.uses.append(Use(now, kind, amount, by))

    def settle(self, by: str, used: Mapping[Limited, float], now: float) -> None:
        """Note what a command has used in the end; what else it had booked can be used by others again."""
        self.changes.append(["settle", by, dict(used), now])
        self._settle(by, used, now)

    def _settle(self, by: str, used: Mapping[Limited, float], now: float) -> None:
        self.uses = [use for use in self.uses if use.booked != by]
        for kind, amount in used.items():
            self._use(kind, amount, now)


_WORDS: Final[dict[Limited, str]] = {"calls": "calls", "seconds": "seconds of motion", "metres": "metres"}
