"""The one selection of the screen: a robot by name, whatever page shows it. Pure; `now` is an argument.

It stays on its robot while others come, go or are sorted, and goes to what was just made. Where it had to go
elsewhere by itself, an action that a person asks for in that half second may be meant for the robot before:
it is refused. `Place` is what keys are about: a robot, an empty slot, or nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

LOOK = 0.5
"""[s] that a person needs to see that another robot is selected."""


@dataclass(frozen=True, slots=True)
class Selection:
    """The selected robot, and since when."""

    name: str = ""
    """Of the selected robot; empty: none."""
    wanted: str = ""
    """The robot that a person chose: it is selected again when a filter that hid it goes."""
    before: str = ""
    """The robot that was selected before the selection changed by itself."""
    changed: float = -inf
    """[s] when it changed by itself."""

    def choose(self, name: str) -> Selection:
        """A person chooses a robot."""
        return Selection(name, name)

    def go_to(self, name: str, now: float) -> Selection:
        """Go to a robot by itself: it was just made, or the one before has gone."""
        if name == self.name:
            return replace(self, wanted=name)
        # what a person saw last: a robot that was just made may be selected before it is shown
        seen = self.before if now - self.changed < LOOK else self.name
        if seen == name:  # it is back on what was seen
            return Selection(name, name)
        return Selection(name, name, seen, now if seen else -inf)

    def among(self, before: Sequence[str], names: Sequence[str], now: float) -> Selection:
        """Stay on the robot, or go to a neighbour if it is shown no more.

        Args:
            before: the names that were shown when it was selected, in their order.
            names: those that are shown now.
            now: [s]
        """
        if self.wanted != self.name and self.wanted in names:
            return replace(self.go_to(self.wanted, now), wanted=self.wanted)
        if self.name in names or (not names and not self.name):
            return self
        return replace(self.go_to(self._neighbour(before, names), now), wanted=self.wanted)

    def _neighbour(self, before: Sequence[str], names: Sequence[str]) -> str:
        """Return the next robot below that is still shown, else the last one; empty: none is."""
        if self.name not in before:
            return names[0] if names else ""
        there, below = set(names), before[before.index(self.name) :]
        return next((name for name in below if name in there), names[-1] if names else "")

    def refusal(self, asked: float) -> str:
        """Return why an action that was asked for at this moment [s] may be meant for another robot.

        Empty: it is meant for the selected one.
        """
        if not self.before or asked - self.changed >= LOOK:
            return ""
        return f"the selection has just gone from {self.before} to {self.name or 'nobody'}: press again"


@dataclass(frozen=True, slots=True)
class Place:
    """A robot and the slot that it is in, or a slot that is empty."""

    name: str
    """The robot in this place; empty: nobody."""
    parent: str = ""
    slot: str = ""


NOWHERE = Place("")
"""Nothing is selected."""
