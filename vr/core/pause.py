"""Whether the commands of a robot wait before each step, and which steps may pass nevertheless. Pure.

A pause is ordered by who may command the robot, or it holds because the robot's parent is paused. A parent
says so with each renewal of its lease, together with how often its own pause has changed: an order that was
lost is made up for by the next renewal, and a renewal that comes late changes nothing.
"""

from __future__ import annotations

import msgspec

from robotree.vr.base.newest import keep_newest

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
